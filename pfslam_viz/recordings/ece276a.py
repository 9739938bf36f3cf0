"""The course's sets: EncodersN.npz, HokuyoN.npz, ImuN.npz and, if there, KinectN.npz with dataRGBD/.

All streams are brought to the lidar's stamps. The files may lie in the folder given or in ``data/`` below it, several
sets together; ``dataRGBD/`` may lie beside them or up to two folders above.
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError
from pfslam_viz.recordings import npz
from pfslam_viz.recordings.beam_angles import beam_angles, increment_of
from pfslam_viz.recordings.checking import units
from pfslam_viz.recordings.ece276a_frames import KINECT, read_frames
from pfslam_viz.recordings.recording import Lidar, Recording, Stream, Trajectory
from pfslam_viz.recordings.robot_beside import robot_of
from pfslam_viz.recordings.stamps import distinct_scans, order
from pfslam_viz.recordings.wheel_odometry import WheelOdometry
from pfslam_viz.robot import Robot

Array = NDArray[np.float64]

REQUIRED = ("Encoders", "Hokuyo", "Imu")
_FILE = re.compile(rf"({'|'.join(REQUIRED)}|{KINECT})(\d+)\.npz")
# A sensor that starts later or ends earlier than the lidar by more than this (s) is worth a note.
_SLACK = 0.1


def set_number(path: Path) -> str | None:
    """The set that a file belongs to by its name: ``"21"`` for ``Hokuyo21.npz``, None for other files."""
    match = _FILE.fullmatch(path.name)
    return match[2] if match else None


def sets_in(folder: Path) -> dict[str, set[str]]:
    """The sets that have files in this very folder, and which: ``{"21": {"Encoders", "Imu"}}``."""
    sets: dict[str, set[str]] = {}
    try:
        names = sorted(os.listdir(folder))  # noqa: PTH208 - names are all that is needed
    except OSError:
        return sets
    for name in names:
        if match := _FILE.fullmatch(name):
            sets.setdefault(match[2], set()).add(match[1])
    return sets


def find_set(folder: Path, number: str) -> Path | None:
    """The folder with files of set ``number``: ``folder`` or ``folder/data``; the more complete one."""
    candidates = [(len(sets_in(place).get(number, ())), place) for place in (folder, folder / "data")]
    files, place = max(candidates, key=lambda candidate: candidate[0])
    return place if files else None


def missing_files(folder: Path, number: str) -> list[str]:
    """Names of the files that set ``number`` in this very folder lacks to be replayed."""
    return [f"{kind}{number}.npz" for kind in REQUIRED if kind not in sets_in(folder).get(number, ())]


def locate(path: Path, number: str | None = None) -> tuple[Path, str]:
    """The folder of a set's files and the set's number, from any path that stands for one set.

    ``path`` is a folder or one of a set's files. Raises InputError when there is no set, or more than one and
    ``number`` does not choose.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_file():
        found = set_number(path)
        if found is None:
            raise InputError(f"{path}: not a file of a set, which are called like Hokuyo21.npz")
        return path.parent, number or found
    if number is None:
        numbers = sorted({n for place in (path, path / "data") for n in sets_in(place)}, key=int)
        if not numbers:
            raise InputError(f"{path}: holds no set (Encoders21.npz, Hokuyo21.npz, Imu21.npz or another number)")
        if len(numbers) > 1:
            example = path / f"Hokuyo{numbers[0]}.npz"
            raise InputError(f"{path}: holds the sets {', '.join(numbers)}; choose one, such as {example}")
        number = numbers[0]
    place = find_set(path, number)
    if place is None:
        raise InputError(f"{path}: holds no file of set {number} (Hokuyo{number}.npz and others)")
    return place, number


