"""N occupancy maps that share what they have in common: a map per particle for the price of the differences.

A map is a table of tiles of 32 x 32 cells. Maps that descend from one another point to the same tiles until one of them
writes (copy on write), so that resampling copies tables, not maps. Every cell carries two numbers: its log-odds, and
the likelihood field (Thrun, Burgard & Fox 2005, section 6.4): the logarithm of how likely an end point is there, above
its floor, so 0 far from every wall and greatest on one. The field is kept up to date around the cells whose occupancy
flips, so that matching never waits for a distance transform.
"""

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.rbpf.settings import RbpfConfig
from pfslam_viz.slam.rbpf.tile_kernels import BITS, SIZE, Field, Floats, Index, project, write_scans
from pfslam_viz.slam.tiles import Box, Tiled, enlarged
from pfslam_viz.slam.worker import Task, Worker

Ranges = list[tuple[int, int]]

FIRST_TILES = 256


@dataclass(frozen=True, slots=True)
class TileSettings:
    """What the maps need to know.

    ``cell`` m, log-odds and ``threshold`` as in :class:`pfslam_viz.settings.MapConfig`; ``sigma`` m, the spread of end
    points about a wall, ``floor``, the share of them that no wall explains, ``reach``, the cells by which the field
    goes beyond a wall, and ``free_beams``, how many beams of a scan clear free space at most.
    """

    cell: float = 0.05
    log_odds_hit: float = 0.9
    log_odds_miss: float = 0.1
    log_odds_bound: float = 4.0
    threshold: float = 0.0
    sigma: float = 0.05
    floor: float = 0.1
    reach: int = 3
    free_beams: int = 100

    @classmethod
    def of(cls, config: RbpfConfig) -> "TileSettings":
        """Those of one configuration."""
        m, r = config.map, config.rao_blackwellized
        return cls(
            m.cell,
            m.log_odds_hit,
            m.log_odds_miss,
            m.log_odds_bound,
            m.threshold,
            sigma=r.sigma,
            floor=r.floor,
            reach=r.field_reach,
            free_beams=r.free_beams,
        )


