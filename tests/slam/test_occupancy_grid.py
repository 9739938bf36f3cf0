"""The occupancy grid, (20) to (29), on maps of a few cells."""

import math

import numpy as np
import pytest

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam import occupancy_grid
from pfslam_viz.slam.occupancy_grid import MARGIN, OccupancyGrid, Scratch
from pfslam_viz.slam.worker import Worker

LOG4 = math.log(4)
HERE = np.zeros(2)


def grid(**settings: float) -> OccupancyGrid:
    return OccupancyGrid(MapConfig(cell=0.5, **settings))


def at(g: OccupancyGrid, x: float, y: float) -> float:
    i, j = g.cells([[x, y]])[0]
    return float(g.log_odds[i, j])


def known(g: OccupancyGrid) -> dict[tuple[int, int], float]:
    """Log-odds of the cells that are not 0, by (row, column) from the world's origin."""
    return {
        (int(i) - g.origin[0], int(j) - g.origin[1]): float(g.log_odds[i, j]) for i, j in np.argwhere(g.log_odds != 0)
    }


def test_cells_by_hand() -> None:
    """(24), (25): i = floor(-y / 0.5) + origin_i, j = floor(x / 0.5) + origin_j."""
    g = grid()
    points = [[0.1, -0.1], [1.2, 0.1], [-0.1, 0.7], [1.0, -1.0]]
    assert (g.cells(points) - g.origin).tolist() == [[0, 0], [-1, 2], [-2, -1], [2, 2]]


def test_centers_lie_in_their_cells() -> None:
    g = grid()
    cells = np.array([[3, 4], [MARGIN, MARGIN], [MARGIN + 7, 2]])
    np.testing.assert_array_equal(g.cells(g.centers(cells)), cells)
    np.testing.assert_allclose(g.centers([[MARGIN, MARGIN]]), [[0.25, -0.25]])


def test_lower_left_is_the_corner_of_the_last_row() -> None:
    g = grid()
    x, y = g.lower_left
    corner = g.centers([[g.shape[0] - 1, 0]])[0]
    assert (x, y) == pytest.approx((corner[0] - 0.25, corner[1] - 0.25))


def test_one_beam_by_hand() -> None:
    """A beam along row 0, from column 0 to column 3: three free cells and a hit."""
    g = grid()
    g.add(np.array([0.2, -0.2, 0.0]), np.array([[1.5, 0.0]]), HERE)
    assert known(g) == pytest.approx({(0, 0): -LOG4, (0, 1): -LOG4, (0, 2): -LOG4, (0, 3): LOG4}, rel=1e-5)
    assert int(g.occupied.sum()) == 1
    assert g.occupied[g.origin[0], g.origin[1] + 3] == 1


def test_the_lidars_place_turns_with_the_robot() -> None:
    """Lidar 1 m ahead of a robot that faces up: the beam starts at (0.2, 0.8)."""
    g = grid()
    g.add(np.array([0.2, -0.2, math.pi / 2]), np.array([[2.0, 0.0]]), np.array([1.0, 0.0]))
    assert known(g) == pytest.approx({(-2, 0): -LOG4, (-3, 0): -LOG4, (-4, 0): LOG4}, rel=1e-5)


def test_a_cell_changes_once_a_scan_and_a_hit_wins() -> None:
    g = grid()
    pose = np.array([0.2, -0.2, 0.0])
    g.add(pose, np.array([[1.5, 0.0], [0.5, 0.0], [1.55, 0.0], [1.5, 0.01]]), HERE)
    assert known(g) == pytest.approx({(0, 0): -LOG4, (0, 1): LOG4, (0, 2): -LOG4, (0, 3): LOG4}, rel=1e-5)


def test_log_odds_are_bounded_and_threshold_decides() -> None:
    g = grid(log_odds_bound=3.0, threshold=2.0)
    pose, points = np.array([0.2, -0.2, 0.0]), np.array([[1.5, 0.0]])
    g.add(pose, points, HERE)
    assert at(g, 1.7, -0.2) == pytest.approx(LOG4, rel=1e-5) and not g.occupied.any()  # 1.39 is not above 2
    g.add(pose, points, HERE)
    assert at(g, 1.7, -0.2) == pytest.approx(2 * LOG4, rel=1e-5) and g.occupied.sum() == 1
    for _ in range(5):
        g.add(pose, points, HERE)
    assert (at(g, 1.7, -0.2), at(g, 0.7, -0.2)) == (3.0, -3.0)


