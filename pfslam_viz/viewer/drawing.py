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
from pfslam_viz.viewer.entities import LIDAR_Z, PARTICLE_Z, POSE_Z, TRAIL_Z, TRUTH_Z, Entities
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
        names: what the run's entities are called.
        max_particles: at most so many of a scan are drawn.
        color: the run's colour.
        shared: whether to draw what runs have in common: dead reckoning and truth.
    """

    def __init__(
        self,
        recording: Recording,
        config: Config,
        sink: Sink,
        names: Entities,
        max_particles: int,
        *,
        color: entities.Color = entities.FILTER,
        shared: bool = True,
    ) -> None:
        self.recording, self.config, self.sink, self.entities = recording, config, sink, names
        self.logged: set[str] = set()
        self._max_particles, self._shared = max_particles, shared
        self._trails: dict[str, Trail] = {}
        self._spreads = np.zeros(0)
        style.style_run(sink, names, color, recording.frames)
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
            style.log_loupe(self.sink, self.entities, float(np.percentile(self._spreads, 75)))
        if framing is not None:
            send_scene([self], framing, left_out)

    # Blocks of scans --------------------------------------------------------------------------------------------------

    def _send(self, path: str, block: Block, columns: Any) -> None:
        self.logged.add(path)
        self.sink.send_columns(path, archetypes.time_columns(block.index, block.time), columns)

    def _draw_run(self, block: Block) -> None:
        path = self.entities.filter
        particles, headings = archetypes.particle_columns(block, self._max_particles, PARTICLE_Z)
        self._send(path("particles"), block, particles)
        self._send(path("headings"), block, headings)
        hits = block.hits.values
        for name, mask in (("scan/hit", hits), ("scan/miss", ~hits)):
            self._send(path(name), block, archetypes.point_columns(block.end_points.where(mask), LIDAR_Z))
        self._send(path("robot"), block, archetypes.pose_columns(block.best, POSE_Z))
        self._send(path("mean"), block, archetypes.pose_columns(block.mean, POSE_Z))
        self._send(path("covariance"), block, archetypes.ellipse_columns(block.mean, block.covariance, POSE_Z))
        self._send(path("follow"), block, archetypes.position_columns(block.best, 0.0))
        self._send_trail(path("trajectory"), block, block.best)
        if block.correction is not None:
            c, s = np.cos(block.best[:, 2]), np.sin(block.best[:, 2])
            x, y = block.correction[:, 0], block.correction[:, 1]
            arrows = CORRECTION_SCALE * np.stack([c * x - s * y, s * x + c * y], axis=-1)
            self._send(path("correction"), block, archetypes.arrow_columns(block.best[:, :2] - arrows, arrows, POSE_Z))
            lines = [
                np.zeros((0, 2)) if axis is None else pose[:2] + np.array([[-1.0], [1.0]]) * axis
                for pose, axis in zip(block.best, block.degenerate, strict=True)
            ]
            self._send(path("degenerate"), block, archetypes.strip_columns(lines, POSE_Z))

    def _draw_shared(self, block: Block) -> None:
        path = entities.dead_reckoning
        self._send(path("scan"), block, archetypes.point_columns(block.dead_reckoning_end_points, LIDAR_Z))
        self._send(path("robot"), block, archetypes.pose_columns(block.dead_reckoning, POSE_Z))
        self._send_trail(path("trajectory"), block, block.dead_reckoning)
        if block.truth is not None:
            self._send(entities.truth("robot"), block, archetypes.pose_columns(block.truth, POSE_Z))
            self._send_trail(entities.truth("trajectory"), block, block.truth, TRUTH_Z)
            error = block.dead_reckoning - block.truth
            distance = np.hypot(error[:, 0], error[:, 1])
            self._send(entities.shared_plot("error", "dead_reckoning"), block, archetypes.scalar_columns(distance))

    def _send_trail(self, path: str, block: Block, poses: Array, z: float = TRAIL_Z) -> None:
        trail = self._trails.setdefault(path, Trail(len(self.recording)))
        finished, open_strips = trail.extend(poses)
        self._send(f"{path}/open", block, archetypes.strip_columns(open_strips, z))
        if finished:
            rows = [row for row, _ in finished]
            times = archetypes.time_columns(block.index[rows], block.time[rows])
            self.logged.add(f"{path}/done")
            columns = archetypes.strip_columns([strip for _, strip in finished], z)
            self.sink.send_columns(f"{path}/done", times, columns)

    def _draw_plots(self, block: Block) -> None:
        apart = block.best - block.dead_reckoning
        curves: dict[str, Any] = {
            **block.curves,
            "drift": np.hypot(apart[:, 0], apart[:, 1]),
            "heading_drift": np.degrees(np.abs(geometry.wrap(apart[:, 2]))),
            "spread": np.sqrt(np.maximum(np.trace(block.covariance, axis1=1, axis2=2), 0.0)),
        }
        self._spreads = np.concatenate([self._spreads, curves["spread"]])
        if block.truth is not None:
            error = block.best - block.truth
            curves["error"] = np.hypot(error[:, 0], error[:, 1])
        for name, values in curves.items():
            self._send(self.entities.plot(name), block, archetypes.scalar_columns(values))

    def _draw_pictures(self, path: str, pictures: Sequence[Picture]) -> None:
        """Pictures of one entity; few at a time where they are large."""
        self.logged.add(path)
        largest = max(p.content.values.nbytes if isinstance(p.content, Cells) else 0 for p in pictures)
        at_once = max(CHUNK_BYTES // largest, 1) if largest else len(pictures)
        for k in range(0, len(pictures), at_once):
            some = pictures[k : k + at_once]
            times = archetypes.time_columns([p.step for p in some], [p.seconds for p in some])
            self.sink.send_columns(path, times, archetypes.picture_columns([p.content for p in some]))


def send_scene(drawings: Sequence[Drawing], framing: Framing, left_out: Sequence[str] | None = None) -> None:
    """Send the framing, the pages and the layout for these runs over one recording, which share a sink.

    Before the run (``left_out`` None) they say what can be there. The final ones say what is, and leave the layout of
    viewers that watch alone: somebody may have moved a panel.
    """
    final = left_out is not None
    sink, recording = drawings[0].sink, drawings[0].recording
    style.log_framing(sink, framing)
    names = [drawing.entities.run for drawing in drawings]
    logged = {path for drawing in drawings for path in drawing.logged} if final else None
    style.log_page(sink, entities.HELP, pages.help_page(names, logged))
    about = pages.about_page(recording, [drawing.config for drawing in drawings], left_out or ())
    style.log_page(sink, entities.ABOUT, about)
    layout = blueprint(recording, framing, names, live=sink.live and not final)
    sink.send_blueprint(layout, live=not final)
