"""How the robot drives: a smooth path along a route, and when it is where."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.simulation.world import Array

SPACING = 0.02  # m between the samples of a path
RATE = 200.0  # Hz of a drive's poses
SHORTEST = 5.0  # s


@dataclass(frozen=True, slots=True)
class DriveConfig:
    """How fast, and how carefully: what a person with a remote control does in a hallway."""

    cruise: float = 1.45  # m/s on a straight
    yaw_rate: float = 1.25  # rad/s at most
    acceleration: float = 0.8  # m/s²
    braking: float = 0.7  # m/s²
    settle: float = 0.1  # s, standard deviation of the Gaussian that smooths the speed over time
    corner: float = 0.3  # m, standard deviation of the Gaussian that rounds the route's corners
    wander: float = 0.035  # m, standard deviation of the path about the route
    hesitation: float = 0.12  # relative standard deviation of the speed
    still_before: float = 3.0  # s of standing still at the start
    still_after: float = 2.5  # s at the end


@dataclass(frozen=True, slots=True)
class Drive:
    """Where the rear axle is: ``poses`` (n, 3) at ``times`` (n,) s from 0, and how fast: m/s (n,) and rad/s (n,).

    It stands still for ``still_before`` s at the start and ``still_after`` s at the end.
    """

    times: Array
    poses: Array
    speed: Array
    yaw_rate: Array
    still_before: float
    still_after: float

    @property
    def duration(self) -> float:
        """Seconds from standing still to standing still."""
        return float(self.times[-1])

    def at(self, times: Array) -> Array:
        """Poses (m, 3) at the times (m,)."""
        return geometry.interpolate_poses(self.times, self.poses, times)

    def seen_from(self, pose: Array) -> "Drive":
        """The same drive with its poses given in the frame of ``pose`` (3,)."""
        return replace(self, poses=geometry.between(pose, self.poses))


def drive_along(route: Array, rng: np.random.Generator, config: DriveConfig, duration: float | None = None) -> Drive:
    """Drive along ``route`` (w, 2), or as much of it as fits into ``duration`` s.

    Raises InputError if ``duration`` is too short to drive at all.
    """
    if duration is not None and not duration >= SHORTEST:
        raise InputError(f"a drive of {duration:g} s is too short: the duration must be at least {SHORTEST:g} s")
    before, after = config.still_before, config.still_after
    if duration is not None:
        before, after = min(before, 0.15 * duration), min(after, 0.15 * duration)
    path = smooth_path(route, rng, config)
    hesitation = 1.0 + config.hesitation * _smooth_noise(len(path), 1.5, rng)
    limit = config.cruise * np.clip(hesitation, 0.6, 1.25)
    times, headings = _schedule(path, limit, config)
    if duration is not None and before + times[-1] + after > duration:
        budget, low, high = duration - before - after, 2, len(path)
        while high - low > 1:
            middle = (low + high) // 2
            fits = _schedule(path[:middle], limit[:middle], config)[0][-1] <= budget
            low, high = (middle, high) if fits else (low, middle)
        path = path[:low]
        times, headings = _schedule(path, limit[:low], config)
    total = before + float(times[-1]) + after
    clock = np.arange(round(total * RATE) + 1) / RATE
    on_path = _smoothed(np.interp(clock - before, times, np.arange(len(path))), config.settle * RATE)
    index = np.arange(len(path))
    poses = np.stack([np.interp(on_path, index, v) for v in (path[:, 0], path[:, 1], headings)], axis=-1)
    speed = np.gradient(on_path, clock) * SPACING
    yaw_rate = np.gradient(poses[:, 2], clock)
    poses[:, 2] = geometry.wrap(poses[:, 2])
    return Drive(clock, poses, speed, yaw_rate, before, after)


def smooth_path(route: Array, rng: np.random.Generator, config: DriveConfig) -> Array:
    """(n, 2) positions every SPACING m along the ``route``, corners rounded, wandering a little to both sides."""
    xy = _resample(np.asarray(route, dtype=np.float64))
    along = np.gradient(xy, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], -1) / np.linalg.norm(along, axis=1)[:, None]
    wander = config.wander * _smooth_noise(len(xy), 1.2, rng)
    ramp = np.clip(np.minimum(np.arange(len(xy)), np.arange(len(xy))[::-1]) * SPACING / 1.5, 0.0, 1.0)
    xy = xy + normal * (wander * ramp)[:, None]
    return _resample(np.stack([_smoothed(xy[:, k], config.corner / SPACING) for k in range(2)], axis=-1))


def _schedule(path: Array, limit: Array, config: DriveConfig) -> tuple[Array, Array]:
    """Times (n,) s from 0 and unwrapped headings (n,) along a path that starts and ends at rest."""
    step = np.gradient(path, axis=0)
    headings = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    curvature = np.abs(np.gradient(headings)) / SPACING
    bound = np.minimum(limit[: len(path)], config.yaw_rate / np.maximum(curvature, 1e-6))
    squared = bound**2
    forward, backward = 2.0 * config.acceleration * SPACING, 2.0 * config.braking * SPACING
    squared[0] = squared[-1] = 0.0
    for k in range(1, len(squared)):
        squared[k] = min(squared[k], squared[k - 1] + forward)
    for k in range(len(squared) - 2, -1, -1):
        squared[k] = min(squared[k], squared[k + 1] + backward)
    speed = np.sqrt(squared)
    # Constant acceleration between two samples: the mean of the two speeds.
    times = np.concatenate([[0.0], np.cumsum(2.0 * SPACING / (speed[1:] + speed[:-1]))])
    return times, headings


def _resample(points: Array) -> Array:
    """The polyline through ``points`` (w, 2), sampled every SPACING m from its first point on."""
    points = points[np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 0])]
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.arange(0.0, length[-1], SPACING)
    return np.stack([np.interp(at, length, points[:, k]) for k in range(2)], axis=-1)


def _smoothed(values: Array, width: float) -> Array:
    """``values`` (n,) under a Gaussian of ``width`` samples; both ends are continued straight, so that they stay."""
    pad = int(np.ceil(3 * width))
    head = values[0] + np.arange(-pad, 0) * (values[1] - values[0])
    tail = values[-1] + np.arange(1, pad + 1) * (values[-1] - values[-2])
    kernel = np.exp(-0.5 * (np.arange(-pad, pad + 1) / width) ** 2)
    return np.convolve(np.concatenate([head, values, tail]), kernel / kernel.sum(), mode="valid")


def _smooth_noise(n: int, scale: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """(n,) unit-variance Gaussian noise along a path, correlated over about ``scale`` m."""
    width = scale / SPACING
    kernel = np.exp(-0.5 * (np.arange(-int(3 * width), int(3 * width) + 1) / width) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    return np.convolve(rng.standard_normal(n + len(kernel) - 1), kernel, mode="valid")
