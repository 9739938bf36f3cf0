"""The observation models: the correlation's neighbourhood, IV-E-1, and the likelihood field."""

import math

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.paper.observation import correlation, likelihood_field
from pfslam_viz.slam.paper.settings import ObservationConfig


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


def test_the_likelihood_field_by_hand() -> None:
    """The wall's cell is at (1.75, -0.25): end points 0, 1 and 2 cells of 0.5 m from it, and one outside the grid."""
    config = ObservationConfig(model="likelihood_field", sigma=0.5, outliers=0.2, temper=0.5)
    grid, points = small_map(), np.array([[1.5, 0.0]])
    particles = np.array([[0.25, -0.25, 0.0], [0.75, -0.25, 0.0], [1.25, -0.25, 0.0], [500.0, 0.0, 0.0]])
    likelihood = [0.8 * math.exp(-0.5 * d**2) + 0.2 for d in (0, 1, 2)] + [0.2]
    np.testing.assert_allclose(likelihood_field(grid, particles, points, config), np.sqrt(likelihood), rtol=1e-5)
    two = likelihood_field(grid, particles, np.repeat(points, 2, axis=0), config)  # beams multiply
    np.testing.assert_allclose(two, likelihood, rtol=1e-5)


def test_the_likelihood_field_says_nothing_before_there_is_a_wall() -> None:
    config = ObservationConfig(model="likelihood_field")
    assert not likelihood_field(OccupancyGrid(MapConfig()), np.zeros((3, 3)), np.ones((2, 2)), config).any()
    assert not likelihood_field(small_map(), np.zeros((3, 3)), np.zeros((0, 2)), config).any()
    turned = np.array([[0.25, -0.25, 0.0], [0.25, -0.25, math.pi]])
    seen = geometry.transform(np.zeros(3), np.array([[1.5, 0.0]]))
    ahead, behind = likelihood_field(small_map(), turned, seen, config)
    assert ahead == 1.0 and behind < 1.0
