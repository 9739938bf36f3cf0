"""N occupancy maps that share what they have in common: a map per particle for the price of the differences.

A map is a table of tiles of 32 x 32 cells. Maps that descend from one another point to the same tiles until one of them
writes (copy on write), so that resampling copies tables, not maps. Every cell carries two numbers: its log-odds, and
the likelihood field (Thrun, Burgard & Fox 2005, section 6.4): the logarithm of how likely an end point is there, above
its floor, so 0 far from every wall and greatest on one. The field is kept up to date around the cells whose occupancy
flips, so that matching never waits for a distance transform.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz.config import Config

Floats = NDArray[np.float64]
Field = NDArray[np.float32]
Index = NDArray[np.int32]

BITS = 5
SIZE = 1 << BITS  # cells along a tile's edge
LOW = SIZE - 1
REACH = 3  # cells: how far the field reaches from a wall
FIRST_TILES = 256


@dataclass(frozen=True, slots=True)
class TileSettings:
    """What the maps need to know: ``cell`` m, log-odds as in :class:`pfslam_viz.config.MapConfig`, ``sigma`` m, the
    spread of end points about a wall, ``floor``, the share of them that no wall explains, and ``free_beams``, how many
    beams of a scan clear free space at most.
    """

    cell: float = 0.05
    log_odds_hit: float = 0.9
    log_odds_miss: float = 0.1
    log_odds_bound: float = 4.0
    sigma: float = 0.05
    floor: float = 0.1
    free_beams: int = 100

    @classmethod
    def of(cls, config: Config) -> "TileSettings":
        """Those of one configuration."""
        m, r = config.map, config.rao_blackwellized
        return cls(
            m.cell,
            m.log_odds_hit,
            m.log_odds_miss,
            m.log_odds_bound,
            sigma=r.sigma,
            floor=r.floor,
            free_beams=r.free_beams,
        )


class TileMaps:
    """N maps on one world grid whose rows run down and columns right, as in :class:`OccupancyGrid`.

    Attributes:
        table: (N, rows, columns) int32, the tile at each place; 0 is the empty tile, which nobody owns.
        log_odds, field: (tiles, 32, 32) float32.
        origin: row and column of the cell at the world's origin.
    """

    def __init__(self, count: int, settings: TileSettings) -> None:
        self.settings = settings
        self.cell = settings.cell
        self.table = np.zeros((count, 2, 2), np.int32)
        self.origin = np.array([SIZE, SIZE])
        self.log_odds = np.zeros((FIRST_TILES, SIZE, SIZE), np.float32)
        self.field = np.zeros((FIRST_TILES, SIZE, SIZE), np.float32)
        self._kernel = field_kernel(settings.cell, settings.sigma, settings.floor)
        self._references = np.zeros(FIRST_TILES, np.int32)
        self._count_references()

    def draw(self, poses: Floats, points: Floats, sensor: Floats) -> None:
        """Write a scan into map p as seen from pose p of (N, 3): end points (m, 2), lidar (2,) in the robot's frame."""
        if len(points) == 0:
            return
        farthest = max(float(np.hypot(points[:, 0], points[:, 1]).max()), float(np.hypot(sensor[0], sensor[1])))
        span = farthest + (REACH + 2) * self.cell
        self._reach(poses[:, :2].min(axis=0) - span, poses[:, :2].max(axis=0) + span)
        c, drawn = self.settings, 0
        while True:
            drawn = write_scans(
                self.table,
                self.log_odds,
                self.field,
                self._references,
                self._free,
                self._free_count,
                poses,
                points,
                sensor,
                self.origin,
                self.cell,
                self._kernel,
                c.log_odds_hit,
                c.log_odds_miss,
                c.log_odds_bound,
                1 + (len(points) - 1) // c.free_beams,
                drawn,
            )
            if drawn == len(poses):
                return
            self._add_tiles()

    def resample(self, parents: NDArray[np.intp]) -> None:
        """Map p becomes a descendant of map ``parents[p]`` (N,)."""
        self.table = self.table[parents]
        self._count_references()

    def occupied_at(self, index: int, points: Floats) -> NDArray[np.bool_]:
        """Which world points (m, 2) fall on an occupied cell of one map."""
        rows = np.floor(-points[:, 1] / self.cell).astype(np.int64) + self.origin[0]
        columns = np.floor(points[:, 0] / self.cell).astype(np.int64) + self.origin[1]
        height, width = self.table.shape[1] << BITS, self.table.shape[2] << BITS
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        rows, columns = np.where(inside, rows, 0), np.where(inside, columns, 0)
        tiles = self.table[index, rows >> BITS, columns >> BITS]
        return inside & (self.log_odds[tiles, rows & LOW, columns & LOW] > 0.0)

    def log_odds_of(self, index: int) -> tuple[Field, tuple[int, int]]:
        """One map's log-odds (rows, columns) as an array of its own, and the row and column of the world's origin."""
        rows, columns = self.table.shape[1:]
        dense = self.log_odds[self.table[index]].transpose(0, 2, 1, 3).reshape(rows * SIZE, columns * SIZE)
        return dense, (int(self.origin[0]), int(self.origin[1]))

    def _reach(self, lowest: Floats, highest: Floats) -> None:
        """Grow the tables until the world box from ``lowest`` to ``highest`` (x, y) m lies inside."""
        top_left = np.floor(np.array([-highest[1], lowest[0]]) / self.cell).astype(np.int64) + self.origin
        bottom_right = np.floor(np.array([-lowest[1], highest[0]]) / self.cell).astype(np.int64) + self.origin
        before = np.where(top_left < 0, -(top_left >> BITS) + 2, 0)
        after = np.maximum(0, (bottom_right >> BITS) + 1 - self.table.shape[1:])
        after = np.where(after > 0, after + 2, 0)
        if before.any() or after.any():
            self.table = np.pad(self.table, ((0, 0), *zip(before.tolist(), after.tolist(), strict=True)))
            self.origin = self.origin + before * SIZE

    def _add_tiles(self) -> None:
        more = len(self.log_odds)
        self.log_odds = np.concatenate([self.log_odds, np.zeros_like(self.log_odds)])
        self.field = np.concatenate([self.field, np.zeros_like(self.field)])
        self._references = np.concatenate([self._references, np.zeros(more, np.int32)])
        self._count_references()

    def _count_references(self) -> None:
        self._references = np.bincount(self.table.ravel(), minlength=len(self.log_odds)).astype(np.int32)
        unused = self._references == 0
        unused[0] = False
        free = np.flatnonzero(unused)[::-1].astype(np.int32)
        self._free = np.zeros(len(self.log_odds), np.int32)
        self._free[: len(free)] = free
        self._free_count = np.array([len(free)], np.int64)


