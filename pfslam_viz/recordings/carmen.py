"""CARMEN logs: FLASER, ROBOTLASER1 and GMapping's LASER_READING, a message a line; plain, .gz or .bz2.

Scans are sorted by the ipc time stamp. The laser's beams are of one grid of angles for the whole log; a scan with fewer
beams than the widest has no return in those it lacks.
"""

import bz2
import io
import re
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.files import read_small
from pfslam_viz.recordings.beam_grid import has_usable_beams, on_one_grid
from pfslam_viz.recordings.carmen_angles import (
    counter_clockwise,
    of_laser,
    with_declared_angles,
    with_degrees_mended,
)
from pfslam_viz.recordings.carmen_layouts import Scans
from pfslam_viz.recordings.carmen_lines import REAR, Messages, plain_text, read_messages
from pfslam_viz.recordings.carmen_mount import mount
from pfslam_viz.recordings.carmen_stamps import unwrapped, wrap_period
from pfslam_viz.recordings.recording import Lidar, Recording, Relations, Stream
from pfslam_viz.recordings.stamps import order, spread_repeats
from pfslam_viz.recordings.unpacking import BZIP2, GZIP, SURE, is_plain, read_file

Array = NDArray[np.float64]

SUFFIXES = (".log", ".clf", ".gfs")
COMPRESSED = (".gz", ".bz2")
_MESSAGE = re.compile(
    rb"^\s*(FLASER|RLASER|REARLASER|ROBOTLASER[12]|RAWLASER[12]|LASER_READING|ODOM|PARAM|# message_name)[ \t]",
    re.MULTILINE,
)

# SICK LMS scanners, which nearly all of these logs come from, say "no return" by error codes of 81.83 to 81.91 m.
_LMS_ERROR_CODES = (81.8, 82.0)
_LMS_RANGE = 80.0
# What PARAM lines call the range in m from which on a reading is none, behind the laser's name.
_MAX_RANGE = ("max", "max_range", "maximum_range", "range_max")
# A reading nearer than this (m) is the scanner's own error code, or its window.
_RANGE_MIN = 0.05


def is_log(path: Path) -> bool:
    """Whether a file is called like a CARMEN log: NAME.log, .clf or .gfs, perhaps with .gz or .bz2 behind."""
    return _split(path)[1] != ""


def log_name(path: Path) -> str:
    """``intel`` for ``intel.clf.bz2``."""
    return _split(path)[0]


def looks_like_log(path: Path) -> bool:
    """Whether the beginning of a file has a line that starts like a message of CARMEN's."""
    try:
        with path.open("rb") as file:
            head = file.read(1 << 20)
        if head.startswith(BZIP2):
            head = bz2.BZ2Decompressor().decompress(head, 1 << 18)
        elif head.startswith(GZIP):
            head = zlib.decompressobj(wbits=31).decompress(head, 1 << 18)
    except (OSError, EOFError, zlib.error):
        return False
    return _MESSAGE.search(plain_text(head[: len(head) & ~1])) is not None


