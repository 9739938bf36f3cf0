"""Inputs of the kinds that users bring, made here: a drive round a ring of corridors, its sensors, and their files.

Nothing here is the package's but what a test runs, so that a mistake in its angles, units or mounts cannot cancel out.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pfslam_viz as pf
from pfslam_viz import cli

Array = NDArray[np.float64]

EPOCH = 976052000.0  # s, of the first scan
CORNERS = ((0.0, 0.0), (17.0, 0.0), (17.0, 11.0), (0.0, 11.0), (0.0, 0.0))
SPEED, TURN_RATE = 0.6, 0.8  # m/s along, rad/s in place
METERS_PER_TICK = np.pi * 0.254 / 360
COURSE_LIDAR = (0.29833, 0.0, 0.0)  # the course's robot: x, y (m), yaw (rad)


def _box(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0, x1, y0], [x1, y0, x1, y1], [x1, y1, x0, y1], [x0, y1, x0, y0]]


WALLS = np.array(
    [
        *_box(-1.5, -1.5, 18.5, 12.5), *_box(1.5, 1.5, 15.5, 9.5),  # the ring, 20 x 14 m, its corridors 3 m wide
        *_box(3.0, -1.5, 4.2, -1.1), *_box(7.0, 1.1, 7.6, 1.5), *_box(11.2, -1.5, 11.7, -0.8),
        *_box(18.0, 2.5, 18.5, 3.4), *_box(15.1, 5.5, 15.5, 6.8), *_box(17.9, 8.6, 18.5, 9.0),
        *_box(12.5, 12.1, 13.6, 12.5), *_box(9.0, 9.5, 9.4, 9.9), *_box(4.4, 11.8, 4.9, 12.5),
        *_box(-1.5, 8.0, -0.9, 8.8), *_box(1.1, 5.0, 1.5, 5.5), *_box(-1.5, 2.2, -1.1, 3.6),
    ]
)  # fmt: skip


@dataclass(frozen=True)
class Way:
    """Where the robot is: at times (k,) s it is at ``poses`` (k, 3), its heading unwrapped; evenly in between."""

    times: Array
    poses: Array

    def at(self, times: Array) -> Array:
        """(..., 3) at ``times`` (...)."""
        return np.stack([np.interp(times, self.times, self.poses[:, i]) for i in range(3)], axis=-1)


def way_round(turn_rate: float = TURN_RATE, speed: float = SPEED, rest: float = 0.0, length: float = 56.0) -> Way:
    """Round the ring for ``length`` m; after 8.5 m it stands still for ``rest`` s."""
    times, poses = [0.0], [[0.0, 0.0, 0.0]]
    heading, gone = 0.0, 0.0

    def go(seconds: float, x: float, y: float) -> None:
        times.append(times[-1] + seconds)
        poses.append([x, y, heading])

    for (x0, y0), (x1, y1) in pairwise(CORNERS):
        if gone:
            heading += np.pi / 2
            go(np.pi / 2 / turn_rate, x0, y0)
        leg = float(np.hypot(x1 - x0, y1 - y0))
        far = min(leg, length - gone)
        if rest and not gone:
            go(8.5 / speed, 8.5, 0.0)
            go(rest, 8.5, 0.0)
            go((far - 8.5) / speed, far, 0.0)
        else:
            go(far / speed, x0 + (x1 - x0) * far / leg, y0 + (y1 - y0) * far / leg)
        gone += far
        if gone >= length:
            break
    return Way(np.array(times), np.array(poses))


def cast(poses: Array, angles: Array, people: Array | None = None, walls: Array = WALLS) -> Array:
    """True ranges (n, B) m of beams at ``angles`` (B,) or (n, B) from lidars at ``poses`` (n, 3) or (n, B, 3).

    ``people`` (n, p, 2) are round, 0.5 m thick, at their places in each scan.
    """
    poses = np.broadcast_to(poses[:, None] if poses.ndim == 2 else poses, (len(poses), angles.shape[-1], 3))
    x, y, facing = poses[..., 0], poses[..., 1], poses[..., 2] + angles
    c, s = np.cos(facing), np.sin(facing)
    nearest = np.full(facing.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for x0, y0, x1, y1 in walls:
            dx, dy, ax, ay = x1 - x0, y1 - y0, x0 - x, y0 - y
            cross = c * dy - s * dx
            r, along = (ax * dy - ay * dx) / cross, (ax * s - ay * c) / cross
            hit = (r > 0) & (along >= 0) & (along <= 1)
            np.minimum(nearest, np.where(hit, r, np.inf), out=nearest)
        for person in () if people is None else people.swapaxes(0, 1):
            px, py = person[:, :1] - x, person[:, 1:] - y
            ahead, beside = px * c + py * s, py * c - px * s
            r = ahead - np.sqrt(0.25**2 - beside**2)
            np.minimum(nearest, np.where(r > 0, r, np.inf), out=nearest)
    return nearest


def compose(poses: Array, mount: tuple[float, float, float]) -> Array:
    """Poses (..., 3) of what sits at ``mount`` on robots at ``poses``."""
    x, y, heading = poses[..., 0], poses[..., 1], poses[..., 2]
    c, s = np.cos(heading), np.sin(heading)
    return np.stack([x + c * mount[0] - s * mount[1], y + s * mount[0] + c * mount[1], heading + mount[2]], axis=-1)


def drifting(truth: Array, seed: int, scale: float = 1.02, drift: float = 0.007) -> Array:
    """Odometry poses (n, 3) from the origin: 2 % too long, bent by ``drift`` rad/m, every step 2 % rough."""
    rng = np.random.default_rng(seed)
    step = np.diff(truth, axis=0)
    back = -truth[:-1, 2] - 0.5 * step[:, 2]
    ahead = (np.cos(back) * step[:, 0] - np.sin(back) * step[:, 1]) * scale * (1 + rng.normal(0, 0.02, len(step)))
    turn = step[:, 2] * (1 + rng.normal(0, 0.02, len(step))) + (drift + rng.normal(0, 0.01, len(step))) * ahead
    heading = np.cumsum(turn)
    middle = heading - 0.5 * turn
    poses = np.column_stack([np.cumsum(ahead * np.cos(middle)), np.cumsum(ahead * np.sin(middle)), heading])
    return np.vstack([np.zeros((1, 3)), poses])


def degrees(first: float, last: float, beams: int) -> Array:
    """(beams,) rad from ``first`` to ``last`` degrees."""
    return np.radians(np.linspace(first, last, beams))


@dataclass(frozen=True)
class Drive:
    """A drive as its sensors saw it.

    stamps (n,) s from 0; truth (n, 3) from the origin; angles (B,) rad; ranges (n, B) m with 1 cm noise; odometry
    (n, 3) poses; mount: the lidar's on the robot.
    """

    way: Way
    stamps: Array
    truth: Array
    angles: Array
    ranges: Array
    odometry: Array
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seed: int = 0

    def changed(self, **changes: Any) -> "Drive":
        """With other values."""
        return replace(self, **changes)

    def limited(self, farthest: float, none: float = 0.0) -> "Drive":
        """With a lidar that sees no farther, to 1 cm, and writes ``none`` where it sees nothing."""
        return replace(self, ranges=np.where(self.ranges > farthest - 0.01, none, self.ranges))

    # CARMEN

    def flaser(self, path: Path, head: str = "", *, laser: Array | None = None, before: float = EPOCH) -> Path:
        """FLASER lines; ``laser`` (n, 3): the laser poses in them, if not the robot's; ``before`` the first stamp."""
        lines = []
        for k, stamp in enumerate(self.stamps + before):
            pose = _numbers(self.odometry[k])
            seen = pose if laser is None else _numbers(laser[k])
            row = " ".join(f"{r:.2f}" for r in self.ranges[k])
            lines.append(f"FLASER {len(self.ranges[k])} {row} {seen} {pose} {stamp:.6f} robot {stamp:.6f}\n")
        path.write_text(head + "".join(lines))
        return path

    def robotlaser(self, path: Path, farthest: float, scans: list[tuple[Array, float, float]] | None = None) -> Path:
        """ROBOTLASER1 lines; ``scans``: ranges, start angle, resolution of each, where they differ."""
        step = float(self.angles[1] - self.angles[0])
        lines = []
        for k, stamp in enumerate(self.stamps + EPOCH):
            row, start, resolution = (self.ranges[k], float(self.angles[0]), step) if scans is None else scans[k]
            view = abs(resolution) * (len(row) - 1)
            pose = _numbers(self.odometry[k])
            lines.append(
                f"ROBOTLASER1 0 {start:f} {view:f} {resolution:f} {farthest:f} 0.01 0 {len(row)}"
                f" {' '.join(f'{r:.2f}' for r in row)} 0 {pose} {pose} 0.6 0 0.33 0.35 1000 {stamp:f} robot {stamp:f}\n"
            )
        path.write_text("".join(lines))
        return path

    # The course's layout

    def course(self, folder: Path, **changes: dict[str, Any]) -> Path:
        """Set 5 in ``folder``, changed by ``changes`` (kind -> key -> value, or what makes it of the right one)."""
        rng = np.random.default_rng(self.seed + 100)
        until = self.stamps[-1] + 0.01
        wheel, gyro = np.arange(0.0, until, 0.025), np.arange(0.0, until, 0.01)
        poses = self.way.at(wheel)
        rolled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
        ticks = np.diff(np.floor(rolled * 1.005 / METERS_PER_TICK + 0.5), prepend=0.0)
        rates = np.zeros((3, len(gyro)))
        rates[2] = np.gradient(self.way.at(gyro)[:, 2], gyro) + 0.0006 + rng.normal(0, 0.005, len(gyro))
        arrays: dict[str, dict[str, Any]] = {
            "Encoders": {"counts": np.tile(ticks, (4, 1)).astype(np.int16), "time_stamps": 1.4e9 + wheel},
            "Imu": {
                "angular_velocity": rates,
                "linear_acceleration": np.zeros_like(rates),
                "time_stamps": 1.4e9 + gyro,
            },
            "Hokuyo": {
                "ranges": self.ranges.T.astype(np.float32), "time_stamps": 1.4e9 + self.stamps,
                "range_min": 0.1, "range_max": 5.0, "angle_min": self.angles[0], "angle_max": self.angles[-1],
                "angle_increment": self.angles[1] - self.angles[0],
            },
        }  # fmt: skip
        folder.mkdir(exist_ok=True)
        for kind, values in arrays.items():
            made = {k: new(values[k]) if callable(new) else new for k, new in changes.get(kind, {}).items()}
            np.savez(folder / f"{kind}5.npz", **{**values, **made})
        return folder


