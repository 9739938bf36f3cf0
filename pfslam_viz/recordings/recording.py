"""The one type that every sensor recording is turned into, whatever format it came from.

Its values check themselves: what does not fit is refused when they are made, so that no algorithm has to look again.
Integers become floats, and arrays contiguous; the arrays given are not changed.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import checks
from pfslam_viz.recordings.findings import Finding
from pfslam_viz.recordings.motion import poses_of, steps_of
from pfslam_viz.recordings.stamps import distinct_scans
from pfslam_viz.robot import CameraGeometry

Array = NDArray[np.float64]

NEAREST = 0.001
"""m; the ``range_min`` of a lidar that is given as 0, since a range of 0 is no return."""


@dataclass(frozen=True, slots=True)
class Lidar:
    """The scanner: beam directions and its place on the robot.

    ``angles`` (B,) rad, counter-clockwise from its own x axis; a range outside [``range_min``, ``range_max``] m is no
    return (a ``range_min`` of 0 is taken as :data:`NEAREST`); ``pose`` (3,) is x, y (m), yaw (rad) in the robot's
    frame; ``height`` m above the ground. Raises InputError for values that do not fit.
    """

    angles: Array
    range_min: float
    range_max: float
    pose: Array
    height: float = 0.0

    def __post_init__(self) -> None:
        angles = checks.vector(self.angles, "lidar.angles")
        if len(angles) == 0:
            raise InputError("lidar.angles is empty; one angle a beam is expected")
        nearest = checks.number(self.range_min, "lidar.range_min")
        farthest = checks.number(self.range_max, "lidar.range_max")
        if not 0 <= nearest < farthest:
            raise InputError(
                f"lidar.range_min is {nearest:g} m and lidar.range_max {farthest:g} m;"
                " 0 <= range_min < range_max is expected"
            )
        if nearest == 0:
            nearest = min(NEAREST, 0.5 * farthest)
        _set(self, angles=angles, range_min=nearest, range_max=farthest)
        _set(self, pose=checks.vector(self.pose, "lidar.pose", 3), height=checks.number(self.height, "lidar.height"))


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Poses ``(n, 3)`` at increasing ``stamps`` (n,) s. Raises InputError for values that do not fit."""

    stamps: Array
    poses: Array

    def __post_init__(self) -> None:
        stamps = checks.stamps(self.stamps, "trajectory.stamps")
        poses = checks.poses(self.poses, "trajectory.poses", len(stamps), ", a pose for every stamp")
        _set(self, stamps=stamps, poses=poses)

    def at(self, stamps: Array) -> Array:
        """Poses (m, 3) interpolated at the times (m,); the first and last are held outside the span."""
        return geometry.interpolate_poses(self.stamps, self.poses, stamps)


@dataclass(frozen=True, slots=True)
class Relations:
    """Kümmerle's relations: the true pose (k, 3) at ``end`` (k,) in the frame of the pose at ``start`` (k,) s.

    Raises InputError for values that do not fit.
    """

    start: Array
    end: Array
    poses: Array

    def __post_init__(self) -> None:
        start = checks.vector(self.start, "relations.start")
        end = checks.vector(self.end, "relations.end", len(start), ", as relations.start has")
        poses = checks.poses(self.poses, "relations.poses", len(start), ", a pose for every start")
        _set(self, start=start, end=end, poses=poses)


@dataclass(frozen=True, slots=True)
class Frames:
    """The Kinect's images: increasing stamps (s) and files; ``None`` where a stamp has no file.

    Raises InputError for values that do not fit.
    """

    color_stamps: Array
    color_paths: tuple[Path | None, ...]
    disparity_stamps: Array
    disparity_paths: tuple[Path | None, ...]
    camera: CameraGeometry

    def __post_init__(self) -> None:
        for kind in ("color", "disparity"):
            stamps = checks.stamps(getattr(self, f"{kind}_stamps"), f"frames.{kind}_stamps")
            paths = tuple(getattr(self, f"{kind}_paths"))
            if len(paths) != len(stamps):
                raise InputError(
                    f"frames.{kind}_paths has {len(paths)} files; {len(stamps)} are expected, a file or None for every"
                    " stamp"
                )
            _set(self, **{f"{kind}_stamps": stamps, f"{kind}_paths": paths})

    def scaled(self, factor: float) -> "Frames":
        """The same with stamps times ``factor``, such as those of a file in ms."""
        color, disparity = self.color_stamps * factor, self.disparity_stamps * factor
        return replace(self, color_stamps=color, disparity_stamps=disparity)


