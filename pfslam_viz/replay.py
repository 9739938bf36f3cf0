"""The loop: a recording goes in, a Step for every scan comes out."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.compiling.clock import CLOCK, clock
from pfslam_viz.config import Config
from pfslam_viz.errors import PfslamError
from pfslam_viz.recordings.checking.check import check, refuse_wrong
from pfslam_viz.recordings.findings import Finding
from pfslam_viz.recordings.motion import twists as twists_of
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.slam.backends import make_slam
from pfslam_viz.slam.background_grid import BackgroundGrid
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import Kept, LoopClosure, Scan, Slam
from pfslam_viz.slam.read_ahead import ReadAhead
from pfslam_viz.slam.scan_reader import ScanReader
from pfslam_viz.slam.worker import Worker, cores
from pfslam_viz.step import Step

if TYPE_CHECKING:
    from pfslam_viz.texture.floor_camera import FloorCamera
    from pfslam_viz.texture.floor_texture import FloorTexture
    from pfslam_viz.texture.painter import SkippedFrames, TexturePainter

Array = NDArray[np.float64]

PHASES = ("predict", "update", "map", "resample", "revise", "dead_reckoning", "texture")


@dataclass(frozen=True, slots=True)
class Result:
    """What is known when the last scan is in. Poses are (n, 3) in the frame of the first pose.

    Attributes:
        recording: what was replayed.
        config: with which settings.
        stamps: (n,) s, the scans'.
        estimate: the whole trajectory as known at the end.
        online: each pose as it was estimated then (the best particle).
        dead_reckoning: by odometry alone.
        truth: (n, 3) at the scans' stamps, moved to start at the origin, if known.
        grid: the final map.
        dead_reckoning_grid: dead reckoning's.
        seconds: (n,) per phase: what the loop spent on it. Another thread's work counts where the loop waited for it.
        resamplings: how many scans were followed by resampling.
        uninformative: how many scans had no correlation with the map.
        interrupted: whether the run was stopped before the last scan.
        finish_seconds: what settling the whole run took, after the last scan.
        compile_seconds: what this process spent on compiling kernels so far, which no other time has.
        closures: the loops that settling it closed.
        kept: whether the estimate is the settled trajectory or the one of the run, if there was a choice.
        texture: the floor texture, if it was painted.
        skipped_frames: how many colour frames were not painted, by reason, if any were to be.
        camera: which camera the floor was painted with, and what the images say of it, if it was painted.
    """

    recording: Recording
    config: Config
    stamps: Array
    estimate: Array
    online: Array
    dead_reckoning: Array
    truth: Array | None
    grid: OccupancyGrid
    dead_reckoning_grid: OccupancyGrid
    seconds: dict[str, Array]
    resamplings: int
    uninformative: int
    interrupted: bool
    finish_seconds: float = 0.0
    compile_seconds: float = 0.0
    closures: tuple[LoopClosure, ...] = ()
    kept: Kept | None = None
    texture: "FloorTexture | None" = None
    skipped_frames: "SkippedFrames | None" = None
    camera: "FloorCamera | None" = None

    @property
    def hollow(self) -> str | None:
        """Why there is nothing to look at in the result of a whole run: no pose, or no map; None where there is."""
        if len(self.stamps) == 0:
            return "no scan was replayed"
        if not np.isfinite(self.estimate).all():
            return "the trajectory has poses that are no numbers"
        return None if self.grid.has_walls else "no cell of the map is occupied"

    def require_map(self) -> None:
        """Raise PfslamError where a whole run came out empty: a recording that nothing could be made of."""
        if not self.interrupted and (why := self.hollow):
            whose = self.recording.path or self.recording.name
            raise PfslamError(
                f"{whose}: the run came out empty: {why}; 'pfslam-viz info' says what is in the recording"
            )


class Replay:
    """Runs the filter over a recording: iterate over it for the Steps, then ask for the :meth:`result`.

    An iteration that is left early may be taken up again by another one, where it stopped.
    """

    def __init__(
        self, recording: Recording, config: Config, *, texture: bool = True, threads: int | None = None
    ) -> None:
        """Prepare to replay ``recording`` under ``config``.

        Without ``texture``, the floor is not painted, whatever the configuration and the recording hold. With 2
        ``threads``, a second one reads scans ahead, writes maps and helps to weigh the particles; None takes 2 if there
        are as many cores. The results do not depend on it.

        A recording that was not checked is checked now: ``self.recording`` is what was made of it. Raises InputError
        if it is found to be wrong.
        """
        if not recording.checked:
            recording = check(recording)
            refuse_wrong(recording, "checking.check.check(recording) beforehand")
        self.config = config
        self._worker = Worker(cores() if threads is None else threads)
        self.slam = make_slam(config, self._worker)
        self.dead_reckoning_grid = BackgroundGrid(config.map, self._worker)
        self.painter = _painter(recording, config, self.slam) if texture else None
        self.recording = _with_note(recording, self.painter.camera.note if self.painter else None)
        self.truth = _truth_from_start(recording)
        self._dead_reckoning = recording.dead_reckoning()
        self._online = np.zeros((len(recording), 3))
        self._seconds = {phase: np.zeros(len(recording)) for phase in PHASES}
        self._done = self._resamplings = self._uninformative = 0
        self._finished = False
        self._finish_seconds = 0.0
        self._texture = None if self.painter is None else self.painter.texture

    def __iter__(self) -> Iterator[Step]:
        try:
            yield from self._steps()
            if not self._finished:
                self._finish()
        finally:
            self._worker.close()
            if self.painter:
                self.painter.close()

    def _finish(self) -> None:
        """All scans are in: settle the trajectory, then the floor."""
        started = clock()
        self.slam.finish()
        self._finish_seconds = clock() - started
        if self.painter:
            self.painter.finish()
            self._texture = self._settled_texture(self.painter)
        self._finished = True

    def _settled_texture(self, painter: "TexturePainter") -> "FloorTexture":
        """The floor as painted on the way, or painted anew where hindsight moved the trajectory by a cell or more."""
        settled = self.slam.trajectory()
        moved = np.hypot(*(settled - self._online)[:, :2].T)
        if len(moved) == 0 or moved.max() < painter.texture.cell:
            return painter.texture
        return painter.repaint(self.recording.stamps, settled)

    def _steps(self) -> Iterator[Step]:
        """Algorithm 1, scan by scan, with dead reckoning beside it."""
        recording, slam, painter = self.recording, self.slam, self.painter
        reader = ScanReader.of(recording.lidar, self.config.observation, recording.beam_times)
        times, twists = (
            recording.times,
            None if reader.beam_times is None else twists_of(recording.odometry, recording.stamps),
        )

        def read(k: int) -> Scan:
            motion = None if twists is None else twists[k : k + 2]
            return slam.prepare(reader.read(k, float(recording.stamps[k]), recording.ranges[k], motion))

        scans = ReadAhead(read, self._done, len(recording), self._worker)
        for k in range(self._done, len(recording)):
            clock = _Clock(self._seconds, k)
            scan = scans.take()
            reckoned = self._dead_reckoning[k]
            if k > 0:  # the first scan is at the origin
                known = recording.odometry_known is None or bool(recording.odometry_known[k])
                slam.predict(recording.odometry[k], float(times[k] - times[k - 1]), known)
            clock.lap("predict")
            slam.update(scan)
            end_points, hits = slam.grid.project(slam.best, scan.points)
            clock.lap("update")
            slam.update_map(scan)
            clock.lap("map")
            slam.resample()
            clock.lap("resample")
            revision = slam.revise()
            if revision is not None:
                end_points, hits = slam.grid.project(slam.best, scan.points)
            estimate = slam.estimate()
            clock.lap("revise")
            reckoned_end_points = self.dead_reckoning_grid.add(reckoned, scan.points, scan.lidar_position)
            clock.lap("dead_reckoning")
            painted = painter.add_pose(scan.stamp, estimate.mean) if painter else None
            clock.lap("texture")
            self._online[k] = estimate.best
            self._resamplings += estimate.resampled
            self._uninformative += not estimate.informative
            self._done = k + 1
            yield Step(
                index=k,
                stamp=scan.stamp,
                time=float(times[k]),
                estimate=estimate,
                dead_reckoning=reckoned,
                end_points=end_points,
                hits=hits,
                dead_reckoning_end_points=reckoned_end_points,
                grid=slam.grid,
                dead_reckoning_grid=self.dead_reckoning_grid,
                revision=revision,
                texture=painter.texture if painter and painted else None,
                color_frame=painted[0] if painted else None,
                disparity_frame=painted[1] if painted else None,
                truth=None if self.truth is None else self.truth[k],
                seconds={phase: float(values[k]) for phase, values in self._seconds.items()},
            )

    def result(self) -> Result:
        """The Result after the iteration, or of what was done so far."""
        n = self._done
        return Result(
            recording=self.recording,
            config=self.config,
            stamps=self.recording.stamps[:n],
            estimate=self.slam.trajectory(),
            online=self._online[:n],
            dead_reckoning=self._dead_reckoning[:n],
            truth=None if self.truth is None else self.truth[:n],
            grid=self.slam.grid,
            dead_reckoning_grid=self.dead_reckoning_grid,
            seconds={phase: values[:n] for phase, values in self._seconds.items()},
            resamplings=self._resamplings,
            uninformative=self._uninformative,
            interrupted=n < len(self.recording),
            finish_seconds=self._finish_seconds,
            compile_seconds=CLOCK.seconds,
            closures=self.slam.closures,
            kept=self.slam.kept,
            texture=self._texture,
            skipped_frames=None if self.painter is None else self.painter.skipped,
            camera=None if self.painter is None else self.painter.camera,
        )


def _painter(recording: Recording, config: Config, slam: Slam) -> "TexturePainter | None":
    """Who paints the floor in cells as large as the map's, if there are images of it and painting is wanted."""
    if recording.frames is None or not config.texture.enabled:
        return None
    from pfslam_viz.texture.painter import TexturePainter

    return TexturePainter(recording.frames, config.texture, slam.grid.cell, keep=slam.settles)


def _with_note(recording: Recording, note: str | None) -> Recording:
    """The recording with what was found of its camera, which is no more than a note."""
    if note is None or note in recording.notes:
        return recording
    finding = Finding("note", "camera", note)
    return replace(recording, notes=(*recording.notes, note), findings=(*recording.findings, finding))


def _truth_from_start(recording: Recording) -> Array | None:
    """True poses (n, 3) at the scans, in the frame of the first one."""
    if recording.truth is None:
        return None
    poses = recording.truth.at(recording.stamps)
    return geometry.between(poses[0], poses)


class _Clock:
    """Writes what each phase of one scan took, but for the compiling of kernels."""

    def __init__(self, seconds: dict[str, Array], scan: int) -> None:
        self._seconds, self._scan, self._last = seconds, scan, clock()

    def lap(self, phase: str) -> None:
        now = clock()
        self._seconds[phase][self._scan] = now - self._last
        self._last = now
