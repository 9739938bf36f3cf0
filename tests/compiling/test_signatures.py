"""What numba finds of operators is remembered: the same signatures, and kernels that give the same."""

import operator
from typing import Any

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target
from numba.core.types.functions import BaseFunction

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.compiling.signatures import remembered_signatures

types: Any = numba.types
ARRAY = types.Array(types.float32, 2, "C")
CALLS = [
    (operator.add, (types.int64, types.float32)),
    (operator.add, (types.uint8, types.int64)),
    (operator.lt, (types.float64, types.int64)),
    (operator.truediv, (types.int64, types.int64)),
    (operator.getitem, (ARRAY, types.UniTuple(types.int64, 2))),
    (operator.getitem, (ARRAY, types.int64)),
    (operator.setitem, (ARRAY, types.UniTuple(types.int64, 2), types.float64)),
]


def resolve(function: Any, arguments: tuple[Any, ...]) -> Any:
    return cpu_target.typing_context.resolve_function_type(function, arguments, {})


@pytest.fixture(autouse=True)
def loaded() -> None:
    cpu_target.typing_context.refresh()


def counted(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Gets an item whenever numba itself looks for a signature."""
    own, asked = BaseFunction.get_call_type, list[Any]()

    def get_call_type(self: Any, *of: Any) -> Any:
        asked.append(of)
        return own(self, *of)

    monkeypatch.setattr(BaseFunction, "get_call_type", get_call_type)
    return asked


@pytest.mark.parametrize(("function", "arguments"), CALLS)
def test_a_signature_is_the_same_and_is_looked_for_once(
    monkeypatch: pytest.MonkeyPatch, function: Any, arguments: tuple[Any, ...]
) -> None:
    expected = resolve(function, arguments)
    asked = counted(monkeypatch)
    with remembered_signatures():
        assert [resolve(function, arguments) for _ in range(3)] == [expected] * 3
    assert len(asked) == 1
    assert resolve(function, arguments) == expected and len(asked) == 2


def test_what_has_no_signature_has_none_the_second_time() -> None:
    with remembered_signatures():
        for _ in range(2):
            with pytest.raises(numba.core.errors.TypingError):
                resolve(operator.lshift, (types.float64, types.int64))


def test_what_is_compiled_for_its_caller_is_looked_for_every_time(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = counted(monkeypatch)
    with remembered_signatures():
        for _ in range(3):
            resolve(max, (types.float64, types.float64))
    assert len(asked) >= 3


def test_what_is_compiled_for_its_caller_is_not_remembered() -> None:
    """The greatest of two floats: each caller has numba's function compiled with its own flags."""

    @kernel("f8, f8")
    def greater(x: float, y: float) -> float:
        return max(x, y) + min(x, y)

    @kernel("f8, f8", error_model="numpy")
    def share(x: float, y: float) -> float:
        return max(x, y) / y

    with remembered_signatures():
        assert greater(1.0, 3.0) == 4.0
        assert share(1.0, 0.0) == np.inf
