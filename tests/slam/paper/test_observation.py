"""From ranges to end points, (22), and the correlation's neighbourhood, IV-E-1."""

import math

import numpy as np
import pytest
from pfslam_viz.slam.observation import ScanReader, correlation

from pfslam_viz.recordings.recording import Lidar
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.paper.settings import ObservationConfig

QUARTER = math.pi / 2


def lidar(yaw: float = 0.0) -> Lidar:
    return Lidar(np.array([-QUARTER, 0.0, QUARTER]), 0.1, 30.0, np.array([0.3, 0.1, yaw]))


def ranges(*values: float) -> np.ndarray:
    return np.array(values, np.float32)


def test_end_points_by_hand() -> None:
    scan = ScanReader.of(lidar(), ObservationConfig()).read(7, 1.5, ranges(1, 2, 4))
    np.testing.assert_allclose(scan.points, [[0.3, -0.9], [2.3, 0.1], [0.3, 4.1]], atol=1e-12)
    np.testing.assert_array_equal(scan.origin, [0.3, 0.1])
    assert (scan.index, scan.stamp) == (7, 1.5)


def test_the_lidars_yaw_turns_the_beams_about_it() -> None:
    scan = ScanReader.of(lidar(yaw=QUARTER), ObservationConfig()).read(0, 0.0, ranges(1, 2, 4))
    np.testing.assert_allclose(scan.points, [[1.3, 0.1], [0.3, 2.1], [-3.7, 0.1]], atol=1e-12)


def test_ranges_outside_the_limits_are_no_return() -> None:
    reader = ScanReader.of(lidar(), ObservationConfig())
    assert len(reader.read(0, 0.0, ranges(0.0, 0.05, 30.5)).points) == 0
    assert len(reader.read(0, 0.0, ranges(0.11, 29.9, 0.0)).points) == 2
    near = ScanReader.of(lidar(), ObservationConfig(max_range=3.0))
    np.testing.assert_allclose(near.read(0, 0.0, ranges(4, 2, 4)).points, [[2.3, 0.1]], atol=1e-12)
    far = ScanReader.of(lidar(), ObservationConfig(max_range=300.0))  # no further than the lidar sees
    assert len(far.read(0, 0.0, ranges(40, 40, 40)).points) == 0


def test_thinning_keeps_the_first_and_the_last_beam() -> None:
    scanner = Lidar(np.linspace(-1, 1, 101), 0.1, 30.0, np.zeros(3))
    points = ScanReader.of(scanner, ObservationConfig(max_beams=5)).read(0, 0.0, np.full(101, 2.0, np.float32)).points
    np.testing.assert_allclose(np.arctan2(points[:, 1], points[:, 0]), [-1, -0.5, 0, 0.5, 1], atol=1e-12)
    single = ScanReader.of(scanner, ObservationConfig(max_beams=1)).read(0, 0.0, np.full(101, 2.0, np.float32))
    assert len(single.points) == 1


def small_map() -> OccupancyGrid:
    """One wall cell: row 0, column 3 from the origin, with cells of 0.5 m."""
    grid = OccupancyGrid(MapConfig(cell=0.5))
    grid.add(np.array([0.25, -0.25, 0.0]), np.array([[1.5, 0.0]]), np.zeros(2))
    return grid


@pytest.mark.parametrize(
    ("pose", "plain", "perturbed"),
    [
        ((0.25, -0.25, 0.0), 1, 1),
        ((0.75, -0.25, 0.0), 0, 1),  # a cell ahead of itself: found one cell back in x
        ((0.25, 0.25, 0.0), 0, 1),  # ... in y
        ((0.75, 0.25, 0.0), 0, 1),  # ... in both
        ((1.25, -0.25, 0.0), 0, 0),  # two cells are too far
    ],
)
def test_perturbation_takes_the_best_neighbour(pose: tuple[float, ...], plain: int, perturbed: int) -> None:
    grid, particles, points = small_map(), np.array([pose]), np.array([[1.5, 0.0]])
    assert correlation(grid, particles, points, ObservationConfig()).tolist() == [plain]
    assert correlation(grid, particles, points, ObservationConfig(perturbation=True)).tolist() == [perturbed]
    np.testing.assert_array_equal(particles[0], pose)


def test_perturbation_turns_the_particle() -> None:
    """15 m ahead, 0.02 rad are 0.3 m: from 0.1 m above the wall's cell down into it, or not."""
    grid = OccupancyGrid(MapConfig(cell=0.5))
    grid.add(np.array([0.25, -0.25, 0.0]), np.array([[15.0, 0.0]]), np.zeros(2))
    particle, points = np.array([[0.25, -0.25, 0.025]]), np.array([[15.0, 0.0]])  # 0.375 m high: one row above
    still = ObservationConfig(perturbation=True, perturbation_cells=0, perturbation_angle=0.0)
    turning = ObservationConfig(perturbation=True, perturbation_cells=0, perturbation_angle=0.02)
    assert correlation(grid, particle, points, still).tolist() == [0]
    assert correlation(grid, particle, points, turning).tolist() == [1]
