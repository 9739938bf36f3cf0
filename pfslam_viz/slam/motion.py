"""The probabilistic motion model: equations (13) and (17) to (19)."""

import math

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import MotionConfig

Array = NDArray[np.float64]


def differential_drive(distance: Array | float, rotation: Array | float) -> Array:
    """The increment (..., 3) that (17) makes of v tau = ``distance`` (m) and omega tau = ``rotation`` (rad).

    In the frame of the pose before: distance * sinc(rotation / 2) along heading rotation / 2, sinc(x) = sin(x) / x.
    """
    d, half = np.broadcast_arrays(np.asarray(distance, np.float64), np.asarray(rotation, np.float64) / 2.0)
    chord = d * np.sinc(half / np.pi)  # numpy.sinc(x) is sin(pi x) / (pi x)
    return np.stack([chord * np.cos(half), chord * np.sin(half), 2.0 * half], axis=-1)


def predict(particles: Array, increment: Array, dt: float, config: MotionConfig, rng: Generator) -> Array:
    """Particles (N, 3) after the odometry ``increment`` (3,) of ``dt`` s, each with noise of its own, (13).

    ``additive`` is (18) with w ~ N(0, diag(variance)), in the world's frame whatever the motion was. ``scaled`` is
    noise of the increment itself, see :func:`scaled_variance`.
    """
    from pfslam_viz.slam import kernels

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
