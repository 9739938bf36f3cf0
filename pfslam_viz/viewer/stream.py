"""Every Step of a replay, as entities of a Rerun recording. Draws what the steps hold and estimates nothing."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Frames, Recording
from pfslam_viz.replay import Result
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import LoopClosure
from pfslam_viz.step import Step
from pfslam_viz.viewer import entities, pictures, rows
from pfslam_viz.viewer.ancestry import Ancestry
from pfslam_viz.viewer.entities import Entities
from pfslam_viz.viewer.framing import Framing, overhead_camera
from pfslam_viz.viewer.sinks import Sink

Array = NDArray[np.float64]

BLOCK_ROWS = 200
LIVE_SECONDS = 0.25  # a watched run is shown at least this often
MAP_FRAMES, TEXTURE_FRAMES, CAMERA_FRAMES = 200, 150, 300
MAP_BYTES, TEXTURE_BYTES = 200_000_000, 300_000_000  # uncompressed: what the viewer has to hold
HEADINGS = 60  # arrows a scan
HEADING_LENGTH = 0.25  # m
CORRECTION_SCALE = 10.0
FOLLOW_HEIGHT = 9.0  # m of floor that the close-up shows
LOUPE_HEIGHT = 1.0  # m of floor that the particles' own view shows


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
        shared: whether this stream logs what all runs share: dead reckoning, truth, pages, cameras, the layout.
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
        shared: bool = True,
    ) -> None:
        self.recording, self.config, self.sink = recording, config, sink
        self.options = options or StreamOptions()
        self.entities = Entities(prefix or "filter")
        self.color, self.shared = color, shared
        n = len(recording)
        self.rows = rows.Rows(sink)
        self._maps = pictures.FrameBudget(n, MAP_FRAMES, MAP_BYTES, self.options.map_every)
        self._textures = pictures.FrameBudget(n, TEXTURE_FRAMES, TEXTURE_BYTES)
        self._camera = _CameraImages(recording.frames)
        self._ancestry = Ancestry()
        self._trails: dict[str, _Trail] = {}
        self._closures: list[LoopClosure] = []
        self._last: Step | None = None
        self._flushed = time.monotonic()
        self._thinned: dict[str, tuple[int, int]] = {}
        self._log_static()
        if shared:
            self._log_shared_static()
            log_framing(sink, Framing.of_recording(recording))
            self._send_blueprint(Framing.of_recording(recording), live=True)
            self._log_pages(planned=True)
        sink.before_close(self.rows.flush)

    def log(self, step: Step) -> None:
        """Log one scan. Rows are gathered and sent in blocks; maps and images when they are due."""
        self._last = step
        self._log_filter(step)
        if self.shared:
            self._log_dead_reckoning(step)
            self._log_truth(step)
        self._log_plots(step)
        self._log_pictures(step)
        now = time.monotonic()
        if (step.index + 1) % BLOCK_ROWS == 0 or (self.sink.live and now - self._flushed > LIVE_SECONDS):
            self.rows.flush()
            self.sink.check()
            self._flushed = now

    def finish(self, result: Result) -> None:
        """Log what is known only at the end: the last maps, the trajectory in hindsight, the final framing."""
        if self._last is not None:
            self._log_maps(self._last, result.grid, result.dead_reckoning_grid)
            if self.hindsight_differs(result):
                self._row("hindsight", rows.strip_at(entities.TRAIL_Z), self._last, result.estimate)
        self.rows.flush()
        if self.shared and len(result.stamps):
            framing = Framing.of_results([result])
            log_framing(self.sink, framing)
            self._send_blueprint(framing, live=False)
            self._log_pages(planned=False)

    @staticmethod
    def hindsight_differs(result: Result) -> bool:
        """Whether the end knows another trajectory than the one that was estimated on the way (by a millimetre)."""
        estimate, online = result.estimate, result.online
        return len(estimate) == len(online) and not np.allclose(estimate[:, :2], online[:, :2], rtol=0.0, atol=1e-3)

    @property
    def left_out(self) -> list[str]:
        """What the recording does not hold, a sentence each."""
        out = [
            f"{what}: {shown:,} of {total:,} drawn (--max-{what})"
            for what, (shown, total) in self._thinned.items()
            if shown < total
        ]
        done = 0 if self._last is None else self._last.index + 1
        if self._maps.logged < done:
            out.append(f"maps: {self._maps.logged:,} of {done:,} scans have one (--map-every)")
        if self._textures.skipped:
            out.append(f"textures: {self._textures.logged:,} of {self._textures.logged + self._textures.skipped:,}")
        if self._camera.logged < self._camera.seen:
            out.append(f"camera images: {self._camera.logged:,} of {self._camera.seen:,} of each kind")
        return out

    # What is drawn of a step ------------------------------------------------------------------------------------------

    def _row(self, name: str, encode: rows.Encoder, step: Step, value: Any) -> None:
        self.rows.add(self.entities.filter(name), encode, step.index, step.time, value)

    def _log_filter(self, step: Step) -> None:
        estimate = step.estimate
        self._log_particles(step)
        kept = self._thin("beams", len(step.end_points), self.options.max_beams)
        points, hits = rows.rounded(step.end_points[kept]), step.hits[kept]
        self._row("scan/hit", _LIDAR, step, points[hits])
        self._row("scan/miss", _LIDAR, step, points[~hits])
        self._row("robot", _POSE, step, estimate.best)
        self._row("mean", _POSE, step, estimate.mean)
        self._row("follow", _POSITION, step, estimate.best)
        self._row("covariance", _ELLIPSE, step, (estimate.mean[:2], _two_sigma(estimate.covariance[:2, :2])))
        self._trail(self.entities.filter("trajectory"), step, estimate.best)
        match = estimate.match
        if match is not None:
            pose = estimate.best
            moved = geometry.transform([0.0, 0.0, pose[2]], match.correction[None, :2])[0]
            self._row("correction", _ARROW, step, (pose[:2] - CORRECTION_SCALE * moved, CORRECTION_SCALE * moved))
            open_direction = np.zeros((0, 2))
            if match.degenerate is not None:
                open_direction = pose[:2] + np.array([[-1.0], [1.0]]) * match.degenerate
            self._row("degenerate", _POSE_STRIP, step, open_direction)
        if estimate.closures:
            self._closures += estimate.closures
            pairs = [np.stack([c.earlier_position, c.later_position]) for c in self._closures]
            self._log_now("closures", step, rr.LineStrips3D([rows.lifted(p, entities.POSE_Z) for p in pairs]))

    def _log_particles(self, step: Step) -> None:
        particles, weights = step.estimate.particles, step.estimate.weights
        order = np.argsort(weights, kind="stable")  # runs of one colour pack well, and the heaviest lie on top
        order = order[::-1][self._thin("particles", len(order), self.options.max_particles)][::-1]
        levels = len(entities.WEIGHT_RAMP)
        level = np.minimum((weights[order] / max(weights.max(), 1e-300) * levels).astype(np.intp), levels - 1)
        spread = float(np.sqrt(max(np.trace(step.estimate.covariance[:2, :2]), 0.0)))
        positions = rows.rounded(particles[order], float(np.clip(spread / 4, 0.001, 0.01)))
        self._row("particles", _PARTICLES, step, (positions, level))
        some = slice(None, None, -max(-(-len(order) // HEADINGS), 1))
        heading = np.round(particles[order, 2][some] * 60.0) / 60.0
        vectors = HEADING_LENGTH * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        self._row("headings", _HEADINGS, step, (positions[some], vectors, level[some]))

    def _log_dead_reckoning(self, step: Step) -> None:
        kept = self._thin("beams", len(step.dead_reckoning_end_points), self.options.max_beams)
        path = self.entities.dead_reckoning
        add = self.rows.add
        points = rows.rounded(step.dead_reckoning_end_points[kept])
        add(path("scan"), _LIDAR, step.index, step.time, points)
        add(path("robot"), _POSE, step.index, step.time, step.dead_reckoning)
        self._trail(path("trajectory"), step, step.dead_reckoning)

    def _log_truth(self, step: Step) -> None:
        if step.truth is not None:
            self.rows.add(self.entities.truth("robot"), _POSE, step.index, step.time, step.truth)
            self._trail(self.entities.truth("trajectory"), step, step.truth)

    def _trail(self, path: str, step: Step, pose: Array) -> None:
        trail = self._trails.setdefault(path, _Trail(len(self.recording)))
        done = trail.add(pose)
        if done is not None:
            self.rows.add(f"{path}/done", _TRAIL, step.index, step.time, done)
        self.rows.add(f"{path}/open", _TRAIL, step.index, step.time, trail.open())

    def _log_plots(self, step: Step) -> None:
        estimate = step.estimate
        best, reckoned = estimate.best, step.dead_reckoning
        curves = {
            "drift": _distance(best, reckoned),
            "heading_drift": float(np.degrees(abs(geometry.wrap(best[2] - reckoned[2])))),
            "n_eff": estimate.n_eff,
            "spread": float(np.sqrt(max(estimate.covariance[0, 0] + estimate.covariance[1, 1], 0.0))),
            "correlation": float(step.hits.mean()) if len(step.hits) else 0.0,
            "lineages": float(self._ancestry.add(estimate.particles, estimate.parents)),
        }
        if estimate.match is not None:
            curves["score"] = estimate.match.score
            curves["correction"] = float(np.hypot(*estimate.match.correction[:2]))
        if step.truth is not None:
            curves["error"] = _distance(best, step.truth)
        add = self.rows.add
        for name, value in curves.items():
            add(self.entities.plot(name), rows.scalars, step.index, step.time, value)
        if self.shared and step.truth is not None:
            path = self.entities.shared_plot("error", "dead_reckoning")
            add(path, rows.scalars, step.index, step.time, _distance(reckoned, step.truth))

    # Pictures, now and then -------------------------------------------------------------------------------------------

    def _log_now(self, name: str, step: Step, archetype: Any, path: str | None = None) -> None:
        path = path or self.entities.filter(name)
        self.rows.logged.add(path)
        self.sink.set_time(step.index, step.time)
        self.sink.log(path, archetype)

    def _log_pictures(self, step: Step) -> None:
        if self._maps.is_due(step.index):
            self._maps.spend(step.index, self._log_maps(step, step.grid, step.dead_reckoning_grid))
            segments = [rows.lifted(s, entities.PARTICLE_Z) for s in self._ancestry.segments()]
            self._log_now("lineages", step, rr.LineStrips3D(segments))
            if step.estimate.history is not None:
                strip = rows.lifted(step.estimate.history, entities.TRAIL_Z)
                self._log_now("history", step, rr.LineStrips3D([strip]))
        if step.texture is not None and self._textures.is_due(step.index):
            self._textures.spend(step.index, self._log_texture(step))
        for kind, contents in self._camera.due(step.stamp):
            path = self.entities.filter("robot/camera") if kind == "color" else self.entities.disparity_image
            self._log_now("", step, pictures.encoded(contents), path)

    def _log_maps(self, step: Step, grid: OccupancyGrid, reckoned: OccupancyGrid) -> int:
        drawn, size = pictures.grid_map(grid)
        self._log_now("map", step, drawn)
        if self.shared:
            drawn, more = pictures.grid_map(reckoned)
            self._log_now("", step, drawn, self.entities.dead_reckoning("map"))
            size += more
        return size

    def _log_texture(self, step: Step) -> int:
        return 0

    def _thin(self, what: str, total: int, most: int) -> slice:
        stride = max(-(-total // max(most, 1)), 1)
        shown = len(range(0, total, stride))
        if total > self._thinned.get(what, (0, 0))[1]:
            self._thinned[what] = (shown, total)
        return slice(None, None, stride)

    # What stays ------------------------------------------------------------------------------------------------------

    def _log_static(self) -> None:
        path, color = self.entities.filter, self.color
        ui = rr.Radius.ui_points
        self._style(path("particles"), rr.Points3D.from_fields(radii=ui(2.0)))
        self._style(path("headings"), rr.Arrows3D.from_fields(radii=ui(1.0)))
        self._style(path("scan/hit"), rr.Points3D.from_fields(colors=entities.HIT, radii=ui(1.5)))
        self._style(path("scan/miss"), rr.Points3D.from_fields(colors=entities.MISS, radii=ui(1.5)))
        self._style(path("correction"), rr.Arrows3D.from_fields(colors=entities.MISS, radii=ui(1.5)))
        self._style(path("degenerate"), rr.LineStrips3D.from_fields(colors=entities.MISS, radii=ui(1.5)))
        for name, width in (("lineages", 0.75), ("history", 1.0), ("closures", 1.5), ("hindsight", 1.5)):
            self._style(path(name), rr.LineStrips3D.from_fields(colors=entities.HINDSIGHT, radii=ui(width)))
        self._style_trail(path("trajectory"), color)
        self._style_robot(path("robot"), color)
        cross = [[[-0.1, 0, 0], [0.1, 0, 0]], [[0, -0.1, 0], [0, 0.1, 0]]]
        self._style(path("mean"), rr.LineStrips3D(cross, colors=color, radii=ui(1.0)))
        angle = np.linspace(0.0, 2 * np.pi, 65)
        circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        self._style(path("covariance"), rr.LineStrips3D([circle], colors=color, radii=ui(1.0)))
        for name, height in (("close_up", FOLLOW_HEIGHT), ("loupe", LOUPE_HEIGHT)):
            for archetype in overhead_camera((0.0, 0.0), height, aspect=1.0):
                self._style(path(f"follow/{name}"), archetype)
        if self.recording.frames is not None:
            self._log_camera(self.recording.frames)
        for plot in ("drift", "heading_drift", "n_eff", "spread", "correlation", "score", "correction", "lineages"):
            self._style_curve(self.entities.plot(plot), color, self.entities.run)
        self._style_curve(self.entities.plot("error"), color, self.entities.run)

    def _log_shared_static(self) -> None:
        path = self.entities.dead_reckoning
        color = entities.DEAD_RECKONING
        self._style(path("scan"), rr.Points3D.from_fields(colors=color, radii=rr.Radius.ui_points(1.5)))
        self._style_trail(path("trajectory"), color)
        self._style_robot(path("robot"), color)
        self._style_curve(self.entities.shared_plot("error", "dead_reckoning"), color, "dead reckoning")
        if self.recording.truth is not None:
            self._style_trail(self.entities.truth("trajectory"), entities.TRUTH)
            self._style_robot(self.entities.truth("robot"), entities.TRUTH)

    def _style(self, path: str, archetype: Any) -> None:
        self.sink.log(path, archetype, static=True)

    def _style_trail(self, path: str, color: entities.Color) -> None:
        for part in ("done", "open"):
            style = rr.LineStrips3D.from_fields(colors=color, radii=rr.Radius.ui_points(1.5))
            self._style(f"{path}/{part}", style)

    def _style_robot(self, path: str, color: entities.Color) -> None:
        corners = np.array([[0.45, 0, 0], [-0.25, 0.25, 0], [-0.12, 0, 0], [-0.25, -0.25, 0]])
        self._style(
            f"{path}/shape",
            rr.Mesh3D(
                vertex_positions=corners,
                triangle_indices=[[0, 1, 2], [0, 2, 3]],
                vertex_normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
                vertex_colors=np.tile([*color, 255], (4, 1)),
            ),
        )
        outline = np.vstack([corners, corners[:1]])
        style = rr.LineStrips3D([outline], colors=color, radii=rr.Radius.ui_points(1.5))
        self._style(f"{path}/outline", style)

    def _style_curve(self, path: str, color: entities.Color, name: str) -> None:
        self._style(path, rr.SeriesLines(colors=color, widths=1.5, names=name.replace("_", " ")))

    def _log_camera(self, frames: Frames) -> None:
        camera, path = frames.camera, self.entities.filter("robot/camera")
        pose = camera.robot_from_optical()
        intrinsics = camera.intrinsics
        self._style(path, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        self._style(
            path,
            rr.Pinhole(
                focal_length=[intrinsics.fx / 2, intrinsics.fy / 2],
                principal_point=[intrinsics.cx / 2, intrinsics.cy / 2],
                width=intrinsics.width // 2,
                height=intrinsics.height // 2,
                camera_xyz=rr.ViewCoordinates.RDF,
                image_plane_distance=0.7,
                color=self.color,
            ),
        )

    def _log_pages(self, planned: bool) -> None:
        logged = None if planned else self.rows.logged
        page = entities.help_page([self.entities.run], logged)
        about = entities.about_page(self.recording, [self.config], [] if planned else self.left_out)
        for path, text in ((entities.HELP, page), (entities.ABOUT, about)):
            self._style(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))

    def _send_blueprint(self, framing: Framing, live: bool) -> None:
        from pfslam_viz.viewer.blueprint import blueprint

        layout = blueprint(self.recording, framing, [self.entities.run], live=live and self.sink.live)
        self.sink.send_blueprint(layout, live=live)


_LIDAR = rows.points_at(entities.LIDAR_Z)
_PARTICLES = rows.colored_points_at(entities.PARTICLE_Z)
_HEADINGS = rows.colored_arrows_at(entities.PARTICLE_Z)
_TRAIL = rows.strip_at(entities.TRAIL_Z)
_POSE_STRIP = rows.strip_at(entities.POSE_Z)
_POSE = rows.pose_at(entities.POSE_Z)
_POSITION = rows.position_at(0.0)
_ELLIPSE = rows.ellipse_at(entities.POSE_Z)
_ARROW = rows.arrow_at(entities.POSE_Z)


def log_framing(sink: Sink, framing: Framing) -> None:
    """Point the overview's camera at a piece of floor."""
    for archetype in overhead_camera(framing.center, framing.height):
        sink.log(Entities().overview_camera, archetype, static=True)