def _numbers(values: Array) -> str:
    return " ".join(f"{v:.6f}" for v in values)


def drive(
    angles: Array,
    *,
    rate: float = 4.0,
    way: Way | None = None,
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
    seed: int = 0,
    people: Callable[[Array], Array] | None = None,
    sweep: float = 0.0,
    noise: float = 0.01,
    walls: Array = WALLS,
) -> Drive:
    """A drive along ``way`` with ``rate`` scans a second; beams are ``sweep`` s late, the last the stamp's."""
    way = way or way_round()
    stamps = np.arange(0.0, way.times[-1], 1 / rate)
    truth = way.at(stamps)
    late = sweep * np.arange(1 - len(angles), 1) / len(angles)
    lidar = compose(way.at(stamps[:, None] + late) if sweep else truth, mount)
    ranges = cast(lidar, angles, None if people is None else people(stamps), walls)
    ranges += np.random.default_rng(seed).normal(0, noise, ranges.shape)
    return Drive(way, stamps, truth, angles, ranges, drifting(truth, seed), mount, seed)


@dataclass(frozen=True)
class Outcome:
    """rmse (m) against truth of the settled and the online trajectory and of dead reckoning; the run's result."""

    settled: float
    online: float
    reckoned: float
    result: Any = field(repr=False)

    @property
    def found(self) -> list[tuple[str, str]]:
        """What was found, without the readers' notes: severity and kind."""
        return [(f.severity, f.what) for f in self.result.recording.findings if f.what != "reader_note"]

    @property
    def said(self) -> str:
        return "\n".join(self.result.recording.notes)


