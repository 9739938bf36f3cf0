"""Dead reckoning from wheel ticks and a gyro: equation (17), at any stamps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.recording import Trajectory

Array = NDArray[np.float64]


def differential_drive(distance: ArrayLike, turn: ArrayLike) -> Array:
    """Motion ``(n, 3)`` of a robot that rolls ``distance`` m along an arc while turning by ``turn`` rad.

    Equation (17) from the origin: distance * sinc(turn / 2) * (cos(turn / 2), sin(turn / 2)), with
    sinc(x) = sin(x) / x; ``numpy.sinc`` has a pi in it.
    """
    d, half = np.asarray(distance, dtype=np.float64), 0.5 * np.asarray(turn, dtype=np.float64)
    chord = d * np.sinc(half / np.pi)
    return np.stack([chord * np.cos(half), chord * np.sin(half), 2.0 * half], axis=-1)


@dataclass(frozen=True, slots=True)
class WheelOdometry:
    """How far the robot has rolled and turned, as functions of time.

    Attributes:
        wheel_stamps: (n,) s, increasing.
        distance: (n,) m rolled by then, forward positive; the mean of the four wheels.
        gyro_stamps: (m,) s, increasing.
        heading: (m,) rad turned by then, not wrapped.
    """

    wheel_stamps: Array
    distance: Array
    gyro_stamps: Array
    heading: Array

    @classmethod
    def from_sensors(
        cls, wheel_stamps: Array, counts: Array, meters_per_tick: float, gyro_stamps: Array, yaw_rate: Array
    ) -> "WheelOdometry":
        """Add up ticks ``counts`` (4, n), each since the reading before, and integrate ``yaw_rate`` (m,) in rad/s.

        The yaw rate is integrated by the trapezoid rule.
        """
        steps = 0.5 * (yaw_rate[1:] + yaw_rate[:-1]) * np.diff(gyro_stamps)
        return cls(
            wheel_stamps=wheel_stamps,
            distance=np.cumsum(counts.mean(axis=0)) * meters_per_tick,
            gyro_stamps=gyro_stamps,
            heading=np.concatenate([[0.0], np.cumsum(steps)]),
        )

    def increments(self, stamps: Array) -> Array:
        """The robot's motion ``(k, 3)`` up to each of the ``(k,)`` stamps from the one before; row 0 is zero.

        Distance and heading are interpolated. Outside its samples a sensor is taken to rest: its last value is held.
        """
        distance = np.interp(stamps, self.wheel_stamps, self.distance)
        heading = np.interp(stamps, self.gyro_stamps, self.heading)
        steps = np.zeros((len(stamps), 3))
        steps[1:] = differential_drive(np.diff(distance), np.diff(heading))
        return steps

    def dead_reckoning(self, stamps: Array | None = None) -> Trajectory:
        """Poses by wheels and gyro alone, from the origin, at ``stamps`` or else at every encoder reading."""
        at = self.wheel_stamps if stamps is None else stamps
        return Trajectory(at, geometry.accumulate(self.increments(at)))

    def path_length(self) -> float:
        """Metres rolled, forwards and backwards, between the first and the last encoder reading."""
        return float(np.abs(np.diff(self.distance)).sum())

    def rolled_between(self, start: float, end: float) -> float:
        """Metres that the wheels rolled forward in the time from ``start`` to ``end``."""
        before, after = np.interp([start, end], self.wheel_stamps, self.distance)
        return float(after - before)