def field_kernel(cell: float, sigma: float, floor: float) -> Field:
    """The field round one occupied cell, (2 REACH + 1)²: log(floor + (1 - floor) exp(-d² / 2 sigma²)) - log(floor).

    ``sigma`` m is the spread of end points about a wall, ``floor`` the share of end points that no wall explains.
    """
    offset = np.arange(-REACH, REACH + 1) * cell
    square = offset[:, None] ** 2 + offset[None, :] ** 2
    value = np.log(floor + (1.0 - floor) * np.exp(-square / (2.0 * sigma**2))) - math.log(floor)
    value[square > (REACH * cell) ** 2 + 1e-9] = 0.0
    return value.astype(np.float32)


@njit(cache=True, nogil=True)
def _own(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    count: NDArray[np.int64],
    row: int,
    column: int,
) -> int:
    """The tile at a place of one map, made its own if it is shared."""
    tile = table[row, column]
    if tile != 0 and references[tile] == 1:
        return tile
    count[0] -= 1
    new = free[count[0]]
    log_odds[new] = log_odds[tile]
    field[new] = field[tile]
    references[tile] -= 1
    references[new] = 1
    table[row, column] = new
    return new


@njit(cache=True, nogil=True)
def write_scans(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    free_count: NDArray[np.int64],
    poses: Floats,
    points: Floats,
    sensor: Floats,
    origin: NDArray[np.int64],
    cell: float,
    kernel: Field,
    hit: float,
    miss: float,
    bound: float,
    stride: int,
    first: int,
) -> int:
    """Write one scan into every map from ``first`` on; how many maps are done when the free tiles run short.

    Cells with an end point gain ``hit``, those of the Bresenham line up to every ``stride``-th of them lose ``miss``.
    """
    m = len(points)
    appeared = np.empty((m, 2), np.int64)
    vanished = np.empty((4 * m + 1024, 2), np.int64)
    ends = np.empty((m, 2), np.int64)
    for p in range(first, len(poses)):
        c, s = math.cos(poses[p, 2]), math.sin(poses[p, 2])
        x, y = poses[p, 0], poses[p, 1]
        start_row = math.floor(-(y + s * sensor[0] + c * sensor[1]) / cell) + origin[0]
        start_column = math.floor((x + c * sensor[0] - s * sensor[1]) / cell) + origin[1]
        low_row, high_row, low_column, high_column = start_row, start_row, start_column, start_column
        for b in range(m):
            row = math.floor(-(y + s * points[b, 0] + c * points[b, 1]) / cell) + origin[0]
            column = math.floor((x + c * points[b, 0] - s * points[b, 1]) / cell) + origin[1]
            ends[b, 0], ends[b, 1] = row, column
            low_row, high_row = min(low_row, row), max(high_row, row)
            low_column, high_column = min(low_column, column), max(high_column, column)
        tiles = (((high_row + REACH) >> BITS) - ((low_row - REACH) >> BITS) + 1) * (
            ((high_column + REACH) >> BITS) - ((low_column - REACH) >> BITS) + 1
        )
        if free_count[0] < tiles:
            return p
        mine = table[p]
        n_vanished = n_appeared = 0
        for b in range(0, m, stride):  # free space first: what a beam ends on must outlast what grazes it
            row, column = start_row, start_column
            rows, columns = abs(ends[b, 0] - row), abs(ends[b, 1] - column)
            down = 1 if ends[b, 0] >= row else -1
            right = 1 if ends[b, 1] >= column else -1
            error = columns - rows
            tile_row, tile_column, tile = -1, -1, 0
            for _ in range(max(rows, columns)):
                if row >> BITS != tile_row or column >> BITS != tile_column:
                    tile_row, tile_column = row >> BITS, column >> BITS
                    tile = _own(mine, log_odds, field, references, free, free_count, tile_row, tile_column)
                i, j = row & LOW, column & LOW
                before = log_odds[tile, i, j]
                if before > -bound:
                    after = max(before - miss, -bound)
                    log_odds[tile, i, j] = after
                    if before > 0.0 and after <= 0.0 and n_vanished < len(vanished):
                        vanished[n_vanished, 0], vanished[n_vanished, 1] = row, column
                        n_vanished += 1
                twice = 2 * error
                if twice > -rows:
                    error -= rows
                    column += right
                if twice < columns:
                    error += columns
                    row += down
        for b in range(m):
            row, column = ends[b, 0], ends[b, 1]
            tile = _own(mine, log_odds, field, references, free, free_count, row >> BITS, column >> BITS)
            i, j = row & LOW, column & LOW
            before = log_odds[tile, i, j]
            after = min(before + hit, bound)
            log_odds[tile, i, j] = after
            if before <= 0.0 and after > 0.0:
                appeared[n_appeared, 0], appeared[n_appeared, 1] = row, column
                n_appeared += 1
        for k in range(n_vanished):
            _erase(mine, log_odds, field, references, free, free_count, vanished[k, 0], vanished[k, 1], kernel)
        for k in range(n_appeared):
            _stamp(mine, log_odds, field, references, free, free_count, appeared[k, 0], appeared[k, 1], kernel)
    return len(poses)


