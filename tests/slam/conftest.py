"""Walls that several test modules drive along."""

import numpy as np
import pytest
from numpy.typing import NDArray

Array = NDArray[np.float64]


def box(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    """The four walls of a rectangle, as x0, y0, x1, y1 each."""
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


@pytest.fixture(scope="session")
def block() -> Array:
    """Walls (w, 4) of a corridor 2 m wide round a block, with things of different sizes along them."""
    return np.array(
        box(-1, -1, 9, 7) + box(1, 1, 7, 5) + box(2.0, -1, 2.6, -0.7) + box(5.2, 0.75, 5.9, 1) + box(8.6, 1.3, 9, 2.2)
        + box(7, 3.5, 7.3, 4.0) + box(5.5, 6.6, 6.2, 7) + box(2.5, 5, 2.8, 5.25) + box(-1, 4.1, -0.75, 4.9)
        + box(0.8, 2.2, 1, 2.9)
    )  # fmt: skip
