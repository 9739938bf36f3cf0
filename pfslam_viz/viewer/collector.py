"""What a recording shows of a replay, copied out of the Steps as they come.

Scans are kept in batches; maps, textures and the like are taken when they are due.

Nothing of Rerun is needed here; :mod:`pfslam_viz.viewer.drawing` draws it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.tiles import Tiled
from pfslam_viz.step import Step
from pfslam_viz.viewer import contents, entities
from pfslam_viz.viewer.ancestry import Ancestry
from pfslam_viz.viewer.blocks import Block, Changes, GridBlocks, Place, WallBlocks, edge_for
from pfslam_viz.viewer.camera_images import CameraImages
from pfslam_viz.viewer.contents import Cells, Content, Lines, Note, Spots, TimedContent
from pfslam_viz.viewer.entities import ONLY_RUN, Entity
from pfslam_viz.viewer.events import Chronicle, Event
from pfslam_viz.viewer.marks import Marks
from pfslam_viz.viewer.scan_batch import ScanBatch, ScanCopy, distance, error_levels, stride
from pfslam_viz.viewer.trail import level_pieces

if TYPE_CHECKING:
    from pfslam_viz.texture.floor_texture import FloorTexture

Array = NDArray[np.float64]

MAP_FRAMES, TEXTURE_FRAMES, CAMERA_FRAMES, WALL_FRAMES = 210, 210, 200, 100
MAP_BYTES, TEXTURE_BYTES = 200_000_000, 150_000_000  # uncompressed: what the viewer has to hold
LINEAGES_EVERY, LINEAGES = 10, 500  # scans, unless these are so many that fewer will do
DRAWN, FEWEST_DRAWN = 2_400_000, 30  # particles, or end points: in a recording, but at least in a scan
MAPS = (entities.MAP, entities.RECKONED_MAP)


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """Size against detail.

    ``map_every`` scans a map is logged; None spreads about 200 over the recording. At most ``max_particles`` and
    ``max_beams`` are drawn of a scan; None draws 500 and 270, fewer in a recording of many scans.
    """

    map_every: int | None = None
    max_particles: int | None = None
    max_beams: int | None = None

    def settled(self, scans: int) -> "StreamOptions":
        """With numbers for a recording of so many scans: 2.4 million particles and as many end points in all."""

        def most(wanted: int | None, usual: int) -> int:
            return wanted or min(usual, max(DRAWN // max(scans, 1), FEWEST_DRAWN))

        return StreamOptions(self.map_every, most(self.max_particles, 500), most(self.max_beams, 270))


class Collector:
    """Takes Steps with :meth:`add`, and gives what was collected with :meth:`take`. :meth:`finish` adds the ends."""

    def __init__(
        self,
        recording: Recording,
        config: Config,
        options: StreamOptions,
        run: str = ONLY_RUN,
        *,
        shared: bool = True,
    ) -> None:
        """``run`` is its name in entity paths; ``shared`` includes what is no run's own: dead reckoning's map."""
        n = len(recording)
        self._options, self._run, self._shared = options.settled(n), run, shared
        self._maps = contents.FrameBudget(n, MAP_FRAMES, MAP_BYTES, options.map_every)
        self._textures = contents.FrameBudget(n, TEXTURE_FRAMES, TEXTURE_BYTES)
        self._walls = contents.FrameBudget(n, WALL_FRAMES, MAP_BYTES)
        self._lineages = contents.FrameBudget(n, 0, 0, every=max(LINEAGES_EVERY, n // LINEAGES))
        self._ancestry = Ancestry()
        self._chronicle = Chronicle(recording, config)
        self._marks = Marks.over(recording)
        self._stamps = recording.stamps
        self._painted: FloorTexture | None = None
        edge = edge_for(recording.dead_reckoning(), config.map.cell)
        halo = contents.gap_halo(config.map.cell)
        self._grids = {row: GridBlocks(Changes(edge, halo), config.map.cell, row.z) for row in MAPS}
        self._raised = WallBlocks(Changes(edge))
        self._floor = GridBlocks(Changes(edge // 2), config.map.cell, entities.TEXTURE.z)
        span = (float(recording.stamps[0]) - 1.0, float(recording.stamps[-1]))
        self._camera = CameraImages(recording.frames, span, CAMERA_FRAMES)
        self._closures: list[Array] = []
        self._last: Step | None = None
        self._counts = {"particles": 0, "beams": 0}
        self._scans: list[ScanCopy] = []
        self._contents: list[TimedContent] = []

    def __len__(self) -> int:
        """The scans collected."""
        return len(self._scans)

    def add(self, step: Step) -> None:
        """Take a scan, and the contents that are due."""
        self._last = step
        for event in self._chronicle.add(step):
            self._add_event(event, step.estimate.best)
        self._add_marks(self._marks.expired(step.index))
        maps_due = self._maps.is_due(step.index) or step.revision is not None
        if maps_due and self._shared:
            step.dead_reckoning_grid.catch_up()
        self._counts["particles"] = max(self._counts["particles"], len(step.estimate.weights))
        self._counts["beams"] = max(self._counts["beams"], len(step.end_points))
        lineages = self._ancestry.add(step.estimate.particles, step.estimate.parents)
        self._scans.append(ScanCopy.of(step, self._options.max_beams or 1, lineages=lineages))
        if self._lineages.is_due(step.index):
            self._lineages.spend(step.index, 0)
            self._add(entities.LINEAGES, step, Lines(self._ancestry.segments(), entities.LINEAGES.z))
        if maps_due:
            self._maps.spend(step.index, self._add_maps(step, step.grid, step.dead_reckoning_grid))
        if self._walls.is_due(step.index) or step.revision is not None:
            self._walls.spend(step.index, 0)
            self._add_walls(step, step.grid)
        if step.revision is not None and step.revision.closures:
            self._closures += [np.stack([c.earlier_position, c.later_position]) for c in step.revision.closures]
            self._add_lines(entities.CLOSURES, step, self._closures)
        if step.texture is not None:
            self._painted = step.texture
            self._add_texture(step, step.texture)
        for row, image in self._camera.due(step.stamp):
            self._add(row, step, image)

    def finish(self, result: Result) -> None:
        """Take what is known only at the end: the last maps, the trajectory in hindsight, closed loops."""
        if self._last is None:
            return
        self._add_maps(self._last, result.grid, result.dead_reckoning_grid, whole=True)
        self._add_walls(self._last, result.grid)
        if result.texture is not None:
            self._add_texture(self._last, result.texture, always=True)
        painted_anew = self._painted is not None and result.texture is not self._painted
        for event in self._chronicle.finish(result, painted_anew):
            self._add_event(event, result.online[event.step])
        if hindsight_differs(result):
            self._add_lines(entities.HINDSIGHT_TRAJECTORY, self._last, [result.estimate])
            if result.truth is not None:
                self._add_settled_error(self._last, result.estimate, result.truth)
        if result.closures:
            pairs = [np.stack([c.earlier_position, c.later_position]) for c in result.closures]
            self._add_lines(entities.CLOSURES, self._last, pairs)

    def take(self) -> tuple[ScanBatch | None, tuple[TimedContent, ...]]:
        """The scans (None: there are none) and the other contents since the last call."""
        batch, taken = ScanBatch.of(self._scans) if self._scans else None, tuple(self._contents)
        self._scans, self._contents = [], []
        return batch, taken

    def close(self) -> None:
        """Stop decoding camera images."""
        self._camera.close()

    @property
    def left_out(self) -> list[str]:
        """How much is drawn of what is not drawn whole, a phrase each."""
        out = []
        for what, most in (("particles", self._options.max_particles), ("beams", self._options.max_beams)):
            total = self._counts[what]
            shown = len(range(0, total, stride(total, most or 1)))
            if shown < total:
                out.append(f"{what}: {shown:,} of {total:,} drawn (--max-{what})")
        done = 0 if self._last is None else self._last.index + 1
        if self._maps.logged < done:
            out.append(f"maps: {self._maps.logged:,} of {done:,} scans have one (--map-every)")
        if any(blocks.coarsened for blocks in self._grids.values()):
            out.append("maps: on the way, some of them in larger cells than they have (--map-every)")
        if self._textures.skipped:
            out.append(
                f"textures: {self._textures.logged:,} of {self._textures.logged + self._textures.skipped:,} drawn"
            )
        if self._camera.logged < self._camera.available:
            out.append(f"camera images: {self._camera.logged:,} of {self._camera.available:,} of each camera drawn")
        return out

    def _add(self, row: Entity, step: Step, content: Content) -> None:
        self._contents.append(TimedContent(row.path(self._run), step.index, step.time, content))

    def _add_event(self, event: Event, pose: Array) -> None:
        """Its line in the list, and its marks on the maps."""
        note = Note(event.line, event.level)
        self._contents.append(TimedContent(entities.EVENTS.path(self._run), event.step, event.seconds, note))
        if self._last is not None:
            self._add_marks(self._marks.of(event, pose, self._last.index))

    def _add_marks(self, marks: Iterable[tuple[Entity, int, Spots]]) -> None:
        for row, step, spots in marks:
            seconds = float(self._stamps[step] - self._stamps[0])
            self._contents.append(TimedContent(row.path(self._run), step, seconds, spots))

    def _add_settled_error(self, step: Step, estimate: Array, truth: Array) -> None:
        levels = error_levels(distance(estimate, truth))
        pieces = level_pieces(np.column_stack([estimate[:, :2], levels]).astype(np.float32))
        lines = Lines([strip for strip, _ in pieces], entities.SETTLED_ERROR.z, [level for _, level in pieces])
        self._add(entities.SETTLED_ERROR, step, lines)

    def _add_lines(self, row: Entity, step: Step, lines: Sequence[Array]) -> None:
        self._add(row, step, Lines([line[:, :2].astype(np.float32) for line in lines], row.z))

    def _add_blocks(self, row: Entity, step: Step, blocks: Iterable[Block]) -> int:
        """Bytes of what was added."""
        size = 0
        for block in blocks:
            path = row.path(self._run)
            self._contents.append(TimedContent(path, step.index, step.time, block.content, block.part))
            size += block.content.values.nbytes if isinstance(block.content, Cells) else 0
        return size

    def _add_maps(self, step: Step, grid: OccupancyGrid, reckoned: OccupancyGrid, whole: bool = False) -> int:
        """Bytes of what was added: what changed of the maps; with ``whole``, none of it in larger cells any more."""
        grids = [grid, reckoned] if self._shared else [grid]
        allowed = None if whole else self._maps.allowance(step.index)
        size = 0
        for row, shown in zip(MAPS, grids, strict=False):
            blocks, tiled = self._grids[row], shown.tiled()
            draw = partial(_map_block, shown, tiled, blocks.changes)
            share = None if allowed is None else allowed // len(grids)
            size += self._add_blocks(row, step, blocks.update(tiled, draw, share))
        return size

    def _add_walls(self, step: Step, grid: OccupancyGrid) -> None:
        tiled, changes = grid.tiled(), self._raised.changes
        blocks = self._raised.update(tiled, lambda block: contents.wall_block(grid, tiled, changes.box(block)))
        self._add_blocks(entities.WALLS, step, blocks)

    def _add_texture(self, step: Step, texture: "FloorTexture", always: bool = False) -> None:
        if always or self._textures.is_due(step.index):
            colors, weight = texture.tiled()
            changes = self._floor.changes
            allowed = None if always else self._textures.allowance(step.index)
            blocks = self._floor.update(
                weight, lambda block: contents.texture_block(colors, weight, changes.box(block)), allowed
            )
            self._textures.spend(step.index, self._add_blocks(entities.TEXTURE, step, blocks))
        else:
            self._textures.skipped += 1


def _map_block(grid: OccupancyGrid, tiled: Tiled, changes: Changes, block: Place) -> NDArray[np.uint8]:
    return contents.map_block(grid, tiled, changes.box(block))


def hindsight_differs(result: Result) -> bool:
    """Whether the end knows another trajectory than the one that was estimated on the way (by a millimetre)."""
    estimate, online = result.estimate, result.online
    return len(estimate) == len(online) and not np.allclose(estimate[:, :2], online[:, :2], rtol=0.0, atol=1e-3)