@njit(cache=True, nogil=True)
def _stamp(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    count: NDArray[np.int64],
    row: int,
    column: int,
    kernel: Field,
) -> None:
    """A cell became occupied: raise the field round it."""
    for i in range(-REACH, REACH + 1):
        for j in range(-REACH, REACH + 1):
            value = kernel[i + REACH, j + REACH]
            r, c = row + i, column + j
            if value > field[table[r >> BITS, c >> BITS], r & LOW, c & LOW]:
                tile = _own(table, log_odds, field, references, free, count, r >> BITS, c >> BITS)
                field[tile, r & LOW, c & LOW] = value


@njit(cache=True, nogil=True)
def _erase(
    table: Index,
    log_odds: Field,
    field: Field,
    references: Index,
    free: Index,
    count: NDArray[np.int64],
    row: int,
    column: int,
    kernel: Field,
) -> None:
    """A cell became free: find the field anew where it was the nearest occupied one."""
    if log_odds[table[row >> BITS, column >> BITS], row & LOW, column & LOW] > 0.0:
        return  # an end point of the same scan has put it back
    for i in range(-REACH, REACH + 1):
        for j in range(-REACH, REACH + 1):
            r, c = row + i, column + j
            now = field[table[r >> BITS, c >> BITS], r & LOW, c & LOW]
            if now > kernel[i + REACH, j + REACH] or now == 0.0:
                continue
            best = np.float32(0.0)
            for a in range(-REACH, REACH + 1):
                for b in range(-REACH, REACH + 1):
                    if kernel[a + REACH, b + REACH] > best:
                        u, v = r + a, c + b
                        if log_odds[table[u >> BITS, v >> BITS], u & LOW, v & LOW] > 0.0:
                            best = kernel[a + REACH, b + REACH]
            if best != now:
                tile = _own(table, log_odds, field, references, free, count, r >> BITS, c >> BITS)
                field[tile, r & LOW, c & LOW] = best