class TileMaps:
    """N maps on one world grid whose rows run down and columns right, as in :class:`OccupancyGrid`.

    A scan may be written beside what else is done (:meth:`write_beside`). Whoever looks at the maps has it; only one
    thread may look.
    """

    def __init__(self, count: int, settings: TileSettings) -> None:
        self.settings = settings
        self.cell = settings.cell
        self._table = np.zeros((count, 2, 2), np.int32)
        self._origin = np.array([SIZE, SIZE])
        self._log_odds = np.zeros((FIRST_TILES, SIZE, SIZE), np.float32)
        self._field = np.zeros((FIRST_TILES, SIZE, SIZE), np.float32)
        self._kernel = field_kernel(settings.cell, settings.sigma, settings.floor, settings.reach)
        self._threshold = np.float32(settings.threshold)
        self._references = np.zeros(FIRST_TILES, np.int32)
        self._count_references()
        self._writing: Task[Ranges] | None = None  # what the other thread does,
        self._written: tuple[Floats, Floats, Floats]  # with which scan;
        self._ready = 0  # the one map that has it already,
        self._parents: NDArray[np.intp] | None = None  # and whose descendants the maps become when all have it

    @property
    def table(self) -> Index:
        """(N, rows, columns) int32, the tile at each place; 0 is the empty tile, which nobody owns."""
        self._catch_up()
        return self._table

    @property
    def log_odds(self) -> Field:
        """(tiles, 32, 32) float32; 0 is unknown."""
        self._catch_up()
        return self._log_odds

    @property
    def field(self) -> Field:
        """(tiles, 32, 32) float32, the likelihood field."""
        self._catch_up()
        return self._field

    @property
    def origin(self) -> NDArray[np.int64]:
        """(2,) row and column of the cell at the world's origin."""
        self._catch_up()
        return self._origin

    def write(self, poses: Floats, points: Floats, lidar_position: Floats) -> None:
        """Write a scan into map p as seen from pose p of (N, 3): end points (m, 2), lidar (2,) in the robot's frame."""
        self._catch_up()
        self._make_room(poses, points, lidar_position)
        self._write_all([(0, len(poses))], poses, points, lidar_position)

    def write_beside(
        self, worker: Worker, poses: Floats, points: Floats, lidar_position: Floats, before: int = 0
    ) -> None:
        """:meth:`write`, but all maps except the one ``before`` on the ``worker``'s other thread.

        Who looks at that one map, or at a descendant of it, need not wait for the others. The arrays must not change
        any more.
        """
        if worker.alone:
            self.write(poses, points, lidar_position)
            return
        self._catch_up()
        self._make_room(poses, points, lidar_position)
        self._write_all([(before, before + 1)], poses, points, lidar_position)
        others = [(0, before), (before + 1, len(poses))]
        self._ready, self._written = before, (poses, points, lidar_position)
        self._writing = worker.submit(partial(self._write_some, others, *self._written))

    def _catch_up(self) -> None:
        """Have everything written."""
        if self._writing is None:
            return
        left, self._writing = self._writing.result(), None
        self._write_all(left, *self._written)
        if self._parents is not None:
            parents, self._parents = self._parents, None
            self.resample(parents)

    def _table_of(self, index: int) -> Index:
        """One map's table, as soon as it is written."""
        now = index if self._parents is None else int(self._parents[index])
        if now != self._ready:
            self._catch_up()
            now = index
        table: Index = self._table[now]
        return table

    def _make_room(self, poses: Floats, points: Floats, lidar_position: Floats) -> None:
        if len(points):
            farthest = max(float(np.hypot(points[:, 0], points[:, 1]).max()), float(np.hypot(*lidar_position)))
            span = farthest + (self.settings.reach + 2) * self.cell
            self._reach(poses[:, :2].min(axis=0) - span, poses[:, :2].max(axis=0) + span)

    def _write_all(self, maps: Ranges, poses: Floats, points: Floats, lidar_position: Floats) -> None:
        """Write into ranges of ``maps``, with more tiles where they run short."""
        while maps := self._write_some(maps, poses, points, lidar_position):
            self._add_tiles()

    def _write_some(self, maps: Ranges, poses: Floats, points: Floats, lidar_position: Floats) -> Ranges:
        """Write into ranges of ``maps``; those that are left when the free tiles run short."""
        c = self.settings
        for k, (first, end) in enumerate(maps):
            if len(points) == 0 or first == end:
                continue
            done = write_scans(
                self._table[first:end],
                self._log_odds,
                self._field,
                self._references,
                self._free,
                self._free_count,
                poses[first:end],
                points,
                lidar_position,
                self._origin,
                self.cell,
                self._kernel,
                c.log_odds_hit,
                c.log_odds_miss,
                c.log_odds_bound,
                self._threshold,
                1 + (len(points) - 1) // c.free_beams,
                0,
            )
            if done < end - first:
                return [(first + done, end), *maps[k + 1 :]]
        return []

    def resample(self, parents: NDArray[np.intp]) -> None:
        """Map p becomes a descendant of map ``parents[p]`` (N,)."""
        if self._writing is not None and self._parents is None:
            self._parents = parents  # when the scan is written
            return
        self._catch_up()
        self._table = self._table[parents]
        self._count_references()

    def spread(self, count: int) -> None:
        """From now on there are ``count`` maps, all of them like the first one."""
        self.resample(np.zeros(count, np.intp))

    def project(self, index: int, pose: Floats, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """End points (m, 2) in the world from ``pose`` (3,), and whether each falls on an occupied cell of one map."""
        return project(self._table_of(index), self._log_odds, self._origin, self.cell, self._threshold, pose, points)

    def log_odds_of(self, index: int) -> tuple[Field, tuple[int, int]]:
        """One map's log-odds (rows, columns) as an array of its own, and the row and column of the world's origin."""
        row, column = self._origin.tolist()
        return self.tiled(index).dense(self.box()), (row, column)

    def box(self) -> Box:
        """First row and column, last row and column that the maps have room for, from the world origin's cell."""
        (row, column), (rows, columns) = self._origin.tolist(), self._table.shape[1:]
        return -row, -column, rows * SIZE - row - 1, columns * SIZE - column - 1

    def tiled(self, index: int) -> Tiled:
        """One map's log-odds in tiles, without a copy."""
        table = self._table_of(index)
        rows, columns = np.nonzero(table)
        origin = self._origin // SIZE
        return Tiled(rows - origin[0], columns - origin[1], table[rows, columns], self._log_odds)

    def _reach(self, lowest: Floats, highest: Floats) -> None:
        """Grow the tables until the world box from ``lowest`` to ``highest`` (x, y) m lies inside."""
        top_left = np.floor(np.array([-highest[1], lowest[0]]) / self.cell).astype(np.int64) + self._origin
        bottom_right = np.floor(np.array([-lowest[1], highest[0]]) / self.cell).astype(np.int64) + self._origin
        before = np.where(top_left < 0, -(top_left >> BITS) + 2, 0)
        after = np.maximum(0, (bottom_right >> BITS) + 1 - self._table.shape[1:])
        after = np.where(after > 0, after + 2, 0)
        if before.any() or after.any():
            self._table = np.pad(self._table, ((0, 0), *zip(before.tolist(), after.tolist(), strict=True)))
            self._origin = self._origin + before * SIZE

    def _add_tiles(self) -> None:
        more = len(self._log_odds)
        self._log_odds = enlarged(self._log_odds, more)
        self._field = enlarged(self._field, more)  # one after the other: an old pool goes before the next new one comes
        self._references = np.concatenate([self._references, np.zeros(more, np.int32)])
        self._count_references()

    def _count_references(self) -> None:
        self._references = np.bincount(self._table.ravel(), minlength=len(self._log_odds)).astype(np.int32)
        unused = self._references == 0
        unused[0] = False
        free = np.flatnonzero(unused)[::-1].astype(np.int32)
        self._free = np.zeros(len(self._log_odds), np.int32)
        self._free[: len(free)] = free
        self._free_count = np.array([len(free)], np.int64)


def field_kernel(cell: float, sigma: float, floor: float, reach: int) -> Field:
    """The field round one occupied cell, (2 ``reach`` + 1)²: log(floor + (1 - floor) exp(-d² / 2 sigma²)) - log(floor).

    ``sigma`` m is the spread of end points about a wall, ``floor`` the share of end points that no wall explains.
    """
    offset = np.arange(-reach, reach + 1) * cell
    square = offset[:, None] ** 2 + offset[None, :] ** 2
    value = np.log(floor + (1.0 - floor) * np.exp(-square / (2.0 * sigma**2))) - math.log(floor)
    value[square > (reach * cell) ** 2 + 1e-9] = 0.0
    return value.astype(np.float32)
