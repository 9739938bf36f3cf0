"""Where a trajectory comes back to: by hand, and against a plain search."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.visits import earlier_visits

Array = NDArray[np.float64]

TURN_LENGTH = 0.7  # m per rad


def plain_visits(poses: Array, radius: float, apart: int, most: int) -> list[tuple[int, int]]:
    """Sort the near earlier ones by distance; take the nearest, leave out what belongs to the visits taken."""
    found = []
    for later in range(len(poses)):
        steps = geometry.between(poses[: max(later - apart, 0)], poses[later])
        away = np.hypot(steps[:, 0], steps[:, 1])
        near = [(away[k] + TURN_LENGTH * abs(steps[k, 2]), k) for k in np.flatnonzero(away <= radius).tolist()]
        taken: list[int] = []
        for _, earlier in sorted(near):
            if len(taken) < most and all(abs(earlier - other) > apart // 2 for other in taken):
                taken.append(earlier)
        found += [(earlier, later) for earlier in taken]
    return found


@pytest.mark.parametrize(
    ("radius", "apart", "most"), [(2.0, 30, 3), (1.0, 10, 2), (3.0, 5, 1), (2.0, 1, 4), (2.0, 30, 0)]
)
def test_earlier_visits_equal_a_plain_search(radius: float, apart: int, most: int) -> None:
    """On a random walk of 200 poses that turns in a small area."""
    rng = np.random.default_rng(7)
    poses = geometry.accumulate(np.column_stack([np.full(200, 0.3), np.zeros(200), rng.normal(0.2, 0.2, 200)]))
    found = earlier_visits(poses, radius, apart, most, TURN_LENGTH)
    assert [tuple(pair) for pair in found.tolist()] == plain_visits(poses, radius, apart, most)
    assert most == 0 or len(found) > 100


def test_earlier_visits_by_hand() -> None:
    """Poses 0 to 4 pass a place, 8 stands at 2 with the same heading, 9 there facing back, 10 far away."""
    x = np.array([0.0, 1, 2, 3, 4, 10, 20, 30, 2.1, 2.1, 50])
    poses = np.column_stack([x, 0 * x, np.where(np.arange(11) == 9, math.pi, 0.0)])
    assert earlier_visits(poses, 0.5, 4, 3, TURN_LENGTH).tolist() == [[2, 8], [2, 9]]
    poses[3, 2] = math.pi  # 3 faces back as well: 0.9 m are less than 0.1 m and half a turn at 0.7 m / rad
    assert earlier_visits(poses, 1.0, 4, 1, TURN_LENGTH).tolist() == [[2, 8], [3, 9]]
    assert earlier_visits(poses, 1.5, 4, 3, TURN_LENGTH).tolist() == [[2, 8], [3, 9]]  # 2 and 3 are the same visit
    assert earlier_visits(poses, 0.5, 7, 3, TURN_LENGTH).tolist() == []  # 2 is no more than 7 before 9
