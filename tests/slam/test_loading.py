"""Whoever loads kernels hears of it when numba has to compile."""

from collections.abc import Callable

from numba import njit

from pfslam_viz.slam.loading import announced


def test_compiling_is_announced_while_one_listens() -> None:
    heard: list[str] = []
    with announced(lambda: heard.append("compiling")):
        assert compiled()(1.5) == 3.0
    assert heard
    before = len(heard)
    assert compiled()(2.5) == 5.0  # compiled as well, and nobody listens
    assert len(heard) == before


def test_what_is_compiled_already_is_not_announced() -> None:
    double = compiled()
    assert double(1.5) == 3.0
    heard: list[str] = []
    with announced(lambda: heard.append("compiling")):
        assert double(2.5) == 5.0
    assert heard == []


def compiled() -> Callable[[float], float]:
    """A new function every time, to be compiled on its first call."""

    @njit()
    def double(x: float) -> float:
        return 2 * x

    return double
