"""What is written out where kernels call it gives what numba's own functions give, and numba compiles no others."""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import event
from numpy.typing import NDArray

from pfslam_viz.compiling.pipeline import EntryKernel

Floats = NDArray[np.float64]


def compiled(function: Callable[..., Any], signature: str) -> tuple[Any, list[str]]:
    """A kernel, and the names of all that numba compiled for it."""
    names = []

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            names.append(event.data["dispatcher"].py_func.__name__)

        def on_end(self, event: Any) -> None:
            pass

    options: Any = {"pipeline_class": EntryKernel, "no_cpython_wrapper": True}
    made: Any = numba.njit(**options)(function)  # that no cache has
    with event.install_listener("numba:compile", Listener()):
        made.compile(tuple(getattr(numba.types, one) for one in signature.split(", ")))
    return made, names


def a_line(n: int) -> Floats:
    return np.empty(n)


def a_table(n: int) -> NDArray[np.float32]:
    return np.zeros((n, 3), np.float32)


def a_block(n: int) -> NDArray[np.int64]:
    return np.zeros((2, n, n + 1), dtype=np.int64)


def marks(n: int) -> NDArray[np.bool_]:
    return np.zeros(n, np.bool_)


def floats(n: int) -> Floats:
    return np.zeros((n, n), dtype=float)


@pytest.mark.parametrize("function", [a_line, a_table, a_block, marks, floats])
def test_arrays_are_those_of_numpy(function: Callable[[int], NDArray[Any]]) -> None:
    made, names = compiled(function, "i8")
    for n in (0, 1, 5):
        found, expected = made(n), function(n)
        assert (found.shape, found.dtype) == (expected.shape, expected.dtype)
        assert n == 0 or found.strides == expected.strides
        assert found.flags.c_contiguous and found.flags.writeable
        if function is not a_line:
            np.testing.assert_array_equal(found, expected)
    assert names == [function.__name__]


def test_an_array_is_a_place_of_its_own_for_as_long_as_it_is_held() -> None:
    made, _ = compiled(a_block, "i8")
    held = [made(7) for _ in range(50)]
    for k, one in enumerate(held):
        one += k
    assert all((one == k).all() for k, one in enumerate(held))


def least_and_greatest(x: float, y: float) -> tuple[float, float]:
    return min(x, y), max(x, y)


@pytest.mark.parametrize("signature", ["f8, f8", "f4, f8", "i8, f8", "u1, i8", "i4, i4", "f4, f4"])
def test_extremes_of_two_are_those_of_python(signature: str) -> None:
    made, names = compiled(least_and_greatest, signature)
    own: Any = numba.njit(least_and_greatest)
    first, second = (getattr(numba.types, one) for one in signature.split(", "))
    own.compile((first, second))
    assert made.overloads[first, second].signature == own.overloads[first, second].signature
    x: list[float] = [3, 7] if "f" not in signature.split(", ")[0] else [3.0, 7.0, -0.0, 0.0, math.nan, -math.inf]
    y: list[float] = [3, 7] if "f" not in signature.split(", ")[1] else [3.0, 7.0, -0.0, 0.0, math.nan, -math.inf]
    for a in x:
        for b in y:
            for found, expected in zip(made(a, b), least_and_greatest(a, b), strict=True):
                assert repr(float(found)) == repr(float(expected))  # -0.0 is not 0.0 here
    assert names == ["least_and_greatest"]


def others(x: float) -> tuple[float, float, float]:
    values = np.zeros_like(np.array([x, 2.0]))
    return min(x, 2.0, 1.0), max((x, 5.0)), values[1]


def test_what_it_does_not_know_is_numbas() -> None:
    made, _ = compiled(others, "f8")
    assert made(3.0) == (1.0, 5.0, 0.0)
    assert made(-3.0) == (-3.0, 5.0, 0.0)
