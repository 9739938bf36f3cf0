"""The map that knows where in its cells the walls are."""

import numpy as np

from pfslam_viz.config import MapConfig, MatchingConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.wall_map import WallMap

MAP = MapConfig(cell=0.1)


def test_it_is_an_occupancy_grid() -> None:
    rng = np.random.default_rng(0)
    points, pose, sensor = rng.uniform(-4, 4, (200, 2)), np.array([0.3, -0.4, 0.5]), np.array([0.1, 0.0])
    plain, walls = OccupancyGrid(MAP), WallMap(MAP, MatchingConfig())
    plain.add(pose, points, sensor)
    walls.add_scan(pose, points, np.tile([1.0, 0.0], (200, 1)), sensor)
    np.testing.assert_array_equal(walls.log_odds, plain.log_odds)
    assert (walls.walls[walls.occupied == 1, 0] > 0).all()
    assert not walls.walls[walls.occupied == 0].any()


def test_walls_grow_with_the_grid_and_are_found_again() -> None:
    grid, origin = WallMap(MAP, MatchingConfig()), np.zeros(2)
    points, normals = np.stack([np.full(50, 2.0), np.linspace(-1, 1, 50)], axis=1), np.tile([-1.0, 0.0], (50, 1))
    grid.add_scan(np.zeros(3), points, normals, origin)
    shape = grid.shape
    grid.add_scan(np.array([-30.0, 30.0, 0.0]), points, normals, origin)
    assert grid.shape != shape and grid.walls.shape == (*grid.shape, 5)
    prior = np.diag([1.0, 1e6, 1e6])
    for place in (np.zeros(3), np.array([-30.0, 30.0, 0.0])):
        pose, information, score, partners = grid.match(place + np.array([0.03, 0, 0]), prior, points, normals)
        np.testing.assert_allclose(pose, place, atol=1e-3)
        assert partners[:, 4].all() and score > 0.99 and information[0, 0] > 100