def replayed(recording: Any, truth: Array) -> Outcome:
    """The outcome of a whole replay with the default configuration; every scan is used."""
    result = pf.run(recording, texture=False)
    assert len(result.stamps) == len(truth)
    errors = [
        float(np.sqrt(np.square(poses[:, :2] - truth[:, :2]).sum(axis=1).mean()))
        for poses in (result.estimate, result.online, result.dead_reckoning)
    ]
    return Outcome(errors[0], errors[1], errors[2], result)


def refusal(path: Path, capfd: pytest.CaptureFixture[str], *options: str) -> str:
    """The one line with which the command line refuses to replay a recording."""
    capfd.readouterr()
    status = cli.call(["replay", str(path), "--save", str(path.parent / "x.rrd"), "-q", *options])
    out, err = capfd.readouterr()
    assert (status, out) == (2, ""), err
    assert not (path.parent / "x.rrd").exists()
    (line,) = err.splitlines()
    return line


@pytest.fixture(scope="session")
def kit() -> Any:
    """All of the above, for the tests; and ``scanner``: one lap with beams between two angles, made once."""
    made: dict[tuple[Any, ...], Drive] = {}

    def scanner(first: float = -90.0, last: float = 90.0, beams: int = 91, seed: int = 0) -> Drive:
        key = (first, last, beams, seed)
        if key not in made:
            made[key] = drive(degrees(first, last, beams), seed=seed)
        return made[key]

    return SimpleNamespace(
        EPOCH=EPOCH, Way=Way, box=_box, way_round=way_round, cast=cast, compose=compose, degrees=degrees, drive=drive,
        scanner=scanner, replayed=replayed, refusal=refusal,
    )  # fmt: skip


@pytest.fixture(scope="session")
def course(kit: Any) -> Callable[..., Drive]:
    """Half a lap at 10 Hz with a lidar of 5 m on the course's robot, beams between two angles (degrees)."""
    made: dict[tuple[float, float, int, int], Drive] = {}

    def get(first: float = -135, last: float = 135, beams: int = 181, seed: int = 0) -> Drive:
        key = (first, last, beams, seed)
        if key not in made:
            angles = degrees(first, last, beams)
            seen = drive(angles, rate=10.0, way=way_round(length=28.0), mount=COURSE_LIDAR, seed=seed)
            made[key] = seen.limited(5.0)
        return made[key]

    return get