@njit(cache=True, nogil=True, fastmath=True)
def agreement(
    table: Index,
    field: Field,
    origin: NDArray[np.int64],
    cell: float,
    points: Floats,
    x: float,
    y: float,
    heading: float,
) -> float:
    """Sum over end points (m, 2) of one map's field, bilinear between cell centres, for the pose (x, y, heading)."""
    c, s = math.cos(heading) / cell, math.sin(heading) / cell
    left, top = x / cell + origin[1] - 0.5, origin[0] - y / cell - 0.5
    rows, columns = (table.shape[0] << BITS) - 1, (table.shape[1] << BITS) - 1
    total = 0.0
    for b in range(len(points)):
        u = left + c * points[b, 0] - s * points[b, 1]
        v = top - s * points[b, 0] - c * points[b, 1]
        if u < 0.0 or v < 0.0 or u >= columns or v >= rows:
            continue
        j, i = int(u), int(v)
        fu, fv = u - j, v - i
        tile = table[i >> BITS, j >> BITS]
        a, d = i & LOW, j & LOW
        if a < LOW and d < LOW:
            if tile == 0:
                continue
            upper = field[tile, a, d] + fu * (field[tile, a, d + 1] - field[tile, a, d])
            lower = field[tile, a + 1, d] + fu * (field[tile, a + 1, d + 1] - field[tile, a + 1, d])
        else:
            i2, j2 = i + 1, j + 1
            f00 = field[tile, a, d]
            f01 = field[table[i >> BITS, j2 >> BITS], a, j2 & LOW]
            f10 = field[table[i2 >> BITS, j >> BITS], i2 & LOW, d]
            f11 = field[table[i2 >> BITS, j2 >> BITS], i2 & LOW, j2 & LOW]
            upper = f00 + fu * (f01 - f00)
            lower = f10 + fu * (f11 - f10)
        total += upper + fv * (lower - upper)
    return total
