"""Collected scans and contents as entities of a Rerun recording. Draws what they hold and estimates nothing."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.viewer import archetypes, colors, entities, pages, style
from pfslam_viz.viewer.blueprint import blueprint
from pfslam_viz.viewer.colors import Color
from pfslam_viz.viewer.contents import Boxes, Cells, TimedContent
from pfslam_viz.viewer.entities import ONLY_RUN, RUN_CURVES, Entity
from pfslam_viz.viewer.framing import Framing, out_of_view
from pfslam_viz.viewer.scan_batch import ScanBatch, distance, error_levels
from pfslam_viz.viewer.sinks import Sink
from pfslam_viz.viewer.trail import Points, Trail

Array = NDArray[np.float64]

CORRECTION_SCALE = 10.0
CHUNK_BYTES = 2_000_000  # of maps or textures that are sent at once: what a viewer has to take in at a time


class Drawing:
    """One run, drawn to a sink: :meth:`draw` what was collected, then :meth:`finish`.

    Args:
        recording: what is replayed.
        config: with which settings.
        sink: where it goes.
        max_particles: at most so many of a scan are drawn; None: as many as there are.
        run: what the run is called in the paths of its entities.
        color: the run's colour.
        shared: whether to draw what runs have in common: dead reckoning and truth.
        relative: whether N_eff is plotted as a share of the particles, so that runs of different numbers compare.
    """

    def __init__(
        self,
        recording: Recording,
        config: Config,
        sink: Sink,
        max_particles: int | None,
        *,
        run: str = ONLY_RUN,
        color: Color = colors.FILTER,
        shared: bool = True,
        relative: bool = False,
    ) -> None:
        self.recording, self.config, self.sink, self.run = recording, config, sink, run
        self.logged: set[str] = set()
        self._max_particles, self._shared = max_particles or config.particles, shared
        self._trails: dict[Entity, Trail] = {}
        self._relative = relative
        self._spreads = np.zeros(0)
        self._turned = 0.0  # degrees, by the last scan
        self.color = color
        style.style_run(sink, run, color, _camera(recording, config), config.particles)
        if shared:
            style.style_shared(sink, recording)

    def draw(self, scans: ScanBatch | None, contents: Sequence[TimedContent]) -> None:
        """Draw the scans and the contents, and push them to where they go, once the ones before have got there."""
        self.sink.check()
        if scans is not None:
            self._draw_run(scans)
            self._draw_plots(scans)
            if self._shared:
                self._draw_shared(scans)
        by_path: dict[tuple[str, str], list[TimedContent]] = {}
        for content in contents:
            by_path.setdefault((content.path, content.part), []).append(content)
        for (path, part), shown in by_path.items():
            self.logged.add(path)
            self._draw_contents(f"{path}/{part}" if part else path, shown)
        self.sink.push()

    def finish(self, framing: Framing | None, left_out: Sequence[str], result: Result) -> None:
        """Everything is drawn: settle the particles' own view; with ``framing``, the pages and the layout too."""
        if len(self._spreads):
            style.log_loupe(self.sink, self.run, float(np.percentile(self._spreads, 75)))
        if framing is not None:
            send_scene([self], framing, left_out, [result])

    def point_out(self, framing: Framing, result: Result) -> None:
        """Say where dead reckoning is while it is outside of the picture; of the run that draws what is shared."""
        if not self._shared or not len(result.stamps):
            return
        rows, pointers = out_of_view(framing, result.dead_reckoning)
        seconds = result.stamps[rows] - self.recording.stamps[0]
        labels = [f"{far:.0f} m" for far in pointers.beyond]
        z = entities.OUT_OF_VIEW.z
        columns = archetypes.pointer_columns(pointers.origins, pointers.vectors, labels, pointers.beyond > 0, z)
        self._send_rows(entities.OUT_OF_VIEW.path(self.run), rows, seconds, columns)

    # Batches of scans ------------------------------------------------------------------------------------------------

    def _send(self, row: Entity, scans: ScanBatch, columns: Any) -> None:
        self._send_rows(row.path(self.run), scans.index, scans.time, columns)

    def _send_rows(self, path: str, steps: Any, seconds: Any, columns: Any) -> None:
        self.logged.add(path)
        self.sink.send_columns(path, archetypes.time_columns(steps, seconds), columns)

    def _draw_run(self, scans: ScanBatch) -> None:
        particles, headings = archetypes.particle_columns(scans, self._max_particles, entities.PARTICLES.z)
        self._send(entities.PARTICLES, scans, particles)
        self._send(entities.HEADINGS, scans, headings)
        hits = scans.hits.values
        for row, mask in ((entities.SCAN_HIT, hits), (entities.SCAN_MISS, ~hits)):
            self._send(row, scans, archetypes.point_columns(scans.end_points.where(mask), row.z))
        self._send_poses(entities.ROBOT, scans, scans.best)
        self._send_poses(entities.MEAN, scans, scans.mean)
        ellipses = archetypes.ellipse_columns(scans.mean, scans.covariance, entities.COVARIANCE.z)
        self._send(entities.COVARIANCE, scans, ellipses)
        self._send(entities.FOLLOW, scans, archetypes.position_columns(scans.best, entities.FOLLOW.z))
        self._send_trail(entities.TRAJECTORY, scans, scans.best, scans.revised)
        if scans.truth is not None:
            self._send_error_trail(entities.ERROR_TRAJECTORY, scans, scans.best, scans.truth)
        if scans.correction is not None:
            c, s = np.cos(scans.best[:, 2]), np.sin(scans.best[:, 2])
            x, y = scans.correction[:, 0], scans.correction[:, 1]
            arrows = CORRECTION_SCALE * np.stack([c * x - s * y, s * x + c * y], axis=-1)
            starts = scans.best[:, :2] - arrows
            self._send(entities.CORRECTION, scans, archetypes.arrow_columns(starts, arrows, entities.CORRECTION.z))
            lines = [
                np.zeros((0, 2)) if axis is None else pose[:2] + np.array([[-1.0], [1.0]]) * axis
                for pose, axis in zip(scans.best, scans.degenerate, strict=True)
            ]
            self._send(entities.DEGENERATE, scans, archetypes.strip_columns(lines, entities.DEGENERATE.z))

    def _draw_shared(self, scans: ScanBatch) -> None:
        end_points = archetypes.point_columns(scans.dead_reckoning_end_points, entities.RECKONED_SCAN.z)
        self._send(entities.RECKONED_SCAN, scans, end_points)
        self._send_poses(entities.RECKONED_ROBOT, scans, scans.dead_reckoning)
        self._send_trail(entities.RECKONED_TRAJECTORY, scans, scans.dead_reckoning)
        if scans.truth is not None:
            self._send_poses(entities.TRUE_ROBOT, scans, scans.truth)
            self._send_trail(entities.TRUE_TRAJECTORY, scans, scans.truth)
            self._send_error_trail(entities.RECKONED_ERROR_TRAJECTORY, scans, scans.dead_reckoning, scans.truth)
            error = archetypes.scalar_columns(distance(scans.dead_reckoning, scans.truth))
            self._send(entities.RECKONED_ERROR, scans, error)

    def _send_poses(self, row: Entity, scans: ScanBatch, poses: Array) -> None:
        self._send(row, scans, archetypes.pose_columns(poses, row.z))

    def _send_trail(
        self, row: Entity, scans: ScanBatch, poses: Array, revised: Sequence[Points | None] | None = None
    ) -> None:
        self._extend_trail(row, scans, poses[:, :2], archetypes.strip_columns, revised)

    def _send_error_trail(self, row: Entity, scans: ScanBatch, poses: Array, truth: Array) -> None:
        levels = error_levels(distance(poses, truth))
        self._extend_trail(row, scans, np.column_stack([poses[:, :2], levels]), archetypes.error_columns)

    def _extend_trail(
        self,
        row: Entity,
        scans: ScanBatch,
        points: Array,
        columns: Callable[..., Any],
        revised: Sequence[Points | None] | None = None,
    ) -> None:
        trail = self._trails.setdefault(row, Trail(len(self.recording), points.shape[1]))
        done, between, open_strips = trail.extend(points, revised)
        *paths, latest = row.visible(self.run)
        self._send_rows(latest, scans.index, scans.time, columns(open_strips, row.z))
        for path, strips in zip(paths, (done, between), strict=True):
            if strips:
                rows = [k for k, _ in strips]
                self._send_rows(path, scans.index[rows], scans.time[rows], columns([s for _, s in strips], row.z))

    def _draw_plots(self, scans: ScanBatch) -> None:
        curves: dict[str, Any] = {
            **scans.curves,
            "drift": distance(scans.best, scans.dead_reckoning),
            "heading_drift": self._heading_drift(scans),
            "spread": np.sqrt(np.maximum(np.trace(scans.covariance, axis1=1, axis2=2), 0.0)),
        }
        self._spreads = np.concatenate([self._spreads, curves["spread"]])
        if scans.truth is not None:
            curves["error"] = distance(scans.best, scans.truth)
        particles = scans.weights.lengths if self._relative else np.ones(len(scans))
        curves["n_eff"] = curves["n_eff"] / particles
        for name, values in curves.items():
            self._send(RUN_CURVES[name], scans, archetypes.scalar_columns(values))
        if self.config.resampling.policy == "n_eff":  # marks at every scan would say nothing
            self._send_some(entities.RESAMPLED, scans, np.flatnonzero(scans.resampled), np.zeros(len(scans)))
            limits = self.config.resampling.threshold * scans.weights.lengths / particles
            ends = np.unique([0, len(scans) - 1])  # of a straight line
            self._send_some(entities.N_EFF_LIMIT, scans, ends, limits)

    def _heading_drift(self, scans: ScanBatch) -> Array:
        """Degrees that dead reckoning has turned further than the filter, signed, whole turns counted."""
        apart = np.degrees(geometry.wrap(scans.dead_reckoning[:, 2] - scans.best[:, 2]))
        unwrapped = np.unwrap(np.concatenate([[self._turned], apart]), period=360.0)[1:]
        self._turned = float(unwrapped[-1])
        return unwrapped

    def _send_some(self, row: Entity, scans: ScanBatch, rows: Any, values: Any) -> None:
        """``values`` (n,), but only those at ``rows``."""
        if len(rows):
            columns = archetypes.scalar_columns(values[rows])
            self._send_rows(row.path(self.run), scans.index[rows], scans.time[rows], columns)

    def _draw_contents(self, path: str, contents: Sequence[TimedContent]) -> None:
        """Contents of one entity; few at a time where they are large."""
        if path not in self.logged and isinstance(contents[0].content, Boxes):
            style.style_walls(self.sink, path)
        largest = max(p.content.values.nbytes if isinstance(p.content, Cells) else 0 for p in contents)
        at_once = max(CHUNK_BYTES // largest, 1) if largest else len(contents)
        for k in range(0, len(contents), at_once):
            some = contents[k : k + at_once]
            columns = archetypes.content_columns([p.content for p in some])
            self._send_rows(path, [p.step for p in some], [p.seconds for p in some], columns)


def _camera(recording: Recording, config: Config) -> CameraGeometry | None:
    """The camera that the floor was painted with; the robot file's where none is painted."""
    if recording.frames is None:
        return None
    if not config.texture.enabled:
        return recording.frames.camera
    from pfslam_viz.texture.floor_camera import find_camera  # loads OpenCV

    return find_camera(recording.frames, config.texture.camera).geometry


def send_scene(
    drawings: Sequence[Drawing],
    framing: Framing,
    left_out: Sequence[str] | None = None,
    results: Sequence[Result] = (),
) -> None:
    """Send the framing, the pages and the layout for these runs over one recording, which share a sink.

    Before the run (``left_out`` None) they say what can be there. The final ones say what is and what came of it
    (``results``, one for each of the drawings), and leave the layout of viewers that watch alone: somebody may have
    moved a panel.
    """
    final = left_out is not None
    sink, recording = drawings[0].sink, drawings[0].recording
    style.log_framing(sink, framing, recording.truth is not None)
    if results:
        drawings[0].point_out(framing, results[0])
    names = [drawing.run for drawing in drawings]
    colors = {drawing.run: drawing.color for drawing in drawings}
    logged = {path for drawing in drawings for path in drawing.logged} if final else None
    style.log_page(sink, entities.HELP, pages.help_page(colors, logged))
    style.log_page(sink, entities.LEGEND, pages.legend_page(colors, recording))
    style.log_page(sink, entities.FILTER_LEGEND, pages.filter_legend_page(colors))
    found = dict(zip(names, results, strict=False))
    about = pages.about_page(recording, [drawing.config for drawing in drawings], left_out or (), found)
    style.log_page(sink, entities.ABOUT, about)
    particles = drawings[0].config.particles
    layout = blueprint(recording, framing, names, particles, live=sink.live and not final)
    sink.send_blueprint(layout, live=not final)