def test_at_the_threshold_a_cell_is_free() -> None:
    """(29): +1 only above it. A hit and a miss cancel to exactly 0."""
    g = grid(threshold=0.0)
    pose = np.array([0.2, -0.2, 0.0])
    g.add(pose, np.array([[1.5, 0.0]]), HERE)
    g.add(pose, np.array([[2.5, 0.0]]), HERE)
    assert at(g, 1.7, -0.2) == 0.0
    assert g.occupied[g.origin[0], g.origin[1] + 3] == 0
    g.add(pose, np.array([[2.5, 0.0]]), HERE)
    g.add(pose, np.array([[1.5, 0.0]]), HERE)
    assert at(g, 1.7, -0.2) == 0.0
    assert g.occupied[g.origin[0], g.origin[1] + 3] == 0


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_growing_keeps_what_is_known_and_a_ring_unknown(heading: float) -> None:
    g = grid()
    start = np.array([0.2, -0.2, heading])
    g.add(start, np.array([[1.5, 0.0]]), HERE)
    before, shape = known(g), g.shape
    far = np.array([[200.0, 0.0]])
    g.add(np.array([0.2, -0.2, heading]), far, np.array([199.5, 0.0]))
    after = known(g)
    assert g.shape != shape and g.log_odds.shape == g.occupied.shape == g.shape
    assert before.items() <= after.items() and len(after) == len(before) + 2
    ring = np.ones(g.shape, bool)
    ring[1:-1, 1:-1] = False
    assert not g.log_odds[ring].any() and not g.occupied[ring].any()
    assert g.correlation(start[None], np.array([[1.5, 0.0], [200.0, 0.0], [5000.0, 0.0]])).tolist() == [2]


def test_an_empty_scan_changes_nothing() -> None:
    g = grid()
    g.add(np.array([300.0, 0.0, 0.0]), np.zeros((0, 2)), HERE)
    assert known(g) == {}
    assert g.correlation(np.zeros((3, 3)), np.zeros((0, 2))).tolist() == [0, 0, 0]


def test_hits_and_misses_cancel_whatever_their_order() -> None:
    """As often hit as missed is exactly 0, at the threshold of (29), and not a rounding error beside it."""
    pose = np.array([0.2, -0.2, 0.0])
    for times in range(1, 25):
        g = grid(log_odds_hit=0.9, log_odds_miss=0.9)
        for x in times * [1.5] + times * [2.5]:
            g.add(pose, np.array([[x, 0.0]]), HERE)
        assert at(g, 1.7, -0.2) == 0.0


def test_correlation_by_hand() -> None:
    """(26): end points in two occupied cells and a free one count 2, however many there are."""
    g = grid()
    g.add(np.array([0.2, -0.2, 0.0]), np.array([[1.5, 0.0], [0.0, 2.0]]), HERE)
    points = np.array([[1.5, 0.0], [1.55, 0.05], [0.0, 2.0], [0.5, 0.0]])
    poses = np.array([[0.2, -0.2, 0.0], [1.2, -0.2, 0.0], [0.2, -0.2, math.pi]])
    assert g.correlation(poses, points).tolist() == [2, 1, 0]


def test_correlation_is_the_same_with_a_worker() -> None:
    rng = np.random.default_rng(3)
    g = OccupancyGrid(MapConfig(cell=0.1))
    g.add(np.zeros(3), rng.uniform(-3, 3, (500, 2)), HERE)
    poses, points = rng.uniform(-1, 1, (1000, 3)), rng.uniform(-3, 3, (300, 2))
    alone = g.correlation(poses, points)
    assert alone.max() > 40
    worker = Worker()
    for _ in range(20):
        np.testing.assert_array_equal(g.correlation(poses, points, worker), alone)
    worker.close()


def test_marks_start_again_before_they_overflow(monkeypatch: pytest.MonkeyPatch) -> None:
    """A mark that a cell still carries from the round before must not be taken for one of this round."""
    monkeypatch.setattr(occupancy_grid, "MARKS", 10)
    scratch = Scratch((2, 2))
    scratch.marks[0, 0] = scratch.take(1)
    firsts = []
    for _ in range(4):
        firsts.append(scratch.take(3))
        assert scratch.marks[0, 0] not in range(firsts[-1], firsts[-1] + 3)
    assert max(firsts) + 2 <= 10 and firsts != sorted(firsts)


@pytest.mark.parametrize(("x", "y"), [(0.25, -31.75), (0.25, 31.75), (-31.75, 0.25), (31.75, 0.25)])
def test_an_end_point_in_the_outermost_ring_makes_the_grid_grow(x: float, y: float) -> None:
    """128 cells of 0.5 m about the origin: rows 0 and 127 begin at y = 32 and -31.5, columns at x = -32 and 31.5."""
    g = grid()
    g.add(np.array([0.2, -0.2, 0.0]), np.array([[x - 0.2, y + 0.2]]), HERE)
    assert at(g, x, y) == pytest.approx(LOG4, rel=1e-5)
    assert g.shape != (128, 128)
    ring = np.ones(g.shape, bool)
    ring[1:-1, 1:-1] = False
    assert not g.log_odds[ring].any()
    inner = grid()
    x, y = np.clip([x, y], -31.25, 31.25)  # one cell further in, it need not
    inner.add(np.array([0.2, -0.2, 0.0]), np.array([[x - 0.2, y + 0.2]]), HERE)
    assert inner.shape == (128, 128)
