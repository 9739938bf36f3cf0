"""The one type that every sensor recording is turned into, whatever format it came from."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.robot import CameraGeometry

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Lidar:
    """The scanner: beam directions and its place on the robot.

    ``angles`` (B,) rad, counter-clockwise from its own x axis; a range outside [``range_min``, ``range_max``] m is no
    return; ``pose`` (3,) is x, y (m), yaw (rad) in the robot's frame; ``height`` m above the ground.
    """

    angles: Array
    range_min: float
    range_max: float
    pose: Array
    height: float = 0.0


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses ``(n, 3)`` at increasing ``stamps`` (n,) s."""

    stamps: Array
    poses: Array

    def at(self, stamps: Array) -> Array:
        """Poses (m, 3) interpolated at the times (m,); the first and last are held outside the span."""
        return geometry.interpolate_poses(self.stamps, self.poses, stamps)


@dataclass(frozen=True, slots=True)
class Relations:
    """Kümmerle's relations: the true pose (k, 3) at ``end`` (k,) in the frame of the pose at ``start`` (k,) s."""

    start: Array
    end: Array
    poses: Array


@dataclass(frozen=True, slots=True)
class Frames:
    """The Kinect's images: stamps (s) and files, in order; ``None`` where a stamp has no file."""

    color_stamps: Array
    color_paths: tuple[Path | None, ...]
    disparity_stamps: Array
    disparity_paths: tuple[Path | None, ...]
    camera: CameraGeometry


@dataclass(frozen=True, slots=True)
class Stream:
    """One sensor's samples as they came: its name in words and the stamps (n,) s, in order of time."""

    name: str
    stamps: Array


@dataclass(frozen=True, slots=True)
class Recording:
    """A robot's drive: n scans of B beams, and the odometry between them.

    Attributes:
        name: what the user called it.
        format: ``"ece276a"`` or ``"carmen"`` (for display; no algorithm may depend on it).
        path: the file or folder it was read from.
        stamps: (n,) strictly increasing, s, the recording's own clock.
        ranges: (n, B) float32 m; finite. Outside the lidar's limits (0 included) means no return.
        lidar: the scanner.
        odometry: (n, 3) motion of the robot frame from scan k - 1 to scan k, in the frame at k - 1; row 0 is zero.
        frames: the camera's images, if any.
        truth: true poses of the robot frame, if known.
        relations: true relative poses, if known.
        notes: what was wrong with the files and how it was handled, a sentence each.
        streams: every sensor's own stamps, for ``info``; no algorithm needs them.
    """

    name: str
    format: str
    path: Path
    stamps: Array
    ranges: NDArray[np.float32]
    lidar: Lidar
    odometry: Array
    frames: Frames | None = None
    truth: Trajectory | None = None
    relations: Relations | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
    streams: tuple[Stream, ...] = field(default_factory=tuple)

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def times(self) -> Array:
        """(n,) s since the first scan."""
        return self.stamps - self.stamps[0]

    @property
    def duration(self) -> float:
        """Seconds from the first to the last scan."""
        return float(self.stamps[-1] - self.stamps[0])

    def dead_reckoning(self) -> Array:
        """(n, 3) poses by odometry alone, from the origin."""
        return geometry.accumulate(self.odometry)

    def select(self, start: int = 0, stop: int | None = None, stride: int = 1) -> "Recording":
        """The recording made of scans ``start:stop:stride``; the odometry between the kept scans is composed."""
        kept = np.arange(len(self))[start:stop:stride]
        poses = self.dead_reckoning()[kept]
        steps = np.zeros((len(kept), 3))
        if len(kept) > 1:
            steps[1:] = geometry.between(poses[:-1], poses[1:])
        return Recording(
            name=self.name,
            format=self.format,
            path=self.path,
            stamps=self.stamps[kept],
            ranges=self.ranges[kept],
            lidar=self.lidar,
            odometry=steps,
            frames=self.frames,
            truth=self.truth,
            relations=self.relations,
            notes=self.notes,
            streams=self.streams,
        )