def load(path: Path, number: int | str | None = None, robot: Robot | None = None, name: str | None = None) -> Recording:
    """Read one set.

    Args:
        path: a folder (see the module's text) or one of a set's files, such as Hokuyo21.npz.
        number: which set, if the folder holds several.
        robot: its geometry; by default ``robot.toml`` beside the files, else the course's robot.
        name: what to call the recording; the set's number by default.

    Raises:
        InputError: a file is missing, damaged, lacks a key, or holds arrays that do not fit each other.
    """
    folder, set_name = locate(path, None if number is None else str(number))
    if missing := missing_files(folder, set_name):
        raise InputError(f"{folder}: set {set_name} lacks {', '.join(missing)}")
    robot = robot or robot_of(folder, set_name)
    notes: list[str] = []
    scans = _read_scans(folder / f"Hokuyo{set_name}.npz", robot, notes)
    sensors = read_sensors(folder, set_name, robot)
    notes += sensors.notes
    gyro = sensors.odometry.gyro_stamps
    unit = units.unit_like(scans.stamps, float(gyro[0]), float(gyro[-1]))
    stamps = scans.stamps * unit
    first, last = float(stamps[0]), float(stamps[-1])
    notes += _held(sensors.odometry, first, last)
    frames, frame_streams = read_frames(folder, set_name, robot, notes)
    if unit != 1.0:
        frames = frames and frames.scaled(unit)
        frame_streams = tuple(stream.scaled(unit) for stream in frame_streams)
    return Recording(
        name=name or set_name,
        format="ece276a",
        path=folder,
        stamps=stamps,
        ranges=scans.ranges,
        lidar=scans.lidar,
        odometry=sensors.odometry.increments(stamps),
        frames=frames,
        truth=_read_truth(folder, set_name, first, last, notes),
        notes=tuple(notes),
        streams=(Stream("lidar", stamps), *sensors.streams, *frame_streams),
        findings=units.converted({"lidar": unit, **sensors.units}),
    )


@dataclass(frozen=True, slots=True)
class Sensors:
    """Encoders and IMU of one set; there is no lidar in it.

    ``streams`` are their stamps in s; ``units`` are how many seconds each of them had been written in.
    """

    odometry: WheelOdometry
    streams: tuple[Stream, Stream]
    notes: tuple[str, ...]
    units: dict[str, float]


def read_sensors(folder: Path, number: str, robot: Robot) -> Sensors:
    """Read encoders and IMU alone: all that dead reckoning needs. ``folder`` holds the files themselves."""
    notes: list[str] = []
    path = folder / f"Encoders{number}.npz"
    arrays = npz.read_arrays(path, ["counts", "time_stamps"])
    wheel_stamps = npz.vector(arrays, "time_stamps", path)
    counts = npz.matrix(arrays, "counts", path, 4, len(wheel_stamps)).astype(np.float64)
    kept = order(wheel_stamps, "encoders", notes)
    wheel_stamps, counts = wheel_stamps[kept], counts[:, kept]
    _require_samples(path, wheel_stamps)
    if bad := int((~np.isfinite(counts)).any(axis=0).sum()):
        notes.append(f"encoders: {bad} readings that are no numbers taken as 0 ticks")
        counts = np.where(np.isfinite(counts), counts, 0.0)

    path = folder / f"Imu{number}.npz"
    arrays = npz.read_arrays(path, ["angular_velocity", "time_stamps"])
    gyro_stamps = npz.vector(arrays, "time_stamps", path)
    yaw_rate = npz.matrix(arrays, "angular_velocity", path, 3, len(gyro_stamps))[2].astype(np.float64)
    finite = np.isfinite(yaw_rate)
    if not finite.all():
        notes.append(f"IMU: {int((~finite).sum())} yaw rates that are no numbers left out")
        gyro_stamps, yaw_rate = gyro_stamps[finite], yaw_rate[finite]
    kept = order(gyro_stamps, "IMU", notes)
    gyro_stamps, yaw_rate = gyro_stamps[kept], yaw_rate[kept]
    _require_samples(path, gyro_stamps)
    gyro_unit = units.gyro_unit(gyro_stamps)
    gyro_stamps = gyro_stamps * gyro_unit
    wheel_unit = units.unit_like(wheel_stamps, float(gyro_stamps[0]), float(gyro_stamps[-1]))
    wheel_stamps = wheel_stamps * wheel_unit
    odometry = WheelOdometry.from_sensors(wheel_stamps, counts, robot.meters_per_tick, gyro_stamps, yaw_rate)
    streams = (Stream("encoders", wheel_stamps), Stream("IMU", gyro_stamps))
    return Sensors(odometry, streams, tuple(notes), {"encoders": wheel_unit, "IMU": gyro_unit})


@dataclass(frozen=True, slots=True)
class _Scans:
    stamps: Array
    ranges: NDArray[np.float32]
    lidar: Lidar


