"""Cells of the plane that are kept where something was seen: dense while they are few, else in tiles.

A map of a long drive is mostly empty: 2 km of street fill a twentieth of the square that they lie in. So a map's arrays
are dense only up to a limit, as long as every place is near. From then on they are a window on the neighbourhood of the
robot, and what lies outside waits in tiles. Whoever writes the map sees plain arrays in either case.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

Index = NDArray[np.int64]

TILE = 64  # cells along a tile's edge
MARGIN = 64  # cells grown beyond what is asked for, so that growing stays rare
SLACK = 256  # the same of a window, which has to be filled anew when it moves
MOST = 6_000_000  # cells of dense arrays; a window may need more, up to the next number squared
WIDEST = 4096  # cells along a window's edge: what lies further from the robot is written into the tiles themselves
FIRST = 64  # tiles there is room for at first

Part = tuple[slice, slice]
Pad = tuple[tuple[int, int], tuple[int, int]]
Box = tuple[int, int, int, int]  # first row and column, last row and column, counted from the world origin's cell


@dataclass(frozen=True, slots=True)
class Tiled:
    """Square tiles of one map's values, where something is known.

    Tile k holds the cells from row ``rows[k] * size`` and column ``columns[k] * size`` on, counted from the cell at the
    world's origin (rows run down). Its values are ``pool[index[k]]`` of (n, size, size, ...); not to be written to.
    """

    rows: Index
    columns: Index
    index: NDArray[np.integer[Any]]
    pool: NDArray[Any]

    @property
    def size(self) -> int:
        """Cells along a tile's edge."""
        return int(self.pool.shape[1])

    def __len__(self) -> int:
        return len(self.index)

    def box(self) -> Box:
        """The cells that the tiles cover; a single one where there is no tile."""
        if not len(self):
            return 0, 0, 0, 0
        n = self.size
        low, high = (int(self.rows.min()), int(self.columns.min())), (int(self.rows.max()), int(self.columns.max()))
        return low[0] * n, low[1] * n, high[0] * n + n - 1, high[1] * n + n - 1

    def known_box(self) -> Box | None:
        """The smallest box that holds every cell whose value is not 0; None where there is none."""
        boxes = []
        for row, column, index in zip(self.rows.tolist(), self.columns.tolist(), self.index.tolist(), strict=True):
            known = self.pool[index] != 0
            i, j = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
            if len(i):
                top, left = row * self.size, column * self.size
                boxes.append((top + i[0], left + j[0], top + i[-1], left + j[-1]))
        if not boxes:
            return None
        low, high = np.min(boxes, axis=0), np.max(boxes, axis=0)
        return int(low[0]), int(low[1]), int(high[2]), int(high[3])

    def where(self, test: Any) -> Index:
        """Row and column (m, 2) of the cells whose values pass ``test`` (array to array of bool), in row order."""
        found = [np.zeros((0, 2), np.int64)]
        for row, column, index in zip(self.rows.tolist(), self.columns.tolist(), self.index.tolist(), strict=True):
            cells = np.argwhere(test(self.pool[index]))
            if len(cells):
                found.append(cells + np.array([row, column]) * self.size)
        cells = np.concatenate(found)
        return cells[np.lexsort((cells[:, 1], cells[:, 0]))]

    def any(self, test: Any) -> bool:
        """Whether a cell's value passes the ``test``."""
        return any(bool(test(self.pool[index]).any()) for index in self.index.tolist())

    def dense(self, box: Box) -> NDArray[Any]:
        """The values of a box of cells as an array of its own; 0 where there is no tile."""
        top, left, bottom, right = box
        out = np.zeros((bottom - top + 1, right - left + 1, *self.pool.shape[3:]), self.pool.dtype)
        n = self.size
        near = (self.rows >= top // n) & (self.rows <= bottom // n)
        near &= (self.columns >= left // n) & (self.columns <= right // n)
        rows, columns = (self.rows[near] * n - top).tolist(), (self.columns[near] * n - left).tolist()
        height, width = out.shape[:2]
        for row, column, index in zip(rows, columns, self.index[near].tolist(), strict=True):
            up, down, west, east = max(row, 0), min(row + n, height), max(column, 0), min(column + n, width)
            out[up:down, west:east] = self.pool[index, up - row : down - row, west - column : east - column]
        return out


def overlap(start: int, length: int, size: int) -> tuple[slice, slice]:
    """Where ``length`` cells from ``start`` on lie within the first ``size``, and which of them do."""
    low, high = max(start, 0), min(start + length, size)
    return slice(low, high), slice(low - start, high - start)


class TiledArrays:
    """Arrays over the same cells, by name. The first one's cells are known where they are not 0.

    Attributes:
        arrays: (rows, columns, ...) each, to be written to; new ones whenever :meth:`cover` answers True.
        origin: row and column in them of the cell at the world's origin.
        windowed: whether they are a window: there may be more outside.
    """

    def __init__(self, kinds: Mapping[str, tuple[DTypeLike, tuple[int, ...]]]) -> None:
        """``kinds``: type and shape of what each array holds of a cell."""
        self._kinds = dict(kinds)
        self._known = next(iter(kinds))
        shape = (2 * MARGIN, 2 * MARGIN)
        self.arrays = {name: np.zeros((*shape, *more), kind) for name, (kind, more) in self._kinds.items()}
        self.origin = (MARGIN, MARGIN)
        self.windowed = False
        self._pools = {name: np.zeros((0, TILE, TILE, *more), kind) for name, (kind, more) in self._kinds.items()}
        self._places: dict[tuple[int, int], int] = {}

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the arrays."""
        rows, columns = self.arrays[self._known].shape[:2]
        return rows, columns

    def cover(self, top: int, left: int, bottom: int, right: int) -> bool:
        """Have these rows and columns, counted from the world origin's cell, inside of the arrays' outermost ring.

        That ring stays unknown while the arrays hold everything. Whether anything had to change. A window is at most
        :data:`WIDEST` cells wide, about the middle of what was asked for.
        """
        pad = self._lacking(top, left, bottom, right)
        if not any(map(any, pad)):
            return False
        if not self._stays_dense(pad):
            return self._move(top, left, bottom, right)
        for name, values in self.arrays.items():
            self.arrays[name] = np.pad(values, pad + ((0, 0),) * (values.ndim - 2))
        self.origin = self.origin[0] + pad[0][0], self.origin[1] + pad[1][0]
        return True

    def holds_all(self, top: int, left: int, bottom: int, right: int) -> bool:
        """Whether the arrays will not be a window once these cells are covered."""
        return self._stays_dense(self._lacking(top, left, bottom, right))

    def _lacking(self, top: int, left: int, bottom: int, right: int) -> Pad:
        """Rows above and below, columns before and after, by which the arrays have to grow for these cells."""
        (row, column), (rows, columns) = self.origin, self.shape
        above = MARGIN - row - top if row + top < 1 else 0
        before = MARGIN - column - left if column + left < 1 else 0
        below = row + bottom + 1 + MARGIN - rows if row + bottom > rows - 2 else 0
        after = column + right + 1 + MARGIN - columns if column + right > columns - 2 else 0
        return (above, below), (before, after)

    def _stays_dense(self, pad: Pad) -> bool:
        rows, columns = (size + sum(more) for size, more in zip(self.shape, pad, strict=True))
        return not self.windowed and rows * columns <= MOST

    def _move(self, top: int, left: int, bottom: int, right: int) -> bool:
        """Make the arrays a window round these cells, whole tiles; False if it is there already."""
        first_row, rows = _span(top, bottom)
        first_column, columns = _span(left, right)
        if self.windowed and self.origin == (-first_row, -first_column) and self.shape == (rows, columns):
            return False
        self._keep(self._kinds)
        self.windowed = True
        self.origin = (-first_row, -first_column)
        self.arrays = {name: np.zeros((rows, columns, *more), kind) for name, (kind, more) in self._kinds.items()}
        for tile, here, there in self._tiles():
            place = self._places.get(tile)
            if place is not None:
                for name, values in self.arrays.items():
                    values[here] = self._pools[name][place][there]
        return True

    def _tiles(self) -> Iterator[tuple[tuple[int, int], Part, Part]]:
        """Every tile that the arrays have a part of: which one, where in the arrays that is, and where in the tile."""
        (row, column), (rows, columns) = self.origin, self.shape
        for i in range(-row // TILE, (rows - row - 1) // TILE + 1):
            down, within = overlap(i * TILE + row, TILE, rows)
            for j in range(-column // TILE, (columns - column - 1) // TILE + 1):
                right, beside = overlap(j * TILE + column, TILE, columns)
                yield (i, j), (down, right), (within, beside)

    def _keep(self, names: Iterable[str]) -> None:
        """Copy what these arrays hold into the tiles."""
        from pfslam_viz.slam import map_kernels

        (row, column), names = self.origin, list(names)
        known = map_kernels.known_tiles(self.arrays[self._known], -row % TILE, -column % TILE, TILE)
        first, begin = -row // TILE, -column // TILE
        for tile, here, there in self._tiles():
            if known[tile[0] - first, tile[1] - begin] or tile in self._places:
                place = self._place(tile)
                for name in names:
                    self._pools[name][place][there] = self.arrays[name][here]

    def _place(self, tile: tuple[int, int]) -> int:
        """Where in the pools a tile is; room for it is made if it is new."""
        place = self._places.setdefault(tile, len(self._places))
        if place >= len(self._pools[self._known]):
            more = max(FIRST, len(self._places) // 2)
            for name, pool in self._pools.items():
                self._pools[name] = enlarged(pool, more)
        return place

    def tiled(self, *names: str) -> list[Tiled]:
        """All values of these arrays, those outside of a window too. They change with the next call of any method."""
        self._keep(names)
        places = np.array(list(self._places), np.int64).reshape(-1, 2)
        index = np.fromiter(self._places.values(), np.int64, len(self._places))
        return [Tiled(places[:, 0], places[:, 1], index, self._pools[name]) for name in names]

    def outside(self, cells: Index) -> NDArray[np.bool_]:
        """Which of the cells (m, 2), row and column from the world origin's, the arrays do not hold."""
        inside = cells + self.origin
        return np.asarray(((inside < 0) | (inside >= self.shape)).any(axis=1))

    def far(self, name: str, cells: Index) -> NDArray[Any]:
        """The values (m, ...) of an array at cells (m, 2) that are :meth:`outside`; 0 where nothing is known."""
        out = np.zeros((len(cells), *self._kinds[name][1]), self._kinds[name][0])
        for tile, chosen in _by_tile(cells):
            place = self._places.get(tile)
            if place is not None:
                i, j = (cells[chosen] % TILE).T
                out[chosen] = self._pools[name][place][i, j]
        return out

    def put(self, name: str, cells: Index, values: NDArray[Any]) -> None:
        """Write ``values`` (m, ...) of an array at different cells (m, 2) that are :meth:`outside`."""
        self.windowed |= len(cells) > 0
        for tile, chosen in _by_tile(cells):
            i, j = (cells[chosen] % TILE).T
            place = self._place(tile)
            self._pools[name][place][i, j] = values[chosen]


def _span(first: int, last: int) -> tuple[int, int]:
    """First cell and number of cells of whole tiles that hold these and some more, but not too many."""
    start, end = first - SLACK, last + SLACK
    if end - start > WIDEST:
        start = (first + last) // 2 - WIDEST // 2
        end = start + WIDEST
    start = start // TILE * TILE
    return start, -(-(end + 1 - start) // TILE) * TILE


def _by_tile(cells: Index) -> Iterator[tuple[tuple[int, int], NDArray[np.intp]]]:
    """The tiles that hold some of the cells (m, 2), and which of the cells each holds."""
    if not len(cells):
        return
    tiles = cells // TILE
    order = np.lexsort((tiles[:, 1], tiles[:, 0]))
    ends = np.flatnonzero(np.diff(tiles[order], axis=0).any(axis=1)) + 1
    for chosen in np.split(order, ends):
        row, column = tiles[chosen[0]].tolist()
        yield (row, column), chosen


def enlarged(pool: NDArray[Any], more: int) -> NDArray[Any]:
    """A pool (n, ...) with so many more places, all 0, which take no memory until somebody writes there."""
    out = np.zeros((len(pool) + more, *pool.shape[1:]), pool.dtype)
    out[: len(pool)] = pool
    return out


def distinct(cells: Index, without: Index | None = None) -> Index:
    """The cells (m, 2), each once, and none of those ``without`` (n, 2)."""
    keys, first = np.unique(_keys(cells), return_index=True)
    return cells[first if without is None else first[~np.isin(keys, _keys(without))]]


def _keys(cells: Index) -> Index:
    """One number (m,) for each cell (m, 2)."""
    return np.asarray((cells[:, 0] << 32) + cells[:, 1])
