"""Where a lidar's beams point: angle_min + k * angle_increment, whatever angle_max says."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# The most that the beams of one scan span (rad): a turn, and some for the digits of the increment.
_ONE_TURN = 2.02 * np.pi


def increment_of(arrays: dict[str, NDArray[Any]]) -> float | None:
    """The file's angle_increment, if it is one finite number."""
    value = arrays.get("angle_increment")
    if value is None or value.size != 1 or value.dtype.kind not in "iuf" or not np.isfinite(value).all():
        return None
    return float(value.reshape(-1)[0])


def beam_angles(beams: int, limits: tuple[float, float], increment: float | None, notes: list[str]) -> Array:
    """Angles (``beams``,) rad in the order of the ranges: they decrease where a lidar turns clockwise.

    ``limits`` are angle_min and angle_max, those of the first and the last beam. Where ``increment`` makes another
    angle_max (2 pi is often given for a lidar that looks all around, one increment too many), it is believed as long as
    the beams then go round at most once; else the beams are spread over the limits. ``notes`` get what disagreed.
    """
    angle_min, angle_max = limits
    spread: Array = np.linspace(angle_min, angle_max, beams)
    if beams == 1 or increment is None:
        return spread
    if increment == 0 or (beams - 1) * abs(increment) > _ONE_TURN:
        notes.append(f"lidar: angle_increment {increment:g} rad cannot be; {beams} beams spread over the angle limits")
        return spread
    if (angle_max - angle_min) * increment < 0:
        notes.append(
            f"lidar: the angle limits run from {angle_min:g} to {angle_max:g} rad, but angle_increment is"
            f" {increment:g}; taken from angle_min on in the limits' direction"
        )
        increment = -increment
    expected = (angle_max - angle_min) / increment + 1
    if abs(expected - beams) < 0.25:  # the limits are written with more digits than the increment
        return spread
    last = angle_min + (beams - 1) * increment
    notes.append(
        f"lidar: angle_max {angle_max:g} rad would make {expected:.0f} beams; ranges has {beams}, so the last is taken"
        f" at {last:g} rad, by angle_increment"
    )
    return angle_min + increment * np.arange(beams, dtype=np.float64)