def _read_scans(path: Path, robot: Robot, notes: list[str]) -> _Scans:
    limits = ("angle_min", "angle_max", "range_min", "range_max")
    arrays = npz.read_arrays(path, ["ranges", "time_stamps", *limits], ["angle_increment"])
    stamps = npz.vector(arrays, "time_stamps", path)
    angle_min, angle_max, range_min, range_max = (npz.scalar(arrays, key, path) for key in limits)
    increment = increment_of(arrays)
    if (angle_min == angle_max and not increment) or not 0 <= range_min < range_max:
        raise InputError(f"{path}: angle or range limits are the wrong way round")
    by_beam = npz.matrix(arrays, "ranges", path, -1, len(stamps))
    if len(stamps) == 0 or len(by_beam) == 0:
        raise InputError(f"{path}: holds no scans")
    angles = beam_angles(len(by_beam), (angle_min, angle_max), increment, notes)
    if robot.lidar.upside_down:
        angles = -angles
    if len(angles) > 1 and angles[1] < angles[0]:  # scan matching takes beams in the order of their angles
        angles, by_beam = angles[::-1].copy(), by_beam[::-1]
    with np.errstate(over="ignore", invalid="ignore"):
        ranges = np.ascontiguousarray(by_beam.T, dtype=np.float32)
    if bad := int((~np.isfinite(ranges)).sum()):
        notes.append(f"lidar: {bad} ranges that are NaN or infinite taken as no return")
        ranges[~np.isfinite(ranges)] = 0.0
    kept, stamps = distinct_scans(stamps, ranges, notes, spacing=0.025)
    if len(kept) == 0:
        raise InputError(f"{path}: no scan has a valid time stamp")
    if len(kept) < len(ranges) or (np.diff(kept) != 1).any():
        ranges = ranges[kept]
    x, y, z = robot.lidar.position
    pose = np.array([x, y, robot.lidar.yaw])
    return _Scans(stamps, ranges, Lidar(angles, range_min, range_max, pose, z + robot.axle_height))


def _require_samples(path: Path, stamps: Array) -> None:
    if len(stamps) == 0:
        raise InputError(f"{path}: holds no samples")


def _held(odometry: WheelOdometry, first: float, last: float) -> list[str]:
    """Notes on the time of the scans that encoders or IMU do not cover, where they are taken to rest."""
    notes = []
    for what, stamps in (("encoders", odometry.wheel_stamps), ("IMU", odometry.gyro_stamps)):
        late, early = float(stamps[0]) - first, last - float(stamps[-1])
        if late > _SLACK:
            notes.append(f"{what}: first sample {late:.2f} s after the first scan; taken to rest until then")
        if early > _SLACK:
            notes.append(f"{what}: last sample {early:.2f} s before the last scan; taken to rest from then on")
    rolled = odometry.rolled_between(min(float(odometry.gyro_stamps[-1]), last), last)
    if abs(rolled) > 0.05:
        notes.append(f"IMU: the wheels roll another {rolled:.2f} m after its end; turns in them are not seen")
    return notes


def _read_truth(folder: Path, number: str, first: float, last: float, notes: list[str]) -> Trajectory | None:
    """``ground_truthN.npz`` or ``ground_truth.npz`` beside the set, if it is of the same time."""
    for path in (folder / f"ground_truth{number}.npz", folder / "ground_truth.npz"):
        if path.exists():
            break
    else:
        return None
    try:
        arrays = npz.read_arrays(path, ["time_stamps", "pose"])
        stamps = npz.vector(arrays, "time_stamps", path)
        if (poses := arrays["pose"]).shape != (len(stamps), 3):
            poses = npz.matrix(arrays, "pose", path, 3, len(stamps)).T
        poses = poses.astype(np.float64)
        stamps = stamps * units.unit_like(stamps, first, last)
    except InputError as error:
        notes.append(f"truth: left out; {error}")
        return None
    kept = order(stamps, "truth", notes)
    stamps, poses = stamps[kept], poses[kept]
    usable = np.isfinite(poses).all(axis=1) & (np.diff(stamps, prepend=-np.inf) > 0)
    stamps, poses = stamps[usable], poses[usable]
    if len(stamps) == 0 or stamps[-1] < first or stamps[0] > last:
        notes.append(f"truth: {path.name} does not overlap the scans in time; left out")
        return None
    return Trajectory(stamps, poses)
