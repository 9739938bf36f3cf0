"""Kernels that only kernels call become no machine code of their own, where numba is known, and work anywhere."""

from typing import Any

import numba
import pytest
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

from pfslam_viz.compiling import pipeline


def both() -> tuple[Any, Any]:
    """An inner kernel, and one that Python calls and that calls it twice."""
    make: Any = numba.njit
    common = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

    @make(pipeline_class=pipeline.InnerKernel, **common)  # type: ignore[untyped-decorator]
    def halved(x: float, n: int) -> float:
        for _ in range(n):
            x /= 2.0
        return x

    @make(pipeline_class=pipeline.EntryKernel, **common)  # type: ignore[untyped-decorator]
    def entry(x: float, n: int) -> float:
        if n < 0:
            raise ValueError("no such power")
        found: float = halved(x, n) + halved(x, n + 1)
        return found

    return halved, entry


def library(compiled: Any) -> Any:
    return next(iter(compiled.overloads.values())).library


@pytest.mark.skipif(numba.version_info[:2] not in pipeline.KNOWN, reason="not a release of numba that is known")
def test_an_inner_kernel_is_machine_code_only_within_its_callers() -> None:
    halved, entry = both()
    assert entry(8.0, 2) == 3.0
    assert library(halved)._compiled_object is None
    assert len(library(entry)._compiled_object) > 0
    assert any("halved" in function.name for function in library(halved).get_defined_functions())


def test_kernels_work_with_releases_of_numba_that_are_not_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "KNOWN", ())
    halved, entry = both()
    assert entry(8.0, 2) == 3.0
    assert not isinstance(library(halved), pipeline._Library) and not isinstance(library(entry), pipeline._Library)
    assert library(halved)._compiled_object is not None


def test_an_error_of_a_kernel_comes_out() -> None:
    _, entry = both()
    with pytest.raises(ValueError, match="no such power"):
        entry(1.0, -1)


@pytest.mark.skipif(numba.version_info[:2] not in pipeline.KNOWN, reason="not a release of numba that is known")
def test_kernels_whose_sums_may_be_reordered_are_optimised_as_numba_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """And so are those that call them; all others are optimised once."""
    optimised = list[str]()
    own: Any = JITCodeLibrary._optimize_final_module

    def optimise(self: Any) -> None:
        optimised.append(self.name)
        own(self)

    simplified = list[Any]()
    codegen: Any = JITCPUCodegen
    passes = codegen._function_pass_manager

    def simplify(self: Any) -> Any:
        simplified.append(self)
        return passes(self)

    monkeypatch.setattr(JITCodeLibrary, "_optimize_final_module", optimise)
    monkeypatch.setattr(codegen, "_function_pass_manager", simplify)
    make: Any = numba.njit
    common = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}

    @make(pipeline_class=pipeline.InnerKernel, fastmath=True, **common)  # type: ignore[untyped-decorator]
    def third(x: float) -> float:
        return x / 3.0

    @make(pipeline_class=pipeline.EntryKernel, **common)  # type: ignore[untyped-decorator]
    def calls(x: float) -> float:
        found: float = third(x) + 1.0
        return found

    _, entry = both()
    assert entry(8.0, 2) == 3.0 and not simplified
    assert calls(6.0) == 3.0 and simplified
    assert any("calls" in name for name in optimised)
    assert not any("entry" in name for name in optimised)
