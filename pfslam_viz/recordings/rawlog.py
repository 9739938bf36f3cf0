"""MRPT's ``.rawlog``, plain or gzipped: 2-D laser scans with odometry observations or movements between frames."""

import math
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.beam_grid import has_usable_beams, on_one_grid
from pfslam_viz.recordings.rawlog_bytes import Malformed, first_class
from pfslam_viz.recordings.rawlog_objects import Collection, Movement, Odometry, Scan, other_classes, read_objects
from pfslam_viz.recordings.recording import Lidar, Recording, Stream
from pfslam_viz.recordings.stamps import order, spread_repeats
from pfslam_viz.recordings.unpacking import GZIP, read_file

Array = NDArray[np.float64]

_RANGE_MIN = 0.05
# How far from level a scanner may lie for its scans to be taken as horizontal: cos 10 degrees.
_LEVEL = math.cos(math.radians(10.0))
# Seconds between scans of a log without time stamps.
_SPACING = 0.1


@dataclass(slots=True)
class _Log:
    """What a log holds, in its order: scans, each with the sum of the movements before it, and odometry."""

    scans: list[Scan] = field(default_factory=list)
    moved: list[Array] = field(default_factory=list)
    odometry: list[Odometry] = field(default_factory=list)
    movements: int = 0
    broken: Counter[str] = field(default_factory=Counter)


def claims(path: Path) -> bool:
    """Whether a file is called like a rawlog: NAME.rawlog, perhaps with .gz behind."""
    return path.name.lower().endswith((".rawlog", ".rawlog.gz"))


def looks_like(path: Path) -> bool:
    """Whether a file begins with an object as MRPT writes them."""
    try:
        with path.open("rb") as file:
            head = file.read(1 << 12)
        if head.startswith(GZIP):
            head = zlib.decompressobj(wbits=31).decompress(head, 1 << 10)
    except (OSError, EOFError, zlib.error):
        return False
    return first_class(head) is not None


def load(path: Path, name: str | None = None) -> Recording:
    """Read one log, of frames (CActionCollection, CSensoryFrame) or of observations one after the other.

    Scans are CObservation2DRangeScan objects, of the sensor label that has most; beams without a valid range have no
    return. The odometry is that of CObservationOdometry objects, interpolated at the scans' stamps, else the movements
    (CActionRobotMovement2D) between the frames. The lidar's place is the scans' own sensor pose.

    Raises:
        InputError: the file is missing, damaged, no rawlog, or holds no usable scans.
    """
    data = _read(path)
    notes: list[str] = []
    log = _collect(data)
    scans, moved = _choose(log, data, path, notes)
    stamps = _stamps(scans, notes)
    kept = order(stamps, "lidar", notes)
    scans, moved = [scans[k] for k in kept.tolist()], moved[kept]
    if len(kept) and np.any(np.diff(stamps[kept]) == 0):
        notes.append("lidar: scans repeat the stamp before; spread up to the next stamp")
    stamps = spread_repeats(stamps[kept])
    poses, streams = _robot_poses(log, stamps, moved, notes)
    steps = np.zeros((len(poses), 3))
    steps[1:] = geometry.between(poses[:-1], poses[1:])
    starts = np.array([scan.start for scan in scans])
    resolutions = np.array([scan.resolution for scan in scans])
    angles, ranges = on_one_grid(starts, resolutions, [scan.ranges for scan in scans], notes)
    limits = [scan.max_range for scan in scans if _RANGE_MIN < scan.max_range < 1e4]
    range_max = float(np.median(limits)) if limits else 80.0
    bare = path.name[: -len(".gz")] if path.name.lower().endswith(".gz") else path.name
    return Recording(
        name=name or Path(bare).stem,
        format="rawlog",
        path=path,
        stamps=stamps,
        ranges=ranges,
        lidar=Lidar(angles, _RANGE_MIN, range_max, _mount(scans, notes), height=float(scans[0].height)),
        odometry=steps,
        notes=tuple(notes),
        streams=(Stream("lidar", stamps), *streams),
    )


def _read(path: Path) -> bytes:
    data = read_file(path)
    if not data:
        raise InputError(f"{path}: empty")
    if first_class(data) is None:
        raise InputError(f"{path}: not a rawlog: it does not begin with an object as MRPT writes them")
    return data


