"""Blocks and pictures as entities of a Rerun recording. Draws what they hold and estimates nothing."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.viewer import archetypes, entities, pages, style
from pfslam_viz.viewer.block import Block
from pfslam_viz.viewer.blueprint import blueprint
from pfslam_viz.viewer.entities import ONLY_RUN, RUN_CURVES, Color, Entity
from pfslam_viz.viewer.framing import Framing
from pfslam_viz.viewer.pictures import Cells, Picture
from pfslam_viz.viewer.sinks import Sink
from pfslam_viz.viewer.trail import Trail

Array = NDArray[np.float64]

CORRECTION_SCALE = 10.0
CHUNK_BYTES = 2_000_000  # of maps or textures that are sent at once: what a viewer has to take in at a time


class Drawing:
    """One run, drawn to a sink: :meth:`draw` what was gathered, then :meth:`finish`.

    Args:
        recording: what is replayed.
        config: with which settings.
        sink: where it goes.
        max_particles: at most so many of a scan are drawn.
        run: what the run is called in the paths of its entities.
        color: the run's colour.
        shared: whether to draw what runs have in common: dead reckoning and truth.
    """

    def __init__(
        self,
        recording: Recording,
        config: Config,
        sink: Sink,
        max_particles: int,
        *,
        run: str = ONLY_RUN,
        color: Color = entities.FILTER,
        shared: bool = True,
    ) -> None:
        self.recording, self.config, self.sink, self.run = recording, config, sink, run
        self.logged: set[str] = set()
        self._max_particles, self._shared = max_particles, shared
        self._trails: dict[Entity, Trail] = {}
        self._spreads = np.zeros(0)
        style.style_run(sink, run, color, recording.frames)
        if shared:
            style.style_shared(sink, recording)

    def draw(self, block: Block | None, pictures: Sequence[Picture]) -> None:
        """Draw the scans and the pictures, and push them to where they go, once the ones before have got there."""
        self.sink.check()
        if block is not None:
            self._draw_run(block)
            self._draw_plots(block)
            if self._shared:
                self._draw_shared(block)
        by_path: dict[str, list[Picture]] = {}
        for picture in pictures:
            by_path.setdefault(picture.path, []).append(picture)
        for path, shown in by_path.items():
            self._draw_pictures(path, shown)
        self.sink.push()

    def finish(self, framing: Framing | None, left_out: Sequence[str]) -> None:
        """Everything is drawn: settle the particles' own view; with ``framing``, the pages and the layout too."""
        if len(self._spreads):
            style.log_loupe(self.sink, self.run, float(np.percentile(self._spreads, 75)))
        if framing is not None:
            send_scene([self], framing, left_out)

    # Blocks of scans --------------------------------------------------------------------------------------------------

    def _send(self, row: Entity, block: Block, columns: Any) -> None:
        self._send_rows(row.path(self.run), block.index, block.time, columns)

    def _send_rows(self, path: str, steps: Any, seconds: Any, columns: Any) -> None:
        self.logged.add(path)
        self.sink.send_columns(path, archetypes.time_columns(steps, seconds), columns)

    def _draw_run(self, block: Block) -> None:
        particles, headings = archetypes.particle_columns(block, self._max_particles, entities.PARTICLES.z)
        self._send(entities.PARTICLES, block, particles)
        self._send(entities.HEADINGS, block, headings)
        hits = block.hits.values
        for row, mask in ((entities.SCAN_HIT, hits), (entities.SCAN_MISS, ~hits)):
            self._send(row, block, archetypes.point_columns(block.end_points.where(mask), row.z))
        self._send_poses(entities.ROBOT, block, block.best)
        self._send_poses(entities.MEAN, block, block.mean)
        ellipses = archetypes.ellipse_columns(block.mean, block.covariance, entities.COVARIANCE.z)
        self._send(entities.COVARIANCE, block, ellipses)
        self._send(entities.FOLLOW, block, archetypes.position_columns(block.best, entities.FOLLOW.z))
        self._send_trail(entities.TRAJECTORY, block, block.best)
        if block.correction is not None:
            c, s = np.cos(block.best[:, 2]), np.sin(block.best[:, 2])
            x, y = block.correction[:, 0], block.correction[:, 1]
            arrows = CORRECTION_SCALE * np.stack([c * x - s * y, s * x + c * y], axis=-1)
            starts = block.best[:, :2] - arrows
            self._send(entities.CORRECTION, block, archetypes.arrow_columns(starts, arrows, entities.CORRECTION.z))
            lines = [
                np.zeros((0, 2)) if axis is None else pose[:2] + np.array([[-1.0], [1.0]]) * axis
                for pose, axis in zip(block.best, block.degenerate, strict=True)
            ]
            self._send(entities.DEGENERATE, block, archetypes.strip_columns(lines, entities.DEGENERATE.z))

    def _draw_shared(self, block: Block) -> None:
        end_points = archetypes.point_columns(block.dead_reckoning_end_points, entities.RECKONED_SCAN.z)
        self._send(entities.RECKONED_SCAN, block, end_points)
        self._send_poses(entities.RECKONED_ROBOT, block, block.dead_reckoning)
        self._send_trail(entities.RECKONED_TRAJECTORY, block, block.dead_reckoning)
        if block.truth is not None:
            self._send_poses(entities.TRUE_ROBOT, block, block.truth)
            self._send_trail(entities.TRUE_TRAJECTORY, block, block.truth)
            error = archetypes.scalar_columns(_distance(block.dead_reckoning, block.truth))
            self._send(entities.RECKONED_ERROR, block, error)

    def _send_poses(self, row: Entity, block: Block, poses: Array) -> None:
        self._send(row, block, archetypes.pose_columns(poses, row.z))

    def _send_trail(self, row: Entity, block: Block, poses: Array) -> None:
        trail = self._trails.setdefault(row, Trail(len(self.recording)))
        finished, open_strips = trail.extend(poses)
        done, latest = row.visible(self.run)
        self._send_rows(latest, block.index, block.time, archetypes.strip_columns(open_strips, row.z))
        if finished:
            rows = [k for k, _ in finished]
            columns = archetypes.strip_columns([strip for _, strip in finished], row.z)
            self._send_rows(done, block.index[rows], block.time[rows], columns)

    def _draw_plots(self, block: Block) -> None:
        curves: dict[str, Any] = {
            **block.curves,
            "drift": _distance(block.best, block.dead_reckoning),
            "heading_drift": np.degrees(np.abs(geometry.wrap(block.best[:, 2] - block.dead_reckoning[:, 2]))),
            "spread": np.sqrt(np.maximum(np.trace(block.covariance, axis1=1, axis2=2), 0.0)),
        }
        self._spreads = np.concatenate([self._spreads, curves["spread"]])
        if block.truth is not None:
            curves["error"] = _distance(block.best, block.truth)
        for name, values in curves.items():
            self._send(RUN_CURVES[name], block, archetypes.scalar_columns(values))

    def _draw_pictures(self, path: str, pictures: Sequence[Picture]) -> None:
        """Pictures of one entity; few at a time where they are large."""
        largest = max(p.content.values.nbytes if isinstance(p.content, Cells) else 0 for p in pictures)
        at_once = max(CHUNK_BYTES // largest, 1) if largest else len(pictures)
        for k in range(0, len(pictures), at_once):
            some = pictures[k : k + at_once]
            columns = archetypes.picture_columns([p.content for p in some])
            self._send_rows(path, [p.step for p in some], [p.seconds for p in some], columns)


def _distance(some: Array, others: Array) -> Array:
    """How far poses (n, 3) are from others, m."""
    apart = some[:, :2] - others[:, :2]
    return np.hypot(apart[:, 0], apart[:, 1])


def send_scene(drawings: Sequence[Drawing], framing: Framing, left_out: Sequence[str] | None = None) -> None:
    """Send the framing, the pages and the layout for these runs over one recording, which share a sink.

    Before the run (``left_out`` None) they say what can be there. The final ones say what is, and leave the layout of
    viewers that watch alone: somebody may have moved a panel.
    """
    final = left_out is not None
    sink, recording = drawings[0].sink, drawings[0].recording
    style.log_framing(sink, framing)
    names = [drawing.run for drawing in drawings]
    logged = {path for drawing in drawings for path in drawing.logged} if final else None
    style.log_page(sink, entities.HELP, pages.help_page(names, logged))
    about = pages.about_page(recording, [drawing.config for drawing in drawings], left_out or ())
    style.log_page(sink, entities.ABOUT, about)
    layout = blueprint(recording, framing, names, live=sink.live and not final)
    sink.send_blueprint(layout, live=not final)
