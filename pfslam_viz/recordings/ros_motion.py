"""The robot's motion in a ROS recording: from nav_msgs/Odometry, or from transforms between odom and the base."""

from array import array
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.recording import Trajectory
from pfslam_viz.recordings.ros_transforms import Transforms, frame_name, matrices, pick, seconds
from pfslam_viz.recordings.stamps import order

Array = NDArray[np.float64]

# What REP 105 calls the frame of odometry, and what robot_pose_ekf does.
ODOM_FRAMES = ("odom", "odom_combined")


class Odometry:
    """The Odometry messages of one topic, in the order they came."""

    def __init__(self) -> None:
        self.stamps, self.received, self._values = array("d"), array("d"), array("d")
        self._children: Counter[str] = Counter()

    def add(self, message: object, received: float) -> None:
        """One message, received at a time in s."""
        place, turn = message.pose.pose.position, message.pose.pose.orientation  # type: ignore[attr-defined]
        self.stamps.append(seconds(message.header.stamp))  # type: ignore[attr-defined]
        self.received.append(received)
        self._values.extend((place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w))
        self._children[frame_name(message.child_frame_id)] += 1  # type: ignore[attr-defined]

    @property
    def child(self) -> str:
        """The frame that most messages give the pose of; ``""`` when they do not say."""
        return self._children.most_common(1)[0][0] if self._children else ""

    def places(self) -> Array:
        """(n, 4, 4) poses in the odometry's frame."""
        return matrices(np.array(self._values).reshape(-1, 7))


def from_topic(
    odometry: Odometry, transforms: Transforms, base: str, by_receipt: bool, notes: list[str]
) -> Trajectory | None:
    """The motion of ``base``, which may be another frame than the one that the odometry is of."""
    stamps = np.array(odometry.received if by_receipt else odometry.stamps)
    places = odometry.places()
    finite = np.isfinite(places).all(axis=(1, 2))
    if not finite.all():
        notes.append(f"odometry: {int((~finite).sum())} poses that are no numbers left out")
    if not by_receipt:
        stamps[stamps == 0] = np.nan
    stamps, places = stamps[finite], places[finite]
    if odometry.child != base:
        offset = transforms.fixed(odometry.child, base) if odometry.child else None
        if offset is not None:
            places = places @ offset[0]
        elif odometry.child:
            notes.append(f"odometry: it is of the frame {odometry.child!r}; taken to be that of {base!r}")
    poses = np.stack([places[:, 0, 3], places[:, 1, 3], np.arctan2(places[:, 1, 0], places[:, 0, 0])], axis=1)
    return _in_order(stamps, poses, notes)


def from_transforms(
    transforms: Transforms, base: str, bases: Sequence[str], by_receipt: bool, notes: list[str]
) -> tuple[str, Trajectory | None]:
    """The motion of ``base`` (of one called like ``bases`` if it has none), and its source in words."""
    by_receipt = by_receipt or transforms.without_stamps()
    for child in dict.fromkeys([base, *pick(transforms.frames, bases)]):
        for top in pick(transforms.frames, ODOM_FRAMES):
            if child and (motion := transforms.motion(top, child, by_receipt)) is not None:
                if child != base:
                    notes.append(f"odometry: it is of the frame {child!r}; taken to be that of {base or 'the lidar'!r}")
                return f"transforms {top} -> {child}", _in_order(*motion, notes)
    return "", None


def at_scans(track: Trajectory | None, stamps: Array, notes: list[str]) -> Array:
    """Increments (n, 3) between the scans' stamps (n,); zero without odometry."""
    steps = np.zeros((len(stamps), 3))
    if track is None:
        return steps
    spacing = float(np.median(np.diff(track.stamps))) if len(track.stamps) > 1 else 0.0
    outside = (stamps < track.stamps[0] - spacing - 1e-3) | (stamps > track.stamps[-1] + spacing + 1e-3)
    if outside.all():
        notes.append("odometry: none of it is of the time of the scans; their clocks differ")
    elif outside.any():
        notes.append(f"odometry: {int(outside.sum())} scans are before or after it; its first and last pose are held")
    poses = track.at(stamps)
    steps[1:] = geometry.between(poses[:-1], poses[1:])
    return steps


def _in_order(stamps: Array, poses: Array, notes: list[str]) -> Trajectory | None:
    kept = order(stamps, "odometry", notes)
    stamps, poses = stamps[kept], poses[kept]
    if len(stamps) == 0:
        return None
    # Of several poses at one time the first: np.unique gives the first of each.
    _, first = np.unique(stamps, return_index=True)
    if len(first) < len(stamps):
        notes.append(f"odometry: {len(stamps) - len(first)} poses repeat the stamp before; left out")
    return Trajectory(stamps[first], poses[first])