def load(path: Path, name: str | None = None) -> Recording:
    """Read one log, and ``NAME.relations`` beside it if there is one.

    The odometry is that of the robot (FLASER's odom_*, ROBOTLASER1's robot pose); the lidar's place on the robot is
    ROBOTLASER1's, or PARAM robot_frontlaser_offset (and _side_offset, _angular_offset). FLASER does not give angles:
    180 and 181 beams are 1 degree apart, 360 and 361 half a degree, from -90 degrees; other counts span 180 degrees.

    Raises:
        InputError: the file is missing or damaged, or holds no scans.
    """
    notes: list[str] = []
    messages = read_messages(plain_text(_read(path)))
    if messages.unreadable:
        notes.append(f"{messages.unreadable} lines could not be read and are left out")
    kind, scans = _choose(messages, path, notes)
    scans, odometry_lines = _running_on(scans, messages.odometry, notes)
    logged = geometry.path_length(scans.robot)
    scans = scans.take(order(scans.stamps, "lidar", notes))
    if (in_order := geometry.path_length(scans.robot)) > 1.05 * logged:
        notes.append(
            f"odometry: its path is {logged:.0f} m in the order of the lines and {in_order:.0f} m by time stamp; the"
            " stamps are rougher than the lines' order"
        )
    if len(scans.stamps) == 0:
        raise InputError(f"{path}: no scan has a valid time stamp")
    scans = _without_repeats(scans, notes)
    poses = _robot_poses(scans, odometry_lines, notes)
    if not scans.own_angles:
        scans = with_declared_angles(scans, messages.parameters, messages.words, kind in REAR, notes)
    scans = counter_clockwise(with_degrees_mended(scans, notes), notes)
    usable = has_usable_beams(scans.start, scans.resolution, scans.beams)
    if not usable.any():
        raise InputError(f"{path}: no scan has usable beam angles")
    if not usable.all():
        notes.append(f"lidar: {int((~usable).sum())} scans with impossible beam angles left out")
        scans, poses = scans.take(np.flatnonzero(usable)), poses[usable]
    angles, ranges = on_one_grid(scans.start, scans.resolution, scans.ranges, notes)
    if bad := int((~np.isfinite(ranges)).sum()):
        notes.append(f"lidar: {bad} ranges that are NaN or infinite taken as no return")
        ranges[~np.isfinite(ranges)] = 0.0
    of_parameters = of_laser(messages.parameters, kind in REAR)
    pose = mount(scans, messages.parameters, kind in REAR, notes)
    steps = np.zeros((len(poses), 3))
    steps[1:] = geometry.between(poses[:-1], poses[1:])
    streams = [Stream("lidar", scans.stamps)]
    if len(odometry_lines):
        stamps = odometry_lines[:, 3]
        streams.append(Stream("odometry", stamps[order(stamps, "odometry", notes)]))
    return Recording(
        name=name or log_name(path),
        format="carmen",
        path=path,
        stamps=scans.stamps,
        ranges=ranges,
        lidar=Lidar(angles, _RANGE_MIN, _range_max(scans, of_parameters), pose),
        odometry=steps,
        relations=_read_relations(path, notes),
        notes=tuple(notes),
        streams=tuple(streams),
    )


def _split(path: Path) -> tuple[str, str]:
    """The name and the format's suffix, or ``""``, of a log's file name."""
    bare = path.name[: -len(path.suffix)] if path.suffix.lower() in COMPRESSED else path.name
    suffix = Path(bare).suffix
    return (bare[: -len(suffix)], suffix) if suffix.lower() in SUFFIXES else (bare, "")


def _read(path: Path) -> bytes:
    """The text of a log, unpacked."""
    if path.suffix.lower() in COMPRESSED and is_plain(path):
        raise InputError(f"{path}: not a {path.suffix} file; get it again")
    data = read_file(path, lines=True)
    if not data.strip():
        raise InputError(f"{path}: empty")
    return data


def _choose(messages: Messages, path: Path, notes: list[str]) -> tuple[str, Scans]:
    """The message type that the log has most of, and its scans: several types are the same scanner logged twice."""
    kinds = messages.scans
    if messages.decimal_commas:
        raise InputError(f"{path}: numbers are written with decimal commas (1,5); write them with points")
    if not kinds:
        others = ", ".join(f"{n} {kind}" for kind, n in messages.not_read.items())
        has = f"; it has {others} lines, which cannot be read" if others else ""
        raise InputError(f"{path}: holds no scans (no FLASER, ROBOTLASER1, LASER_READING or RAWLASER1 lines{has})")
    best = max(kinds, key=lambda kind: len(kinds[kind].stamps))
    for kind in kinds:
        if kind != best:
            notes.append(f"{len(kinds[kind].stamps)} {kind} lines are not used: the scans are taken from {best}")
    for kind, count in messages.not_read.items():
        notes.append(f"{count} {kind} lines are not used: the scans are taken from {best}")
    return best, kinds[best]