@dataclass(frozen=True, slots=True)
class Stream:
    """One sensor's samples as they came: its name in words and the stamps (n,) s, in order of time."""

    name: str
    stamps: Array

    def scaled(self, factor: float) -> "Stream":
        """The same with stamps times ``factor``."""
        return Stream(self.name, self.stamps * factor)


@dataclass(frozen=True, slots=True)
class Recording:
    """A robot's drive: n scans of B beams, and the odometry between them.

    Raises InputError when it is made of values that do not fit each other, with the name of the field.

    Attributes:
        name: what the user called it.
        format: a name in :data:`~pfslam_viz.recordings.formats.FORMATS`, or ``"arrays"`` (for display; no algorithm
            may depend on it).
        path: the file or folder it was read from; None where it was made from arrays.
        stamps: (n,) strictly increasing, s, the recording's own clock.
        ranges: (n, B) float32 m; finite. Outside the lidar's limits (0 included) means no return; NaN and infinite
            ranges become 0.
        lidar: the scanner.
        odometry: (n, 3) motion of the robot frame from scan k - 1 to scan k, in the frame at k - 1; row 0 is zero.
        frames: the camera's images, if any.
        truth: true poses of the robot frame, if known.
        relations: true relative poses, if known.
        notes: what was wrong with the files and how it was handled, a sentence each.
        streams: every sensor's own stamps, for ``info``; no algorithm needs them.
        findings: what was found wrong with it as a whole, the notes among them once it is checked.
        odometry_known: (n,) bool, False where ``odometry`` is but a guess, in place of a step that cannot be; None
            where all of it was measured.
        checked: whether it went through :func:`~pfslam_viz.recordings.checking.check.check`.
        beam_times: (B,) s after the scan's stamp at which each beam was measured, below 0 before it; None where all of
            a scan is taken as of one moment.
    """

    name: str
    format: str
    path: Path | None
    stamps: Array
    ranges: NDArray[np.float32]
    lidar: Lidar
    odometry: Array
    frames: Frames | None = None
    truth: Trajectory | None = None
    relations: Relations | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
    streams: tuple[Stream, ...] = field(default_factory=tuple)
    findings: tuple[Finding, ...] = field(default_factory=tuple)
    odometry_known: NDArray[np.bool_] | None = None
    checked: bool = False
    beam_times: Array | None = None

    def __post_init__(self) -> None:
        whose = self.path or self.name
        stamps = checks.stamps(self.stamps, f"{whose}: stamps", strictly=True)
        ranges, bad = checks.ranges(self.ranges, f"{whose}: ranges", len(stamps), len(self.lidar.angles))
        odometry = checks.poses(self.odometry, f"{whose}: odometry", len(stamps), ", a row for every scan")
        if len(odometry) and odometry[0].any():
            odometry = odometry.copy()
            odometry[0] = 0.0
        notes = tuple(self.notes)
        if bad:
            notes += (f"lidar: {bad} ranges that are NaN or infinite taken as no return",)
        _set(self, stamps=stamps, ranges=ranges, odometry=odometry, notes=notes, streams=tuple(self.streams))
        _set(self, findings=tuple(self.findings))
        if self.odometry_known is not None:
            known = np.asarray(self.odometry_known)
            if known.dtype != bool or known.shape != (len(stamps),):
                raise InputError(f"{whose}: odometry_known is no bool for every scan; ({len(stamps)},) is expected")
            _set(self, odometry_known=known)
        if self.beam_times is not None:
            beams = len(self.lidar.angles)
            times = checks.vector(self.beam_times, f"{whose}: beam_times", beams, ", a time for every beam")
            _set(self, beam_times=times)

    @classmethod
    def from_arrays(
        cls,
        stamps: ArrayLike,
        ranges: ArrayLike,
        angles: ArrayLike,
        odometry: ArrayLike | None = None,
        *,
        odometry_poses: ArrayLike | None = None,
        range_min: float = 0.0,
        range_max: float | None = None,
        lidar_pose: ArrayLike = (0.0, 0.0, 0.0),
        lidar_height: float = 0.0,
        name: str = "arrays",
        truth: Trajectory | ArrayLike | None = None,
        relations: Relations | None = None,
        frames: Frames | None = None,
        notes: Iterable[str] = (),
        streams: Iterable[Stream] = (),
        beam_times: ArrayLike | None = None,
        format: str = "arrays",
        path: Path | None = None,
    ) -> "Recording":
        """A recording of arrays in memory: what every format comes down to. The arrays are not changed.

        Scans are sorted by their stamps, scans without a finite stamp left out, and stamps that repeat spread up to the
        next one (a scan that repeats the one before is left out); ``notes`` of the recording say so.

        Args:
            stamps: (n,) s.
            ranges: (n, B) m, a row for every scan; NaN, infinite and 0 are no return.
            angles: (B,) rad, counter-clockwise from the lidar's x axis.
            odometry: (n, 3) motion from the scan before to each scan, in the frame of the pose there: x ahead (m),
                y to the left (m), turn (rad). Row 0 is ignored.
            odometry_poses: (n, 3) poses by odometry at the scans instead, in any one frame. With neither, the robot is
                taken to rest, and the filter has the scans alone.
            range_min: a smaller range (m) is no return.
            range_max: a larger range (m) is no return; None takes every finite range as a return. A value that the
                readings show to stand for no return is none in any case; the notes say so.
            lidar_pose: x, y (m), yaw (rad) of the lidar in the robot's frame.
            lidar_height: m above the ground.
            name: what to call it.
            truth: true poses of the robot, (n, 3) at the scans or a Trajectory with stamps of its own, if known.
            relations: as in the class, like all that follow.
            frames: the camera's images.
            notes: what was wrong and how it was handled.
            streams: every sensor's own stamps.
            beam_times: (B,) s after the scan's stamp.
            format: for display.
            path: where it was read from.

        Raises:
            InputError: an array has another shape, or numbers that are none; there are no scans; both kinds of
                odometry are given.
        """
        said = list(notes)
        times = checks.vector(stamps, f"{name}: stamps", finite=False)
        beams = checks.vector(angles, f"{name}: angles")
        readings, bad = checks.ranges(ranges, f"{name}: ranges", len(times), len(beams))
        if bad:
            said.append(f"lidar: {bad} ranges that are NaN or infinite taken as no return")
        steps = steps_of(name, len(times), odometry, odometry_poses, said)
        true = (
            truth if isinstance(truth, Trajectory) or truth is None else poses_of(truth, f"{name}: truth", len(times))
        )
        kept, in_order = distinct_scans(times, readings, said)
        if len(kept) == 0:
            raise InputError(f"{name}: stamps holds no scan with a finite stamp; one or more are expected")
        if not np.array_equal(kept, np.arange(len(times))):
            readings, steps = readings[kept], geometry.increments(geometry.accumulate(steps)[kept])
        farthest = max(float(readings.max()), 1.0) if range_max is None else range_max
        return cls(
            name=name,
            format=format,
            path=path,
            stamps=in_order,
            ranges=readings,
            lidar=Lidar(beams, range_min, farthest, np.asarray(lidar_pose), lidar_height),
            odometry=steps,
            frames=frames,
            truth=Trajectory(in_order, true[kept]) if isinstance(true, np.ndarray) else true,
            relations=relations,
            notes=tuple(said),
            streams=tuple(streams),
            beam_times=None if beam_times is None else np.asarray(beam_times),
        )

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def times(self) -> Array:
        """(n,) s since the first scan."""
        times: Array = self.stamps - self.stamps[0]
        return times

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
        steps = geometry.increments(self.dead_reckoning()[kept])
        known = self.odometry_known
        if known is not None:  # a composed step is known if all of its parts are
            unknown = np.cumsum(~known)[kept]
            known = np.diff(unknown, prepend=unknown[:1]) == 0
        return replace(self, stamps=self.stamps[kept], ranges=self.ranges[kept], odometry=steps, odometry_known=known)


def _set(value: object, **fields: object) -> None:
    """Set fields of a frozen value while it is made."""
    for name, content in fields.items():
        object.__setattr__(value, name, content)
