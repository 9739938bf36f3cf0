"""Every Step of a replay, as entities of a Rerun recording. Draws what the steps hold and estimates nothing."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import LoopClosure
from pfslam_viz.step import Step
from pfslam_viz.viewer import block, entities, pages, pictures, style
from pfslam_viz.viewer.ancestry import Ancestry
from pfslam_viz.viewer.blueprint import blueprint
from pfslam_viz.viewer.camera_images import CameraImages
from pfslam_viz.viewer.entities import LIDAR_Z, PARTICLE_Z, POSE_Z, TRAIL_Z, TRUTH_Z, Entities
from pfslam_viz.viewer.framing import Framing
from pfslam_viz.viewer.sinks import Sink
from pfslam_viz.viewer.trail import Trail

if TYPE_CHECKING:
    from pfslam_viz.texture import FloorTexture

Array = NDArray[np.float64]

BLOCK_ROWS = 200
LIVE_SECONDS = 0.25  # a watched run is shown at least this often
MAP_FRAMES, TEXTURE_FRAMES, CAMERA_FRAMES, WALL_FRAMES = 200, 75, 200, 40
MAP_BYTES, TEXTURE_BYTES = 200_000_000, 150_000_000  # uncompressed: what the viewer has to hold
LINEAGES_EVERY = 10  # scans
HISTORY_POINTS = 1000
CORRECTION_SCALE = 10.0


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """Size against detail.

    ``map_every`` scans a map is logged; None spreads about 200 over the recording. At most ``max_particles`` and
    ``max_beams`` are drawn of a scan.
    """

    map_every: int | None = None
    max_particles: int = 500
    max_beams: int = 270


class ReplayStream:
    """Logs a replay to a sink: :meth:`log` each Step, then :meth:`finish` with the Result.

    Args:
        recording: what is replayed.
        config: with which settings.
        sink: where it goes.
        options: how much of it.
        prefix: the run's name where several runs share a recording; the paths then hold it in place of ``filter``.
        color: the run's colour.
        alone: whether this is the only run, so that it sends the pages, the framing and the layout too.
        shared: whether it logs what runs have in common: dead reckoning and truth.
    """

    def __init__(
        self,
        recording: Recording,
        config: Config,
        sink: Sink,
        options: StreamOptions | None = None,
        prefix: str = "",
        *,
        color: entities.Color = entities.FILTER,
        alone: bool = True,
        shared: bool = True,
    ) -> None:
        self.recording, self.config, self.sink = recording, config, sink
        self.options = options or StreamOptions()
        self.entities = Entities(prefix or "filter")
        self.logged: set[str] = set()
        self._alone, self._shared = alone, shared
        n = len(recording)
        self._maps = pictures.FrameBudget(n, MAP_FRAMES, MAP_BYTES, self.options.map_every)
        self._textures = pictures.FrameBudget(n, TEXTURE_FRAMES, TEXTURE_BYTES)
        self._walls = pictures.FrameBudget(n, WALL_FRAMES, MAP_BYTES)
        self._lineages = pictures.FrameBudget(n, 0, 0, every=LINEAGES_EVERY)
        span = (float(recording.stamps[0]) - 1.0, float(recording.stamps[-1]))
        self._camera = CameraImages(recording.frames, span, CAMERA_FRAMES)
        self._ancestry = Ancestry()
        self._trails: dict[str, Trail] = {}
        self._closures: list[LoopClosure] = []
        self._last: Step | None = None
        self._block = block.Block()
        self._flushed = time.monotonic()
        self._spreads = np.zeros(0)
        self._counts = {"particles": 0, "beams": 0}
        style.style_run(sink, self.entities, color, recording.frames)
        if shared:
            style.style_shared(sink, recording)
        if alone:
            send_scene(sink, recording, [self], Framing.of_recording(recording))
        sink.before_close(self._close)

    def log(self, step: Step) -> None:
        """Log one scan. Scans are gathered and sent in blocks; maps and images when they are due."""
        self._last = step
        estimate = step.estimate
        lineages = self._ancestry.add(estimate.particles, estimate.parents)
        self._block.add(step, self.options.max_particles, self.options.max_beams, lineages)
        self._counts["particles"] = max(self._counts["particles"], len(estimate.weights))
        self._counts["beams"] = max(self._counts["beams"], len(step.end_points))
        self._log_pictures(step)
        now = time.monotonic()
        if len(self._block) == BLOCK_ROWS or (self.sink.live and now - self._flushed > LIVE_SECONDS):
            self.flush()
            self.sink.check()
            self._flushed = now

    def finish(self, result: Result) -> None:
        """Log what is known only at the end: the last maps, the trajectory in hindsight, the final framing."""
        self.flush()
        if self._last is not None:
            style.log_loupe(self.sink, self.entities, float(np.percentile(self._spreads, 75)))
            self._log_maps(self._last, result.grid, result.dead_reckoning_grid)
            self._log_now(self.entities.filter("walls"), self._last, pictures.walls(result.grid))
            if result.texture is not None:
                self._log_texture(self._last, result.texture, always=True)
            if hindsight_differs(result):
                self._log_lines("hindsight", self._last, [result.estimate], TRAIL_Z)
            self._log_closures(self._last, result.closures)
        if self._alone and len(result.stamps):
            send_scene(self.sink, self.recording, [self], Framing.of_results([result]), final=True)

    def flush(self) -> None:
        """Send the scans gathered so far."""
        done, self._block = self._block, block.Block()
        if len(done):
            self._send_run(done)
            self._send_plots(done)
            if self._shared:
                self._send_shared(done)

    @property
    def left_out(self) -> list[str]:
        """What the recording does not hold, a phrase each."""
        out = []
        for what, most in (("particles", self.options.max_particles), ("beams", self.options.max_beams)):
            total = self._counts[what]
            shown = len(range(0, total, block.stride(total, most)))
            if shown < total:
                out.append(f"{what}: {shown:,} of {total:,} drawn (--max-{what})")
        done = 0 if self._last is None else self._last.index + 1
        if self._maps.logged < done:
            out.append(f"maps: {self._maps.logged:,} of {done:,} scans have one (--map-every)")
        if self._textures.skipped:
            out.append(f"textures: {self._textures.logged:,} of {self._textures.logged + self._textures.skipped:,}")
        if self._camera.logged < self._camera.available:
            out.append(f"camera images: {self._camera.logged:,} of {self._camera.available:,} of a kind")
        return out

    # Blocks of scans --------------------------------------------------------------------------------------------------

    def _send(self, path: str, done: block.Block, columns: Any) -> None:
        self.logged.add(path)
        self.sink.send_columns(path, done.times(), columns)

    def _send_run(self, done: block.Block) -> None:
        path = self.entities.filter
        particles, headings = block.particle_columns(done, PARTICLE_Z)
        self._send(path("particles"), done, particles)
        self._send(path("headings"), done, headings)
        hits, misses = block.split(done.end_points, done.hits)
        self._send(path("scan/hit"), done, block.point_columns(hits, LIDAR_Z))
        self._send(path("scan/miss"), done, block.point_columns(misses, LIDAR_Z))
        self._send(path("robot"), done, block.pose_columns(done.best, POSE_Z))
        self._send(path("mean"), done, block.pose_columns(done.mean, POSE_Z))
        self._send(path("covariance"), done, block.ellipse_columns(done.mean, done.covariance, POSE_Z))
        self._send(path("follow"), done, block.position_columns(done.best, 0.0))
        self._send_trail(path("trajectory"), done, done.best)
        if len(done.corrections) == len(done):
            best, moved = np.array(done.best), np.array(done.corrections)
            c, s = np.cos(best[:, 2]), np.sin(best[:, 2])
            x, y = moved[:, 0], moved[:, 1]
            arrows = CORRECTION_SCALE * np.stack([c * x - s * y, s * x + c * y], axis=-1)
            self._send(path("correction"), done, block.arrow_columns(best[:, :2] - arrows, arrows, POSE_Z))
            lines = [
                np.zeros((0, 2)) if axis is None else pose[:2] + np.array([[-1.0], [1.0]]) * axis
                for pose, axis in zip(best, done.degenerate, strict=True)
            ]
            self._send(path("degenerate"), done, block.strip_columns(lines, POSE_Z))

    def _send_shared(self, done: block.Block) -> None:
        path = entities.dead_reckoning
        self._send(path("scan"), done, block.point_columns(done.dead_reckoning_end_points, LIDAR_Z))
        self._send(path("robot"), done, block.pose_columns(done.dead_reckoning, POSE_Z))
        self._send_trail(path("trajectory"), done, done.dead_reckoning)
        if done.truth:
            self._send(entities.truth("robot"), done, block.pose_columns(done.truth, POSE_Z))
            self._send_trail(entities.truth("trajectory"), done, done.truth, TRUTH_Z)
            error = np.subtract(done.dead_reckoning, done.truth)
            distance = np.hypot(error[:, 0], error[:, 1])
            self._send(entities.shared_plot("error", "dead_reckoning"), done, block.scalar_columns(distance))

    def _send_trail(self, path: str, done: block.Block, poses: Sequence[Array], z: float = TRAIL_Z) -> None:
        trail = self._trails.setdefault(path, Trail(len(self.recording)))
        finished, open_strips = trail.extend(poses)
        self._send(f"{path}/open", done, block.strip_columns(open_strips, z))
        if finished:
            rows = [row for row, _ in finished]
            times = block.time_columns([done.steps[r] for r in rows], [done.seconds[r] for r in rows])
            self.logged.add(f"{path}/done")
            columns = block.strip_columns([strip for _, strip in finished], z)
            self.sink.send_columns(f"{path}/done", times, columns)

    def _send_plots(self, done: block.Block) -> None:
        best, reckoned = np.array(done.best), np.array(done.dead_reckoning)
        covariance = np.array(done.covariance)
        apart = best - reckoned
        curves: dict[str, Any] = {
            **{name: values for name, values in done.curves.items() if len(values) == len(done)},
            "drift": np.hypot(apart[:, 0], apart[:, 1]),
            "heading_drift": np.degrees(np.abs(geometry.wrap(apart[:, 2]))),
            "spread": np.sqrt(np.maximum(np.trace(covariance, axis1=1, axis2=2), 0.0)),
        }
        self._spreads = np.concatenate([self._spreads, curves["spread"]])
        if done.truth:
            error = best - np.array(done.truth)
            curves["error"] = np.hypot(error[:, 0], error[:, 1])
        for name, values in curves.items():
            self._send(self.entities.plot(name), done, block.scalar_columns(values))

    # Pictures, now and then -------------------------------------------------------------------------------------------

    def _log_now(self, path: str, step: Step, *archetypes: Any) -> None:
        self.logged.add(path)
        self.sink.set_time(step.index, step.time)
        self.sink.log(path, *archetypes)

    def _log_lines(self, name: str, step: Step, lines: Any, z: float) -> None:
        self._log_now(self.entities.filter(name), step, rr.LineStrips3D(block.strips(lines, z)))

    def _log_pictures(self, step: Step) -> None:
        estimate = step.estimate
        if self._maps.is_due(step.index):
            self._maps.spend(step.index, self._log_maps(step, step.grid, step.dead_reckoning_grid))
            if estimate.history is not None:
                thinned = estimate.history[:: block.stride(len(estimate.history), HISTORY_POINTS)]
                self._log_lines("history", step, [np.vstack([thinned, estimate.history[-1:]])], TRAIL_Z)
        if self._lineages.is_due(step.index):
            self._lineages.spend(step.index, 0)
            self._log_lines("lineages", step, self._ancestry.segments(), LIDAR_Z)
        if self._walls.is_due(step.index):
            self._walls.spend(step.index, 0)
            self._log_now(self.entities.filter("walls"), step, pictures.walls(step.grid))
        if step.texture is not None:
            self._log_texture(step, step.texture)
        self._log_closures(step, estimate.closures)
        for kind, contents in self._camera.due(step.stamp):
            path = self.entities.filter("robot/camera") if kind == "color" else self.entities.disparity_image
            self._log_now(path, step, pictures.encoded(contents))

    def _log_closures(self, step: Step, closures: Sequence[LoopClosure]) -> None:
        """Add newly closed loops to those that are drawn."""
        if closures:
            self._closures += closures
            pairs = [np.stack([c.earlier_position, c.later_position]) for c in self._closures]
            self._log_lines("closures", step, pairs, POSE_Z)

    def _log_maps(self, step: Step, grid: OccupancyGrid, reckoned: OccupancyGrid) -> int:
        drawn, size = pictures.grid_map(grid)
        self._log_now(self.entities.filter("map"), step, drawn)
        if self._shared:
            drawn, more = pictures.grid_map(reckoned)
            self._log_now(entities.dead_reckoning("map"), step, drawn)
            size += more
        return size

    def _log_texture(self, step: Step, texture: "FloorTexture", always: bool = False) -> None:
        if always or self._textures.is_due(step.index):
            drawn, size = pictures.texture_map(texture)
            self._textures.spend(step.index, size)
            self._log_now(self.entities.filter("texture"), step, drawn)
        else:
            self._textures.skipped += 1

    def _close(self) -> None:
        self.flush()
        self._camera.close()


def hindsight_differs(result: Result) -> bool:
    """Whether the end knows another trajectory than the one that was estimated on the way (by a millimetre)."""
    estimate, online = result.estimate, result.online
    return len(estimate) == len(online) and not np.allclose(estimate[:, :2], online[:, :2], rtol=0.0, atol=1e-3)


def send_scene(
    sink: Sink, recording: Recording, runs: Sequence[ReplayStream], framing: Framing, final: bool = False
) -> None:
    """Send the framing, the pages and the layout for these runs.

    Before the run they say what can be there. ``final`` ones say what is, and leave the layout of viewers that watch
    alone: somebody may have moved a panel.
    """
    style.log_framing(sink, framing)
    names = [run.entities.run for run in runs]
    logged = {path for run in runs for path in run.logged} if final else None
    left_out = list(dict.fromkeys(phrase for run in runs for phrase in run.left_out)) if final else []
    style.log_page(sink, entities.HELP, pages.help_page(names, logged))
    about = pages.about_page(recording, [run.config for run in runs], left_out)
    style.log_page(sink, entities.ABOUT, about)
    if final:
        sink.send_blueprint(blueprint(recording, framing, names, live=False), live=False)
    else:
        sink.send_blueprint(blueprint(recording, framing, names, live=sink.live))
