"""Searching wide for places come back to: by hand, against a plain twin, and on a corridor with known truth."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph import loop_closing
from pfslam_viz.slam.graph.drift import Drift
from pfslam_viz.slam.graph.loop_closing import blurred, find_candidates, find_loops, overlay
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import LoopClosingConfig, ScanMatchingConfig

Array = NDArray[np.float64]

ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 181)
CONFIG = LoopClosingConfig()
NO_LINKS = np.zeros((0, 2), np.int64)


def plain_overlay(field: NDArray[np.float32], centre: Array, points: Array, turns: Array, steps: int) -> Array:
    n, width = len(field), 2 * steps + 1
    out = np.zeros((len(turns), width, width))
    for t, turn in enumerate(turns):
        moved = geometry.transform(np.array([*centre, turn]), points)
        cells = np.floor(moved).astype(int)
        for column, row in cells:
            if steps <= row < n - steps and steps <= column < n - steps:
                out[t] += field[row - steps : row + steps + 1, column - steps : column + steps + 1]
    return out / len(points)


def test_overlay_equals_its_plain_twin() -> None:
    rng = np.random.default_rng(1)
    field = rng.random((60, 60)).astype(np.float32)
    points = rng.uniform(-32, 32, (80, 2))  # some leave the field
    turns = np.array([-0.3, 0.0, 0.2])
    found = overlay(field, np.array([30.2, 29.7]), points, turns, 4)
    assert found.shape == (3, 9, 9)
    np.testing.assert_allclose(found, plain_overlay(field, np.array([30.2, 29.7]), points, turns, 4), atol=1e-5)


def test_overlay_finds_the_shift_and_the_turn() -> None:
    """An L of walls, laid over itself after a turn of 0.12 rad and a shift of 5 cells right and 3 up."""
    wall = np.array([[x, 0.0] for x in np.arange(0, 3, 0.05)] + [[0.0, y] for y in np.arange(0, 2, 0.05)])
    field, corner = blurred(wall, np.zeros(2), 5.0, CONFIG.cell, CONFIG.blur)
    assert field.max() == 1.0 and field.shape == (100, 100)
    np.testing.assert_allclose(corner, [-5.0, -5.0])
    turns = np.array([-0.12, 0.0, 0.12])
    seen = geometry.transform(geometry.inverse([0.5, 0.3, 0.12]), wall)  # where the wall is seen from there
    scores = overlay(field, -corner / CONFIG.cell, seen / CONFIG.cell, turns, 10)
    turn, row, column = np.unravel_index(int(np.argmax(scores)), scores.shape)
    assert turn == 2 and abs(column - 15) <= 1 and abs(row - 13) <= 1
    assert scores.max() > 0.8


def test_candidates_are_far_back_on_the_path_and_near_in_space() -> None:
    """Out 20 m and back along a line 1.5 m beside it, a key scan every 0.5 m, each joint good to 0.1 m."""
    out = np.stack([np.arange(0, 20, 0.5), np.zeros(40), np.zeros(40)], axis=-1)
    back = np.stack([np.arange(19.5, -0.5, -0.5), np.full(40, 1.5), np.full(40, np.pi)], axis=-1)
    poses = np.concatenate([out, back])
    config = CONFIG.model_copy(update={"least_loop": 10.0, "least_reach": 1.0, "most_reach": 2.0, "least_turn": 0.2})
    drift = Drift(poses, np.tile([0.1, 0.0], (79, 1)), NO_LINKS, 100)
    later = np.arange(CONFIG.every, 80, CONFIG.every)
    found = find_candidates(poses, drift, later, config)
    assert len(found.later) > 0 and (found.later % CONFIG.every == 0).all()
    assert (found.later >= 40).all()
    nearest = np.unique(found.later, return_index=True)[1]
    np.testing.assert_allclose(poses[found.earlier, 0][nearest], poses[found.later, 0][nearest], atol=1e-9)  # across
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    assert (path[found.later] - path[found.earlier]).min() >= 10.0
    np.testing.assert_allclose(found.reach, np.clip(0.3 * np.sqrt(found.later - found.earlier), 1.0, 2.0))
    np.testing.assert_allclose(found.turn, 0.2)
    sure = Drift(poses, np.tile([0.01, 0.0], (79, 1)), NO_LINKS, 100)
    assert len(find_candidates(poses, sure, later, config).later) == 0  # 1 m of reach does not bridge 1.5 m


def room_walls(features: bool) -> Array:
    """A hall 16 m x 3 m; with ``features``, boxes of different sizes at different places along its walls."""
    hall = [(-3.0, -1.5, 13.0, -1.5), (13.0, -1.5, 13.0, 1.5), (13.0, 1.5, -3.0, 1.5), (-3.0, 1.5, -3.0, -1.5)]
    if not features:
        return np.array([(-60.0, -1.5, 60.0, -1.5), (-60.0, 1.5, 60.0, 1.5)])
    for x, y, w, h in ((0.5, -1.5, 0.5, 0.4), (3.1, 1.0, 1.1, 0.5), (6.4, -1.5, 0.3, 0.6), (8.8, 1.2, 0.6, 0.3)):
        hall += [(x, y, x + w, y), (x + w, y, x + w, y + h), (x + w, y + h, x, y + h), (x, y + h, x, y)]
    return np.array(hall, np.float64)


def store(walls: Array, poses: Array) -> ScanStore:
    rng = np.random.default_rng(0)
    scans = ScanStore(np.zeros(2), ScanMatchingConfig())
    for ranges in true_ranges(walls, poses, ANGLES)[0]:
        seen = ranges < 20.0
        noisy = ranges[seen] + 0.01 * rng.standard_normal(seen.sum())
        scans.add(np.stack([noisy * np.cos(ANGLES[seen]), noisy * np.sin(ANGLES[seen])], axis=-1))
    return scans


def there_and_again() -> Array:
    """Along the hall, back by a way that is not part of the scans, and along it again: 0.2 m a key scan."""
    x = np.arange(0.0, 9.0, 0.2)
    once = np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=-1)
    return np.concatenate([once, once + np.array([0.03, 0.1, 0.0])])


def believed(poses: Array) -> Array:
    """The second drive is believed 1.2 m further and 0.3 m aside; in between a detour makes the path long."""
    wrong = poses.copy()
    wrong[len(poses) // 2 :, :2] += [1.2, 0.3]
    return wrong


@pytest.mark.parametrize("features", [True, False])
def test_a_loop_is_found_where_the_walls_tell_and_not_in_a_bare_hall(features: bool) -> None:
    truth = there_and_again()
    poses = believed(truth)
    scans = store(room_walls(features), truth)
    config = CONFIG.model_copy(update={"least_loop": 5.0, "least_reach": 2.0})
    drift = Drift(poses, np.full((len(poses) - 1, 2), 0.001), NO_LINKS, 100)
    loops = find_loops(scans, poses, drift, config)
    if not features:
        assert loops == []
        return
    assert len(loops) >= 1
    for loop in loops:
        assert not loop.robust.any()
        true = geometry.between(truth[loop.start], truth[loop.end])
        np.testing.assert_allclose(loop.measured, true, atol=0.03)


def test_where_everything_is_out_of_range_no_loop_is_looked_for() -> None:
    """Round the block once more, past a stretch where no scan had an end point: nothing to compare, and no error."""
    nothing, wall = np.zeros((0, 2)), np.array([[1.0, 0.2], [1.1, 0.2], [1.2, 0.2]])
    for there, seen in ((nothing, wall), (wall, nothing), (nothing, nothing)):
        assert loop_closing._search(there, seen, np.zeros(3), 1.0, 0.2, CONFIG) is None


@pytest.mark.filterwarnings("error")
def test_a_map_of_walls_that_are_elsewhere_is_empty() -> None:
    field, corner = blurred(np.array([[50.0, 0.0]]), np.zeros(2), 5.0, 0.1, 0.12)
    assert field.shape == (100, 100)
    assert not field.any()
    np.testing.assert_allclose(corner, [-5.0, -5.0])