def _collect(data: bytes) -> _Log:
    """All that is of use, with the movements summed up: a collection's movements are alternatives for one step."""
    log = _Log()
    pose = np.zeros(3)
    pending: list[Movement] = []
    for item in read_objects(data):
        if isinstance(item, Movement):
            pending.append(item)
            log.movements += 1
        elif isinstance(item, Odometry):
            log.odometry.append(item)
        elif isinstance(item, Malformed):
            log.broken[str(item)] += 1
        else:
            if pending:
                best = next((move for move in pending if move.by_odometry), pending[0])
                pose = geometry.compose(pose, best.increment)
                pending = []
            if isinstance(item, Scan):
                log.scans.append(item)
                log.moved.append(pose)
            else:
                assert isinstance(item, Collection)
    return log


def _choose(log: _Log, data: bytes, path: Path, notes: list[str]) -> tuple[list[Scan], Array]:
    """The usable scans of the label that has most, and the poses (n, 3) that the movements give them."""
    others = ", ".join(f"{n} {kind}" for kind, n in other_classes(data).items())
    if not log.scans:
        has = f"; it has {others}" if others else ""
        raise InputError(f"{path}: holds no laser scans (CObservation2DRangeScan){has}")
    if log.broken:
        why = ", ".join(f"{n} {reason}" for reason, n in log.broken.items())
        notes.append(f"{sum(log.broken.values())} objects could not be read and are left out ({why})")
    if others:
        notes.append(f"not used: {others}")
    level = [abs(scan.level) > _LEVEL for scan in log.scans]
    if not any(level):
        raise InputError(f"{path}: all laser scans are tilted by more than 10 degrees; a level one is needed")
    if not all(level):
        notes.append(f"lidar: {level.count(False)} scans of a tilted scanner left out")
    labels = Counter(scan.label for scan, good in zip(log.scans, level, strict=True) if good)
    label = labels.most_common(1)[0][0]
    for other, count in labels.items():
        if other != label:
            notes.append(f"lidar: {count} scans of '{other}' are not used: the scans are taken from '{label}'")
    starts = np.array([scan.start for scan in log.scans])
    resolutions = np.array([scan.resolution for scan in log.scans])
    beams = np.array([len(scan.ranges) for scan in log.scans])
    usable = has_usable_beams(starts, resolutions, beams)
    kept = [k for k, scan in enumerate(log.scans) if level[k] and usable[k] and scan.label == label]
    if not kept:
        raise InputError(f"{path}: no scan has usable beam angles")
    return [log.scans[k] for k in kept], np.array([log.moved[k] for k in kept])


def _stamps(scans: Sequence[Scan], notes: list[str]) -> Array:
    """The scans' stamps (n,) in s, NaN where a scan has none; made up if no scan has one."""
    stamps = np.array([scan.stamp if scan.stamp is not None else math.nan for scan in scans])
    if np.isnan(stamps).all():
        notes.append(f"lidar: the scans carry no time stamps; taken as {_SPACING} s apart")
        return _SPACING * np.arange(len(scans), dtype=np.float64)
    return stamps


def _robot_poses(log: _Log, stamps: Array, moved: Array, notes: list[str]) -> tuple[Array, list[Stream]]:
    """The robot's poses (n, 3) by odometry at the scans' ``stamps`` (n,), and the odometry's own stream."""
    timed = [(reading.stamp, reading.pose) for reading in log.odometry if reading.stamp is not None]
    if timed:
        times, poses = np.array([stamp for stamp, _ in timed]), np.array([pose for _, pose in timed])
        kept = order(times, "odometry", notes)
        times, poses = times[kept], poses[kept]
        if log.movements:
            notes.append(f"odometry: {log.movements} movements are not used: it is taken from CObservationOdometry")
        first = np.append(True, np.diff(times) > 0)
        return geometry.interpolate_poses(times[first], poses[first], stamps), [Stream("odometry", times)]
    if not log.movements:
        notes.append("odometry: the log holds none (no CObservationOdometry, no CActionRobotMovement2D)")
    return moved, []


def _mount(scans: Sequence[Scan], notes: list[str]) -> Array:
    """The lidar's pose (3,) on the robot: the median of the scans' own."""
    poses = np.array([scan.pose for scan in scans])
    place = np.median(poses, axis=0)
    turn = geometry.wrap(poses[:, 2] - poses[0, 2])
    place[2] = float(geometry.wrap(poses[0, 2] + np.median(turn)))
    if np.ptp(poses[:, :2], axis=0).max() > 0.02 or np.ptp(turn) > 0.02:
        notes.append("lidar: its place on the robot differs from scan to scan; the median is taken")
    rounded: Array = np.round(place, 6) + 0.0
    return rounded
