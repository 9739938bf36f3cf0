"""How well an odometry explains what changes from one scan to another: decides between two readings of a recording."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.recording import Lidar

Array = NDArray[np.float64]

PAIRS = 60  # pairs of scans that are compared
BEAMS = 120  # beams of each that are
CLIP = 0.5


@dataclass(frozen=True, slots=True)
class Pairs:
    """Scans ``first`` and ``second`` (p,) that are to be compared."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]

    def __len__(self) -> int:
        return len(self.first)


def pairs_apart(odometry: Array, distance: float = 0.4, turn: float = 0.3) -> Pairs:
    """Up to :data:`PAIRS` pairs between which the ``odometry`` (n, 3) goes ``distance`` m or turns ``turn`` rad.

    Spread over the part of the drive where it moves; a step of odometry that is longer makes a pair by itself.
    """
    gone = np.cumsum(np.hypot(odometry[:, 0], odometry[:, 1]) / distance + np.abs(odometry[:, 2]) / turn)
    if len(gone) == 0 or not 1.0 <= gone[-1] < np.inf:  # steps that overflow when they are summed up tell nothing
        return Pairs(np.zeros(0, np.intp), np.zeros(0, np.intp))
    marks = np.unique(np.linspace(0, np.floor(gone[-1]) - 1, PAIRS).round())
    first = np.minimum(np.searchsorted(gone, marks, side="right"), len(gone) - 2)
    first = np.unique(np.maximum(first - 1, 0))
    second = np.searchsorted(gone, gone[first] + 1.0)
    kept = second < len(gone)
    return Pairs(first[kept], second[kept])


def turned_apart(odometry: Array, turn: float = 0.3) -> Pairs:
    """The same between which the odometry turns by ``turn`` rad, or down to a third of it where it turns but little."""
    turn = float(np.clip(np.abs(odometry[:, 2]).sum() / 20, turn / 3, turn))
    return pairs_apart(odometry * (0.0, 0.0, 1.0), turn=turn)


def disagreement(
    lidar: Lidar,
    ranges: NDArray[np.float32],
    odometry: Array,
    pairs: Pairs,
    poses: Array | None = None,
    scale: float = 1.0,
) -> Array:
    """How far (p,) the second scan of each pair lies off the first one, carried over by the ``odometry`` (n, 3).

    The mean over the beams of |range predicted - range measured|, relative to the range, so that the unit of ranges
    does not matter, and at most :data:`CLIP` each, so that no beam weighs much; NaN where fewer than a tenth of the
    beams can be compared. Along a corridor only the few beams that look ahead tell, so that it is no median.

    ``poses`` (n, 3) may be given instead of summing the odometry up; ``scale`` is the unit of the ranges in m.
    """
    if len(pairs) == 0:
        return np.zeros(0)
    poses = geometry.accumulate(odometry) if poses is None else poses
    motion = geometry.between(poses[pairs.first], poses[pairs.second])
    mount = np.broadcast_to(lidar.pose, motion.shape)
    in_lidar = geometry.between(mount, geometry.compose(motion, mount))
    order = np.argsort(lidar.angles)
    angles = lidar.angles[order]
    beams = np.unique(np.linspace(0, len(angles) - 1, BEAMS).astype(int))
    far = ranges[pairs.second][:, order[beams]] * scale
    near = ranges[pairs.first][:, order] * scale
    facing = in_lidar[:, 2:] + angles[beams]
    x = in_lidar[:, :1] + far * np.cos(facing)
    y = in_lidar[:, 1:2] + far * np.sin(facing)
    middle = 0.5 * (angles[0] + angles[-1])
    direction = middle + geometry.wrap(np.arctan2(y, x) - middle)
    between = 0.5 * (angles[1:] + angles[:-1])
    hit = np.searchsorted(between, direction)
    measured = np.take_along_axis(near, hit, axis=1)
    width = float(np.median(np.diff(angles))) if len(angles) > 1 else 0.0
    seen = (np.abs(direction - angles[hit]) <= width) & _returned(measured, lidar) & _returned(far, lidar)
    off = np.abs(np.hypot(x, y) - measured) / np.where(seen, measured, 1.0)
    count = seen.sum(axis=1)
    result: Array = np.where(seen, np.minimum(off, CLIP), 0.0).sum(axis=1) / np.maximum(count, 1)
    result[count < max(3, 0.1 * len(beams))] = np.nan
    return result


def explains_better(other: Array, given: Array) -> bool:
    """Whether one reading's disagreement (p,) is clearly less than the given one's: in most pairs, and by half.

    Says no where fewer than five pairs can be compared.
    """
    both = np.isfinite(other) & np.isfinite(given)
    if both.sum() < 5:
        return False
    better = (other[both] < given[both]).mean()
    return bool(better > 0.75 and np.median(other[both]) < 0.5 * np.median(given[both]))


def _returned(ranges: NDArray[np.floating], lidar: Lidar) -> NDArray[np.bool_]:
    returned: NDArray[np.bool_] = (ranges >= lidar.range_min) & (ranges <= lidar.range_max)
    return returned
