"""A drive round a ring of corridors, 20 x 14 m, with what a lidar and an odometry say of it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.checking.check import check
from pfslam_viz.recordings.findings import Finding
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.simulation.sensors import true_ranges

Array = NDArray[np.float64]

METERS_PER_TICK = np.pi * 0.254 / 360
ANGLES = np.radians(np.linspace(-135, 135, 181))
CORNERS = ((1.3, 1.3), (18.7, 1.2), (18.6, 12.7), (1.2, 12.8), (1.3, 3.0))
SPEED, TURN_RATE, RATE = 0.6, 0.8, 5.0  # m/s, rad/s in place, Hz


def _box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]]


WALLS = np.array(
    [
        *_box(0, 0, 20, 14), *_box(2.5, 2.5, 17.5, 11.5), *_box(8, -0.1, 9, 0.6), *_box(3, 13.2, 4, 14.1),
        *_box(19.2, 5, 20.1, 6), *_box(-0.1, 9, 0.5, 9.7), *_box(13, 1.8, 14, 2.6), *_box(11, 13.5, 12, 14.1),
    ]
)  # fmt: skip


@dataclass(frozen=True)
class Drive:
    """stamps (n,) s; ranges (n, 181) m; odometry (n, 3) increments, 2 % rough; truth (n, 3)."""

    stamps: Array
    ranges: Array
    odometry: Array
    truth: Array

    def recording(self, **changes: Any) -> Recording:
        """Of arrays, with some of the arguments changed; not checked."""
        given: dict[str, Any] = {
            "stamps": self.stamps,
            "ranges": self.ranges,
            "angles": ANGLES,
            "odometry": self.odometry,
            "range_max": 30.0,
        }
        given |= changes
        if "odometry_poses" in changes:
            del given["odometry"]
        return Recording.from_arrays(**given)

    def checked(self, **changes: Any) -> Recording:
        return check(self.recording(**changes))


def _poses() -> Array:
    """(n, 3) at 5 Hz: straight from corner to corner, turning on the spot."""
    poses: list[list[float]] = []
    heading = 0.0
    for start, end in zip(np.array(CORNERS[:-1]), np.array(CORNERS[1:]), strict=True):
        x, y = end - start
        towards = float(np.arctan2(y, x))
        turn = float(geometry.wrap(towards - heading))
        steps = int(abs(turn) / TURN_RATE * RATE)
        poses += [[*start, heading + np.sign(turn) * TURN_RATE / RATE * k] for k in range(steps)]
        heading, length = towards, float(np.hypot(x, y))
        poses += [[*(start + (end - start) * s / length), heading] for s in np.arange(0, length, SPEED / RATE)]
    return np.array(poses)


@pytest.fixture(scope="session")
def ring() -> Drive:
    rng = np.random.default_rng(7)
    truth = _poses()
    ranges, _ = true_ranges(WALLS, truth, ANGLES)
    odometry = geometry.increments(truth) * (1 + rng.normal(0, 0.02, truth.shape))
    stamps = 1000.0 + np.arange(len(truth)) / RATE
    return Drive(stamps, ranges + rng.normal(0, 0.01, ranges.shape), odometry, truth)


@pytest.fixture
def write_ring(ring: Drive, tmp_path: Path) -> Callable[..., Path]:
    """Writes the drive as set 5 of the course's, changed by ``changes`` (kind -> key -> value)."""

    def write(**changes: dict[str, Any]) -> Path:
        end = ring.stamps[-1] + 0.5
        wheel, gyro = np.arange(999.5, end, 0.025), np.arange(999.5, end, 0.01)
        steps = geometry.increments(ring.truth)
        rolled = np.interp(wheel, ring.stamps, np.cumsum(np.hypot(steps[:, 0], steps[:, 1])))
        turned = np.interp(gyro, ring.stamps, np.cumsum(steps[:, 2]))
        ticks = np.diff(np.floor(rolled / METERS_PER_TICK), prepend=0.0)
        rates = np.zeros((3, len(gyro)))
        rates[2] = np.gradient(turned, gyro)
        arrays: dict[str, dict[str, Any]] = {
            "Encoders": {"counts": np.tile(ticks, (4, 1)).astype(np.int16), "time_stamps": wheel},
            "Imu": {"angular_velocity": rates, "linear_acceleration": np.zeros_like(rates), "time_stamps": gyro},
            "Hokuyo": {
                "ranges": ring.ranges.T, "time_stamps": ring.stamps, "range_min": 0.1, "range_max": 30.0,
                "angle_min": ANGLES[0], "angle_max": ANGLES[-1], "angle_increment": ANGLES[1] - ANGLES[0],
            },
        }  # fmt: skip
        for kind, values in arrays.items():
            made = {
                key: change(values[key]) if callable(change) else change
                for key, change in changes.get(kind, {}).items()
            }
            np.savez(tmp_path / f"{kind}5.npz", **{**values, **made})
        return tmp_path

    return write


@pytest.fixture
def write_log(ring: Drive, tmp_path: Path) -> Callable[..., Path]:
    """Writes the drive's 181 beams from -90 to 90 degrees as a CARMEN log with odometry ``poses`` (n, 3)."""

    def write(poses: Array, ranges: Array | None = None) -> Path:
        half = np.radians(np.arange(-90.0, 91.0))
        seen, _ = true_ranges(WALLS, ring.truth, half)
        path = tmp_path / "ring.log"
        lines = []
        for k, row in enumerate(seen if ranges is None else ranges):
            x, y, turn = poses[k]
            beams = " ".join(f"{r:.3f}" for r in row)
            pose = f"{x:.6f} {y:.6f} {turn:.6f}"
            lines.append(f"FLASER {len(row)} {beams} {pose} {pose} {ring.stamps[k]:.3f} host {ring.stamps[k]:.3f}\n")
        path.write_text("".join(lines))
        return path

    return write


Found = Callable[[Recording, str], Finding]


@pytest.fixture(scope="session")
def only() -> Found:
    """The one finding of a recording, which is of the severity given; and nothing else but the reader's notes."""

    def find(recording: Recording, severity: str) -> Finding:
        found = [finding for finding in recording.findings if finding.what != "reader_note"]
        assert [finding.severity for finding in found] == [severity], found
        assert "\n" not in found[0].line
        return found[0]

    return find
