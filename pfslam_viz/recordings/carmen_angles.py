"""In which direction a CARMEN log's beams look: what its PARAM lines declare, clockwise lasers, angles in degrees.

FLASER lines hold no angles. Where PARAM lines tell them (``laser_front_laser_resolution``, ``laser_front_laser_fov``,
``laser_laser1_resolution`` and relatives), they are taken; CARMEN itself writes degrees, other programs radians, so the
unit is the one that gives the scan a possible width.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from pfslam_viz.recordings.carmen_layouts import Scans, front_laser_grid

Value = TypeVar("Value", float, str)

_TURN = 2 * math.pi
# PARAM names of one laser: laser_front_laser_X, laser_frontlaser_X, robot_frontlaser_X, front_laser_X, laser_laser1_X.
_FRONT = re.compile(r"^(?:(?:laser|robot)_)?(?:front_?laser|laser1)_(\w+)$")
_REAR = re.compile(r"^(?:(?:laser|robot)_)?(?:rear_?laser|laser2)_(\w+)$")
_NAMES = {
    "resolution": ("resolution", "angular_resolution", "angle_resolution", "angle_increment"),
    "fov": ("fov", "field_of_view", "angular_range", "angle_range"),
    "start": ("start_angle", "angle_min"),
}
# SICK's LMS and PLS see at most half a turn, and their 180, 181, 360 or 361 beams are always all of it.
_HALF_TURN = ("LMS", "PLS", "SICK_LMS", "SICK_PLS")
_HALF_TURN_BEAMS = (180, 181, 360, 361)


def of_laser(parameters: Mapping[str, Value], rear: bool = False) -> dict[str, Value]:
    """The PARAMs of one laser by what comes behind its name: ``{"resolution": 1.0, "offset": 0.2}``."""
    pattern = _REAR if rear else _FRONT
    return {match[1]: value for name, value in parameters.items() if (match := pattern.match(name))}


def with_declared_angles(
    scans: Scans, parameters: Mapping[str, float], words: Mapping[str, str], rear: bool, notes: list[str]
) -> Scans:
    """The scans with the beam angles that the log's PARAM lines declare, if they do.

    ``scans`` come from a message without angles of its own; they stay as they are where PARAM is silent or impossible.
    """
    mine = of_laser(parameters, rear)
    declared = {what: _first(mine, names) for what, names in _NAMES.items()}
    if declared["resolution"] is None and declared["fov"] is None:
        return scans
    half_turn = of_laser(words, rear).get("type", "").upper().startswith(_HALF_TURN)
    start, resolution = scans.start.copy(), scans.resolution.copy()
    told: set[str] = set()
    for beams in np.unique(scans.beams).tolist():
        if beams < 2 or (half_turn and beams in _HALF_TURN_BEAMS):
            continue
        grid = declared_grid(beams, declared["resolution"], declared["fov"], declared["start"])
        if grid is None:
            told.add(f"lidar: the PARAM lines' beam angles are impossible for {beams} beams and are not used")
        elif not np.allclose(grid, front_laser_grid(beams), rtol=0.0, atol=1e-6):
            rows = scans.beams == beams
            start[rows], resolution[rows] = grid
            first, step = math.degrees(grid[0]), math.degrees(grid[1])
            told.add(
                f"lidar: by the log's PARAM lines its {beams} beams lie {abs(step):.4g}° apart, from {first:.5g}° to"
                f" {first + (beams - 1) * step:.5g}°"
            )
    notes.extend(sorted(told))
    return replace(scans, start=start, resolution=resolution)


def declared_grid(
    beams: int, resolution: float | None, fov: float | None, start: float | None = None
) -> tuple[float, float] | None:
    """First angle and resolution in rad from what PARAM lines say in degrees or radians; None if it cannot be.

    A field of view up to 2π is in radians, a larger one in degrees. The resolution is in the unit in which it fits the
    field of view, or, alone, in radians if all beams then lie within a turn. n beams at resolution r span (n - 1) r or,
    counted as some drivers do, n r. Where the two contradict each other the resolution counts. Without a start angle
    the middle of the field of view looks ahead.
    """
    width = None if not fov else _radians(abs(fov))
    if width is not None and width > _TURN * 1.01:
        width = None
    if width is not None and abs(width - _TURN) < 0.02:
        width = _TURN
    step = None if not resolution else _step(beams, abs(resolution), width)
    if step is None and width is None:
        return None
    if step is None:
        assert width is not None
        step = width / beams if width == _TURN or _is_round(width / beams) else width / (beams - 1)
    spans = (step * (beams - 1), step * beams)
    if width is None or min(abs(width - span) for span in spans) > max(step, 0.02 * width):
        width = spans[1] if beams % 2 == 0 and _is_quarter(spans[1]) else spans[0]
    first = -width / 2 if start is None else _radians(start)
    return (-first if start is None else first, -step) if (resolution or 0.0) < 0 else (first, step)


def with_degrees_mended(scans: Scans, notes: list[str]) -> Scans:
    """Scans whose line gives their angles in degrees (resolution 0.5, start -90), in radians."""
    with np.errstate(invalid="ignore"):
        span = np.abs(scans.resolution) * (scans.beams - 1)
        wrong = (span > _TURN + 0.1) & (span < 361.0) & (np.abs(scans.start) <= 360.0) & (scans.beams > 10)
    if not wrong.all():
        return scans
    notes.append("lidar: the scans' beam angles are taken as degrees: in radians they would go round several times")
    return replace(scans, start=np.radians(scans.start), resolution=np.radians(scans.resolution))


def counter_clockwise(scans: Scans, notes: list[str]) -> Scans:
    """Scans of negative resolution as their mirror: the last beam first."""
    with np.errstate(invalid="ignore"):
        clockwise = scans.resolution < 0
    if not clockwise.any():
        return scans
    count = "all" if clockwise.all() else str(int(clockwise.sum()))
    notes.append(f"lidar: {count} scans run clockwise; read from their last beam")
    last = scans.start + scans.resolution * (scans.beams - 1)
    return replace(
        scans,
        start=np.where(clockwise, last, scans.start),
        resolution=np.abs(scans.resolution),
        ranges=[r[::-1] if back else r for r, back in zip(scans.ranges, clockwise.tolist(), strict=True)],
    )


def _first(values: Mapping[str, float], names: Iterable[str]) -> float | None:
    return next((values[name] for name in names if name in values), None)


def _radians(angle: float) -> float:
    """An angle in rad of one that is in degrees if it is more than a turn in radians."""
    return math.radians(angle) if abs(angle) > _TURN * 1.001 else angle


def _step(beams: int, resolution: float, width: float | None) -> float | None:
    """The resolution in rad; None if neither unit is possible."""
    candidates = [r for r in (resolution, math.radians(resolution)) if r * (beams - 1) <= _TURN * 1.003]
    if not candidates:
        return None
    if width is None:
        return candidates[0]
    return min(candidates, key=lambda r: min(abs(r * (beams - 1) - width), abs(r * beams - width)))


def _is_round(step: float) -> bool:
    """Whether an angle in rad is a multiple of 0.05° or of a third of a degree."""
    degrees = math.degrees(step)
    return any(abs(degrees / part - round(degrees / part)) < 1e-3 for part in (0.05, 1 / 3))


def _is_quarter(width: float) -> bool:
    return abs(math.degrees(width) / 45.0 - round(math.degrees(width) / 45.0)) < 1e-3
