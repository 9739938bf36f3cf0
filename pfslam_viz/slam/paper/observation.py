"""Observation models: how likely a scan is from every particle, given the map."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.paper.settings import ObservationConfig
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]
ObservationModel = Callable[[OccupancyGrid, Array, Array, ObservationConfig, Worker | None], Array]


def correlation(
    grid: OccupancyGrid, particles: Array, points: Array, config: ObservationConfig, worker: Worker | None = None
) -> Array:
    """(26) for every particle (N,); with ``perturbation``, the best over the offsets of section IV-E-1.

    ``particles`` (N, 3) are poses, ``points`` (m, 2) m the scan's end points in the robot's frame. The particles
    themselves stay where they are: an offset only finds the agreement in their neighbourhood.
    """
    if not config.perturbation:
        return grid.correlation(particles, points, worker).astype(np.float64)
    cells, angle = config.perturbation_cells, config.perturbation_angle
    best = np.zeros(len(particles))
    for turn in (-angle, 0.0, angle):
        for dx in range(-cells, cells + 1):
            for dy in range(-cells, cells + 1):
                offset = np.array([dx * grid.cell, dy * grid.cell, turn])
                np.maximum(best, grid.correlation(particles + offset, points, worker), out=best)
    return best


def likelihood_field(
    grid: OccupancyGrid, particles: Array, points: Array, config: ObservationConfig, worker: Worker | None = None
) -> Array:
    """The likelihood field model (Thrun, Burgard & Fox 2005, table 6.3), tempered, relative to the best particle (N,).

    An end point at distance d from the nearest occupied cell has the likelihood
    (1 - outliers) exp(-d² / 2 sigma²) + outliers. All zero where nothing is occupied yet.
    """
    import cv2

    window, origin = grid.window()
    occupied = window > 0
    if not occupied.any() or len(points) == 0:
        return np.zeros(len(particles))
    distance = cv2.distanceTransform((~occupied).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * grid.cell
    log_field = np.log((1 - config.outliers) * np.exp(-0.5 * (distance / config.sigma) ** 2) + config.outliers)
    log_likelihood = np.empty(len(particles))
    for k, particle in enumerate(particles):
        x, y = geometry.transform(particle, points).T / grid.cell
        rows, columns = np.floor(-y).astype(np.int64) + origin[0], np.floor(x).astype(np.int64) + origin[1]
        inside = (rows >= 0) & (columns >= 0) & (rows < window.shape[0]) & (columns < window.shape[1])
        outside = len(points) - np.count_nonzero(inside)
        log_likelihood[k] = log_field[rows[inside], columns[inside]].sum() + outside * np.log(config.outliers)
    return np.asarray(np.exp(config.temper * (log_likelihood - log_likelihood.max())), np.float64)


OBSERVATION_MODELS: dict[str, ObservationModel] = {
    "correlation": correlation,
    "likelihood_field": likelihood_field,
}
"""By the name that ``observation.model`` has for them. What they return multiplies the weights, (27)."""
