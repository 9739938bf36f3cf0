"""The probabilistic motion model: equations (13), (18) and (19).

The increment that it adds noise to, (17), is made of wheels and gyro when a recording is read: see
:mod:`pfslam_viz.recordings.wheel_odometry`.
"""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam import kernels
from pfslam_viz.slam.paper.settings import MotionConfig

Array = NDArray[np.float64]


def predict(particles: Array, increment: Array, dt: float, config: MotionConfig, rng: Generator) -> Array:
    """Particles (N, 3) after the odometry ``increment`` (3,) of ``dt`` s, each with noise of its own, (13).

    ``additive`` is (18) with w ~ N(0, diag(variance)), in the world's frame whatever the motion was. ``scaled`` is
    noise of the increment itself, see :func:`scaled_variance`.
    """
    noise = rng.standard_normal(particles.shape)
    if config.model == "scaled":
        noise *= np.sqrt(scaled_variance(increment, dt, config))
        return geometry.compose(particles, increment + noise)
    return kernels.move(particles, increment, noise * np.sqrt(config.variance))


def scaled_variance(increment: Array, dt: float, config: MotionConfig) -> Array:
    """Variance (3,), m², m², rad², of an increment (3,) of ``dt`` s: linear in distance, turn and time."""
    distance, turn = math.hypot(increment[0], increment[1]), abs(float(increment[2]))
    place = config.distance_by_distance**2 * distance + config.distance_by_turn**2 * turn
    heading = config.turn_by_turn**2 * turn + config.turn_by_distance**2 * distance + config.turn_by_time**2 * dt
    return np.array([place, place, heading])