class _Trail:
    """A trajectory in two entities: ``done`` every √n scans, ``open`` at every scan from there on."""

    def __init__(self, scans: int) -> None:
        self._poses = np.empty((scans, 2), np.float32)
        self._count = self._start = 0
        self._every = max(int(np.sqrt(scans)), 2)

    def add(self, pose: Array) -> NDArray[np.float32] | None:
        """Append a pose; the whole trajectory when it is time for ``done``."""
        self._poses[self._count] = pose[:2]
        self._count += 1
        if (self._count - 1) % self._every or self._count == 1:
            return None
        self._start = self._count - 1
        return self._poses[: self._count]

    def open(self) -> NDArray[np.float32]:
        """From the last point of ``done`` to here."""
        return self._poses[self._start : self._count]


class _CameraImages:
    """The camera's frames of the moment, as many as the budget allows."""

    def __init__(self, frames: Frames | None) -> None:
        self.logged = self.seen = 0
        self._kinds: list[tuple[str, Array, list[Any], list[int]]] = []
        if frames is None:
            return
        for kind, stamps, paths in (
            ("color", frames.color_stamps, frames.color_paths),
            ("disparity", frames.disparity_stamps, frames.disparity_paths),
        ):
            there = [i for i, path in enumerate(paths) if path is not None]
            if there:
                self._kinds.append((kind, np.asarray(stamps)[there], [paths[i] for i in there], [-1]))
        self._every = max((-(-len(paths) // CAMERA_FRAMES) for _, _, paths, _ in self._kinds), default=1)

    def due(self, stamp: float) -> list[tuple[str, bytes]]:
        """Kind and JPEG of each frame that the moment brings."""
        out = []
        for kind, stamps, paths, last in self._kinds:
            current = int(np.searchsorted(stamps, stamp, side="right")) - 1
            if current < 0 or current == last[0]:
                continue
            if kind == "color":
                self.seen += current - last[0]
            due = last[0] < 0 or current // self._every != last[0] // self._every
            last[0] = current
            if not due:
                continue
            encode = pictures.color_jpeg if kind == "color" else pictures.disparity_jpeg
            contents = encode(paths[current])
            if contents is not None:
                out.append((kind, contents))
                self.logged += kind == "color"
        return out


def _two_sigma(covariance: Array) -> Array:
    """(2, 2) matrix whose columns are the axes of the two-sigma ellipse."""
    values, vectors = np.linalg.eigh(covariance)
    return 2.0 * vectors * np.sqrt(np.maximum(values, 0.0))


def _distance(a: Array, b: Array) -> float:
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))
