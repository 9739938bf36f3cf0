"""Tiny recordings whose numbers can be worked out by hand."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

METERS_PER_TICK = np.pi * 0.254 / 360
SPEED = 10 * METERS_PER_TICK * 40  # m/s: ten ticks a reading, forty readings a second
TURN_RATE = 0.5  # rad/s


def tiny_set(duration: float = 2.0) -> dict[str, dict[str, Any]]:
    """A set of a robot that drives round a circle at SPEED and TURN_RATE; three beams; scans from 0.5 s on."""
    wheel = 1000.0 + np.arange(0, duration + 0.01, 0.025)
    gyro = 1000.0 + np.arange(0, duration + 0.005, 0.01)
    lidar = 1000.5 + np.arange(0, duration - 1.0 + 0.01, 0.1)
    ranges = np.tile([[1.0], [2.0], [40.0]], len(lidar)) + 0.001 * np.arange(len(lidar))
    yaw = np.zeros((3, len(gyro)))
    yaw[2] = TURN_RATE
    return {
        "Encoders": {"counts": np.full((4, len(wheel)), 10, dtype=np.int16), "time_stamps": wheel},
        "Hokuyo": {
            "ranges": ranges,
            "angle_min": -0.5,
            "angle_max": np.array([[0.5]]),
            "angle_increment": np.array([[0.5]]),
            "range_min": 0.1,
            "range_max": 30.0,
            "time_stamps": lidar,
        },
        "Imu": {"angular_velocity": yaw, "linear_acceleration": np.zeros_like(yaw), "time_stamps": gyro},
    }


@pytest.fixture
def write_set(tmp_path: Path) -> Callable[..., Path]:
    """Writes :func:`tiny_set` as set 7, changed by ``changes`` (kind -> key -> value; None leaves a key out)."""

    def write(folder: Path | None = None, number: int = 7, **changes: dict[str, Any] | None) -> Path:
        folder = folder or tmp_path
        folder.mkdir(parents=True, exist_ok=True)
        for kind, arrays in {**tiny_set(), **{k: {} for k in changes if k == "Kinect"}}.items():
            change = changes.get(kind, {})
            if change is None:
                continue
            merged = {key: value for key, value in {**arrays, **change}.items() if value is not None}
            np.savez(folder / f"{kind}{number}.npz", **merged)
        return folder

    return write
