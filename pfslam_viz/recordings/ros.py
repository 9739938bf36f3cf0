"""ROS recordings: ROS 1 ``.bag``, ROS 2 ``.db3`` and ``.mcap``, each a file or (ROS 2) a folder with metadata.yaml.

Topics are chosen by type. Odometry is nav_msgs/Odometry, else /tf from an odom frame to the base; where the lidar sits
comes from /tf_static, else /tf, through any chain of frames. Stamps are those of the messages' headers.
"""

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.recording import Lidar, Recording, Stream
from pfslam_viz.recordings.ros_bag import ODOMETRY, TRANSFORMS, Bag, short_type
from pfslam_viz.recordings.ros_claims import claims, looks_like, recording_name
from pfslam_viz.recordings.ros_motion import Odometry, at_scans, from_topic, from_transforms
from pfslam_viz.recordings.ros_scans import Scans
from pfslam_viz.recordings.ros_topics import choose_odometry, choose_scans
from pfslam_viz.recordings.ros_transforms import Transforms, pick
from pfslam_viz.recordings.stamps import order, spread_repeats

__all__ = ["Drive", "claims", "describe", "load", "looks_like", "read", "recording_name"]

Array = NDArray[np.float64]

BASES = ("base_footprint", "base_link", "base")
# Beyond this a lidar's plane is not taken for level without a word (rad).
_LEVEL = math.radians(5.0)


@dataclass(frozen=True, slots=True)
class Drive:
    """A ROS recording with what its messages say besides.

    Attributes:
        recording: as every format gives it.
        used: what was chosen, for ``info``; values are what JSON can hold.
    """

    recording: Recording
    used: dict[str, object] = field(default_factory=dict)


def load(
    path: Path,
    name: str | None = None,
    *,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    base_frame: str | None = None,
) -> Recording:
    """The recording in a bag; arguments and errors as for :func:`read`."""
    return read(path, name, scan_topic=scan_topic, odom_topic=odom_topic, base_frame=base_frame).recording


def read(
    path: Path,
    name: str | None = None,
    *,
    scan_topic: str | None = None,
    odom_topic: str | None = None,
    base_frame: str | None = None,
) -> Drive:
    """Read a bag.

    Args:
        path: the file or folder.
        name: what to call it; by default as the file is called.
        scan_topic: the topic of the scans, needed where several hold LaserScans.
        odom_topic: the topic of the odometry, needed where several hold Odometry; a topic of transforms to take it
            from those, ``none`` to take none.
        base_frame: the frame that is the robot's; by default the odometry's child frame, else base_footprint or
            base_link.

    Raises:
        InputError: rosbags is not installed; the file is missing or damaged, holds no LaserScan, or does not say which
            of several topics is meant.
    """
    with Bag(path) as bag:
        return _read(bag, name or recording_name(path), scan_topic, odom_topic, (base_frame or "").strip("/"))


@dataclass(frozen=True, slots=True)
class Description:
    """What a bag holds: ``topics`` (name, type, messages, rate_hz), and what of it would be replayed.

    ``used`` is empty where ``problem`` says why it cannot be replayed; values are what JSON can hold.
    """

    topics: tuple[dict[str, object], ...]
    used: dict[str, object]
    problem: str | None


def describe(
    path: Path, *, scan_topic: str | None = None, odom_topic: str | None = None, base_frame: str | None = None
) -> Description:
    """What a bag holds and what of it would be replayed. Raises InputError when it cannot be opened at all."""
    with Bag(path) as bag:
        topics: tuple[dict[str, object], ...] = tuple(
            {
                "name": topic.name,
                "type": short_type(topic.type),
                "messages": topic.messages,
                "rate_hz": round((topic.messages - 1) / bag.duration, 2)
                if topic.messages > 1 and bag.duration > 0
                else None,
            }
            for topic in bag.topics.values()
        )
        try:
            drive = _read(bag, recording_name(path), scan_topic, odom_topic, (base_frame or "").strip("/"))
        except InputError as error:
            return Description(topics, {}, str(error).removeprefix(f"{path}: "))
        return Description(topics, drive.used, None)


