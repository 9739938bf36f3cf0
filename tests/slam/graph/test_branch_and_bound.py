"""The search in blocks finds what looking at every offset finds."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.branch_and_bound import search

Array = NDArray[np.float64]


def everywhere(field: NDArray[np.float32], centre: Array, points: Array, turns: Array, steps: int) -> Array:
    """Scores (turns, 2 steps + 1, 2 steps + 1) of all offsets, one after the other."""
    n, width = len(field), 2 * steps + 1
    out = np.zeros((len(turns), width, width))
    for t, turn in enumerate(turns):
        columns, rows = np.floor(geometry.transform(np.array([*centre, turn]), points)).astype(int).T
        for i in range(width):
            for j in range(width):
                r, c = rows + i - steps, columns + j - steps
                inside = (r >= 0) & (c >= 0) & (r < n) & (c < n)
                out[t, i, j] = field[r[inside], c[inside]].sum() / len(points)
    return out


@pytest.mark.parametrize("seed", range(6))
def test_the_best_offset_and_its_rival_are_found(seed: int) -> None:
    """On random maps, where hardly a bound holds, from which some points fall off."""
    rng = np.random.default_rng(seed)
    field = (rng.random((50, 50)) ** 6).astype(np.float32)
    points = rng.uniform(-20, 20, (12, 2))
    turns = np.array([-0.2, 0.0, 0.2])
    steps = 9 + seed % 3
    centre = np.array([25.3, 24.6])
    scores = everywhere(field, centre, points, turns, steps)
    t, i, j = (int(k) for k in np.unravel_index(int(np.argmax(scores)), scores.shape))
    fit = search(field, centre, points, turns, steps, least=0.1, share=0.8, apart=3.0)
    assert fit is not None and fit.score == pytest.approx(scores.max(), abs=1e-5)
    assert (fit.turn, fit.row + steps, fit.column + steps) == (t, i, j)
    rows, columns = np.ogrid[: scores.shape[1], : scores.shape[2]]
    rival = scores[:, (rows - i) ** 2 + (columns - j) ** 2 > 9.0].max()
    if rival > 0.8 * fit.score:
        assert fit.rival == pytest.approx(rival, abs=1e-5)
    else:
        assert fit.rival <= 0.8 * fit.score + 1e-5


def test_nothing_is_found_where_nothing_fits() -> None:
    field = np.full((40, 40), 0.3, np.float32)
    points = np.random.default_rng(0).uniform(-5, 5, (20, 2))
    assert search(field, np.full(2, 20.0), points, np.zeros(1), 5, least=0.5, share=0.8, apart=2.0) is None
