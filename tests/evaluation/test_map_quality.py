"""Map quality on rooms whose numbers are known."""

import math
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.evaluation.map_quality import map_quality, occupied_area, scan_to_map_score, wall_thickness
from pfslam_viz.evaluation.scans import end_points, key_scans
from pfslam_viz.recordings.recording import Lidar, Recording
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid


def make_recording(odometry: np.ndarray, ranges: np.ndarray, angles: np.ndarray, mount: np.ndarray) -> Recording:
    return Recording(
        name="room",
        format="test",
        path=Path("room"),
        stamps=0.5 * np.arange(len(odometry), dtype=np.float64),
        ranges=ranges.astype(np.float32),
        lidar=Lidar(angles, 0.1, 30.0, mount),
        odometry=odometry,
    )


def grid_with(cells: list[tuple[int, int]], size: float = 0.1) -> OccupancyGrid:
    """A grid in which ``cells``, as offsets (row, column) from the cell at the origin, are occupied."""
    grid = OccupancyGrid(MapConfig(cell=size))
    for row, column in cells:
        grid.log_odds[grid.origin[0] + row, grid.origin[1] + column] = 2.0
        grid.occupied[grid.origin[0] + row, grid.origin[1] + column] = 1
    return grid


def test_wall_thickness_is_two_deviations_across() -> None:
    rng = np.random.default_rng(0)
    along = rng.uniform(0, 40, 8_000)
    across = rng.normal(0, 0.03, 8_000)
    turned = geometry.transform([3, 1, 0.7], np.stack([along, across], axis=-1))
    assert wall_thickness(turned) == pytest.approx(0.06, rel=0.06)
    # Seen twice, 0.1 m apart: a deviation of 0.05 across.
    doubled = np.stack([along, np.where(rng.random(8_000) < 0.5, 0.0, 0.1)], axis=-1)
    assert wall_thickness(doubled) == pytest.approx(0.1, rel=0.06)
    assert wall_thickness(np.zeros((3, 2))) is None
    assert wall_thickness(np.arange(40.0).reshape(20, 2)) is None  # nobody has a neighbour


def test_occupied_area() -> None:
    assert occupied_area(grid_with([(0, 0), (0, 1), (5, 5)])) == pytest.approx(0.03)
    assert occupied_area(OccupancyGrid(MapConfig())) == 0.0


def test_scan_to_map_score() -> None:
    grid = grid_with([(0, 0)])
    centre = grid.centers([[grid.origin[0], grid.origin[1]]])[0]
    near, far = centre + np.array([0.2, 0.0]), np.array([500.0, 500.0])
    assert scan_to_map_score(centre[None], grid) == pytest.approx(1.0)
    # Two cells of 0.1 m away, with a deviation of 0.1 m: exp(-2).
    assert scan_to_map_score(near[None], grid) == pytest.approx(math.exp(-2), rel=1e-3)
    assert scan_to_map_score(np.array([centre, near, far]), grid) == pytest.approx((1 + math.exp(-2)) / 3, rel=1e-3)
    assert scan_to_map_score(np.zeros((0, 2)), grid) is None


def test_key_scans_go_by_distance_not_by_time() -> None:
    odometry = np.zeros((100, 3))
    odometry[40:60, 0] = 0.1  # 2 m in between standing still
    recording = make_recording(odometry, np.ones((100, 3)), np.zeros(3), np.zeros(3))
    kept = key_scans(recording, distance=0.5)
    assert kept[0] == 0
    assert len(kept) == pytest.approx(5, abs=1)
    assert ((kept == 0) | ((kept >= 40) & (kept < 60))).all()


def test_end_points_leave_out_no_returns_and_know_the_mount() -> None:
    ranges = np.array([[2.0, 0.0, 99.0], [np.float32(3.0), 1.0, 0.05]])
    recording = make_recording(
        np.zeros((2, 3)), ranges, np.radians([0, 90, 180]), np.array([0.3, 0.0, math.radians(90)])
    )
    found = end_points(recording, np.array([0, 1]))
    np.testing.assert_array_equal(found.scan, [0, 1, 1])
    np.testing.assert_allclose(found.points, [[0.3, 2], [0.3, 3], [-0.7, 0]], atol=1e-12)
    poses = np.array([[0, 0, 0], [10, 0, math.pi / 2]])
    np.testing.assert_allclose(found.at(poses), [[0.3, 2], [7, 0.3], [10, -0.7]], atol=1e-12)
    assert len(end_points(recording, np.array([0, 1]), most=2).points) == 2


def test_path_ratio_and_gap() -> None:
    odometry = np.tile([0.1, 0, 0], (11, 1))
    odometry[0] = 0
    recording = make_recording(odometry, np.full((11, 3), 99.0), np.zeros(3), np.zeros(3))
    poses = recording.dead_reckoning() * [1.02, 1, 1]
    quality = map_quality(recording, poses, OccupancyGrid(MapConfig()))
    assert quality.path_ratio == pytest.approx(1.02)
    assert quality.end_to_start_gap == pytest.approx(1.02)
    assert quality.occupied_area == 0 and quality.revisits == 0
    assert quality.wall_thickness is None and quality.revisit_error is None and quality.scan_to_map_score is None