def _read(bag: Bag, name: str, scan_topic: str | None, odom_topic: str | None, base_frame: str) -> Drive:
    notes: list[str] = []
    scan_name = choose_scans(bag, scan_topic)
    odom_name = choose_odometry(bag, odom_topic)
    scans, odometry, transforms = Scans(), Odometry(), Transforms()
    static = {topic.name for topic in bag.of_type(*TRANSFORMS) if topic.name.endswith("tf_static")}
    other = {topic.name for topic in bag.of_type(*TRANSFORMS)} - static
    by_topic = odom_name is not None and bag.topics[odom_name].type == ODOMETRY
    wanted = {scan_name, *static} | ({odom_name} if odom_name and by_topic else set())
    for topic, received, message in bag.messages(wanted):
        if topic == scan_name:
            scans.add(message, received * 1e-9)
        elif topic == odom_name:
            odometry.add(message, received * 1e-9)
        else:
            transforms.add(message, received * 1e-9)
    if len(scans) == 0:
        raise InputError(f"{bag.path}: no message of {scan_name} can be read")
    frame, total = Counter(scans.frames).most_common(1)[0]
    if total < len(scans):
        notes.append(f"lidar: {len(scans) - total} scans of other frames than {frame!r} left out")
    wants_tf = not by_topic and odom_topic != "none"
    transforms.flush()
    base, place = _place(transforms, odometry, frame, base_frame)
    if other and (wants_tf or place is None or base != (base_frame or odometry.child or base)):
        for _, received, message in bag.messages({odom_name} if odom_name in other else other):
            transforms.add(message, received * 1e-9)
        transforms.flush()
        base, place = _place(transforms, odometry, frame, base_frame)
    if base_frame and base_frame not in transforms.frames | {odometry.child, frame}:
        known = ", ".join(sorted(transforms.frames | {odometry.child, frame} - {""}))
        raise InputError(f"{bag.path}: --base-frame {base_frame}: no such frame; there are {known}")

    by_receipt = _clock(scans, odometry if by_topic else None, notes)
    if by_topic:
        track = from_topic(odometry, transforms, base, by_receipt, notes)
        source = odom_name or ""
    elif wants_tf:
        source, track = from_transforms(transforms, base, BASES, by_receipt, notes)
    else:
        source, track = "", None

    stamps, rows = _stamps(scans, frame, by_receipt, bag.path, notes)
    grid = scans.gather(rows, notes)
    limits = scans.range_limits(grid.ranges, notes)
    pose, height, upside_down = _mount(transforms, base, frame, place, notes)
    angles, ranges = grid.angles, grid.ranges
    if upside_down:  # its beams run the other way round
        angles, ranges = -angles[::-1], np.ascontiguousarray(ranges[:, ::-1])
    spacing = float(np.median(np.diff(stamps))) if len(stamps) > 1 else math.inf
    beam_time, beam_time_field = scans.beam_time_increment(spacing, len(angles))
    steps = at_scans(track, stamps, notes)
    if track is None and odom_topic != "none":
        notes.append("odometry: none (no nav_msgs/Odometry, and no transforms from odom to the base)")
    streams = [Stream("lidar", stamps)]
    if track is not None:
        streams.append(Stream("odometry", track.stamps))
    recording = Recording(
        name=name,
        format="ros",
        path=bag.path,
        stamps=stamps,
        ranges=ranges,
        lidar=Lidar(angles, *limits, pose, height),
        odometry=steps,
        notes=(*bag.notes, *notes),
        streams=tuple(streams),
    )
    backwards = grid.clockwise != upside_down
    used: dict[str, object] = {
        "scan_topic": scan_name,
        "scan_frame": frame,
        "odometry": source or None,
        "base_frame": base or None,
        "lidar_on_robot_x_y_yaw": [round(float(v), 5) for v in pose],
        "lidar_height_m": round(height, 5),
        "upside_down": upside_down,
        "clockwise": grid.clockwise,
        "stamps": "receive times" if by_receipt else "header.stamp",
        "beam_time_increment_s": beam_time,
        "beam_time_from": beam_time_field or None,
    }
    beam_times = None
    if beam_time is not None:
        beam_times = beam_time * np.arange(len(angles), dtype=np.float64)
        beam_times = beam_times[::-1].copy() if backwards else beam_times
    return Drive(replace(recording, beam_times=beam_times), used)