def _running_on(scans: Scans, odometry: Array, notes: list[str]) -> tuple[Scans, Array]:
    """Scans and ODOM lines (m, 4) whose stamps run on where a 32-bit counter started again."""
    periods = [period for stamps in (scans.stamps, odometry[:, 3]) if (period := wrap_period(stamps))]
    if not periods:
        return scans, odometry
    stamps = unwrapped(scans.stamps, periods[0])
    odometry = odometry.copy()
    odometry[:, 3] = unwrapped(odometry[:, 3], periods[0], like=float(stamps[np.isfinite(stamps)][0]))
    notes.append(
        f"time stamps start again after {periods[0]:.3f} s, as a 32-bit counter does; taken in the order of the lines,"
        " later ones moved on by as much"
    )
    return scans.at(stamps), odometry


def _without_repeats(scans: Scans, notes: list[str]) -> Scans:
    """Scans logged twice left out, others of equal stamp moved apart."""
    same = np.flatnonzero(np.diff(scans.stamps) == 0) + 1
    if len(same) == 0:
        return scans
    copies = [k for k in same if np.array_equal(scans.ranges[k], scans.ranges[k - 1])]
    if copies:
        notes.append(f"lidar: {len(copies)} scans logged twice left out")
        scans = scans.take(np.setdiff1d(np.arange(len(scans.stamps)), copies))
    if len(copies) < len(same):
        notes.append(f"lidar: {len(same) - len(copies)} scans repeat the stamp before; spread up to the next stamp")
    return scans.at(spread_repeats(scans.stamps))


def _robot_poses(scans: Scans, lines: Array, notes: list[str]) -> Array:
    """The robot's raw odometry at every scan (n, 3); from the ODOM lines when the scans carry none."""
    if not np.isfinite(scans.robot).all():
        good = np.atleast_1d(np.isfinite(scans.robot).all(axis=1))
        notes.append(f"odometry: {int((~good).sum())} poses that are no numbers; the last one before is held")
        held = np.maximum.accumulate(np.where(good, np.arange(len(good)), 0))
        scans.robot[:] = np.nan_to_num(scans.robot[held])
    odometry = lines[np.isfinite(lines).all(axis=1)]
    still = len(scans.robot) > 1 and not np.ptp(scans.robot, axis=0).any()
    if still and len(odometry) and np.ptp(odometry[:, :3], axis=0).any():
        notes.append("odometry: the scans carry none; interpolated from the ODOM lines")
        odometry = odometry[np.argsort(odometry[:, 3], kind="stable")]
        return geometry.interpolate_poses(odometry[:, 3], odometry[:, :3], scans.stamps)
    return scans.robot


def _range_max(scans: Scans, parameters: dict[str, float]) -> float:
    """The range in m above which a reading is no return.

    What the log declares (ROBOTLASER1's max_range, PARAM robot_front_laser_max), else 80 m, an LMS's range. Below the
    LMS's error codes in any case. Other values that stand for no return are told from the readings, as for every
    format: see :mod:`pfslam_viz.recordings.no_return`.
    """
    declared = scans.max_range[np.isfinite(scans.max_range) & (scans.max_range > 0)]
    if len(declared):
        limit = float(np.median(declared))
    else:
        limit = next((parameters[key] for key in _MAX_RANGE if key in parameters), 0.0)
    return _LMS_RANGE if limit <= 0 or _LMS_ERROR_CODES[0] <= limit <= _LMS_ERROR_CODES[1] else limit


def _read_relations(path: Path, notes: list[str]) -> Relations | None:
    """``NAME.relations`` beside the log: ``t1 t2 x y z roll pitch yaw`` a line."""
    beside = path.with_name(f"{log_name(path)}.relations")
    if not beside.exists():
        return None
    try:
        table = np.loadtxt(io.BytesIO(read_small(beside, SURE)), dtype=np.float64, ndmin=2)
    except (OSError, ValueError):
        table = np.zeros((0, 0))
    if table.shape[1] != 8 or len(table) == 0 or not np.isfinite(table).all():
        notes.append(f"relations: {beside.name} is damaged (t1 t2 x y z roll pitch yaw a line is expected); left out")
        return None
    return Relations(start=table[:, 0], end=table[:, 1], poses=table[:, [2, 3, 7]])
