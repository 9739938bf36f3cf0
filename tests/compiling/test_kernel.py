"""How kernels are declared: their types, and that every one is compiled beforehand."""

import ast
from pathlib import Path
from typing import Any, NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import SIGNATURES, find, kernel, types_of
from pfslam_viz.compiling.needed import every
from tests.kernels import from_python

types: Any = numba.types
ROOT = Path(__file__).resolve().parents[2] / "pfslam_viz"


class Rules(NamedTuple):
    column: int
    share: float


@kernel("f8[:, ::1], i8, Rules")
def weighed(values: NDArray[np.float64], row: int, rules: Rules) -> float:
    found: float = rules.share * values[row, rules.column]
    return found


@kernel()
def doubled(x: float) -> float:
    return 2.0 * x


def test_a_signature_names_arrays_numbers_and_named_tuples() -> None:
    array = types.Array(types.float64, 2, "C")
    named = types.NamedTuple([types.int64, types.float64], Rules)
    assert types_of(weighed, "f8[:, ::1], i8, Rules") == (array, types.int64, named)
    assert types_of(weighed, "f4[:], u1[:, :, :]") == (
        types.Array(types.float32, 1, "A"), types.Array(types.uint8, 3, "A"),
    )  # fmt: skip


def test_what_is_compiled_by_its_signature_is_what_python_calls() -> None:
    compiled, signature = SIGNATURES[__name__][0]
    compiled.compile(types_of(compiled, signature))
    before = list(compiled.signatures)
    assert weighed(np.array([[1.0, 2.0], [3.0, 5.0]]), 1, Rules(1, 0.5)) == 2.5
    assert list(compiled.signatures) == before


def test_a_kernel_without_a_signature_is_for_kernels() -> None:
    assert from_python(doubled)(1.5) == 3.0
    assert all(compiled is not doubled for kernels in SIGNATURES.values() for compiled, _ in kernels)


def test_signatures_have_as_many_types_as_the_kernels_have_arguments() -> None:
    for name in every().first:
        compiled, signature = find(name)
        code = compiled.py_func.__code__
        varied = bool(code.co_flags & 4)
        assert len(types_of(compiled, signature)) == code.co_argcount + varied, name


def test_every_kernel_is_in_the_table_of_what_is_needed() -> None:
    names = every().first
    for name in names:
        find(name)
    declared = {
        f"{module.removeprefix('pfslam_viz.')}.{compiled.py_func.__name__}"
        for module, kernels in SIGNATURES.items()
        if module.startswith("pfslam_viz.")
        for compiled, _ in kernels
    }
    assert declared == set(names)


def is_kernel(function: ast.FunctionDef) -> bool:
    return any("kernel" in ast.unparse(decorator) for decorator in function.decorator_list)


def test_no_python_code_calls_a_kernel_that_has_no_entry() -> None:
    """Such a call ends the process with a segmentation fault. By name, unless the module has its own of that name."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in sorted(ROOT.rglob("*.py"))}
    functions = [(path, f) for path, tree in trees.items() for f in ast.walk(tree) if isinstance(f, ast.FunctionDef)]
    entered = {name.rpartition(".")[2] for name in every().first}
    inner = {f.name for _, f in functions if is_kernel(f)} - entered
    assert {"write_scan", "wall_normals"} <= inner
    own = {path: {f.name for where, f in functions if where == path and not is_kernel(f)} for path in trees}
    called = []
    for path, function in functions:
        if not is_kernel(function):
            names = [ast.unparse(call.func).split(".")[-1] for call in ast.walk(function) if isinstance(call, ast.Call)]
            called += [f"{path.name}: {function.name}: {name}" for name in names if name in inner - own[path]]
    assert called == []