def _place(transforms: Transforms, odometry: Odometry, frame: str, base_frame: str) -> tuple[str, Array | None]:
    """The robot's frame, and where the lidar sits in it as a (4, 4) matrix; None if no transform says it."""
    if base_frame:
        candidates = [base_frame]
    else:
        child = [odometry.child] if odometry.child else []
        candidates = [*child, *pick(transforms.frames | {frame}, BASES)]
    for base in candidates:
        if base == frame:
            return base, np.eye(4)
        if (found := transforms.fixed(base, frame)) is not None:
            return base, found[0]
    return (candidates[0] if candidates else ""), None


def _mount(
    transforms: Transforms, base: str, frame: str, place: Array | None, notes: list[str]
) -> tuple[Array, float, bool]:
    """The lidar's pose (3,) on the robot, its height in m, and whether it hangs upside down."""
    if place is None:
        to = f" from {base!r}" if base else ""
        notes.append(f"lidar: no transform{to} to its frame {frame!r}; it is taken to be the robot's origin")
        return np.zeros(3), 0.0, False
    chain = transforms.fixed(base, frame)
    if chain is not None and chain[1]:
        notes.append(f"lidar: it moves on the robot ({', '.join(chain[1])}); its first place is taken")
    tilt = math.acos(min(abs(float(place[2, 2])), 1.0))
    if tilt > _LEVEL:
        notes.append(f"lidar: it is tilted by {math.degrees(tilt):.0f}°; its ranges are taken as if it were level")
    pose = np.array([place[0, 3], place[1, 3], math.atan2(place[1, 0], place[0, 0])])
    height = float(place[2, 3])
    for ground in pick(transforms.frames, ("base_footprint",)):
        if (over := transforms.fixed(ground, frame)) is not None:
            height = float(over[0][2, 3])
            break
    upside_down = bool(place[2, 2] < 0)
    if upside_down:
        notes.append("lidar: it hangs upside down; its beams run the other way round")
    return np.round(pose, 9) + 0.0, height, upside_down


def _clock(scans: Scans, odometry: Odometry | None, notes: list[str]) -> bool:
    """Whether receive times must be used: where scans or odometry have no header stamps, one clock is for all."""
    for what, stamps in (("scans", scans.stamps), ("odometry", odometry.stamps if odometry else None)):
        if stamps and not any(stamps):
            notes.append(f"{what}: all header stamps are zero; receive times are used")
            return True
    return False


def _stamps(scans: Scans, frame: str, by_receipt: bool, path: Path, notes: list[str]) -> tuple[Array, NDArray[np.intp]]:
    """Increasing stamps (n,) of the scans to use, and which these are (n,)."""
    stamps = np.array(scans.received if by_receipt else scans.stamps)
    if not by_receipt and (zero := stamps == 0).any():
        stamps[zero] = np.nan
    usable = scans.usable(frame)
    impossible = sum(f == frame for f in scans.frames) - int(usable.sum())
    if impossible:
        notes.append(f"lidar: {impossible} scans without beams or with impossible beam angles left out")
    kept = np.flatnonzero(usable)
    kept = kept[order(stamps[kept], "lidar", notes)]
    if len(kept) == 0:
        raise InputError(f"{path}: no scan has usable beam angles and a valid time stamp")
    if repeats := int((np.diff(stamps[kept]) == 0).sum()):
        notes.append(f"lidar: {repeats} scans repeat the stamp before; spread up to the next stamp")
    return spread_repeats(stamps[kept]), kept
