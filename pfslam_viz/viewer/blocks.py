"""Maps in blocks of cells, an entity each: only those that changed are drawn again.

A map of a long drive changes round the robot alone. Drawn whole, 200 times, it would fill the viewer's memory; as one
picture of few cells, it would hide the walls. So each block is drawn anew when something in it looks different, and at
any step the newest of all blocks together are the whole map.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.tiles import Tiled
from pfslam_viz.viewer import kernels
from pfslam_viz.viewer.contents import UNKNOWN, Boxes, Cells, Content

Place = tuple[int, int]  # of a block: row and column, (0, 0) being the one about the world's origin
Image = NDArray[np.uint8]
Crop = tuple[slice, slice] | None  # what is known of an image, if anything is

EDGES = (256, 512, 1024, 2048)  # cells along a block's edge: the first one with which there are not too many
MOST_BLOCKS = 200  # that a map will have, as far as can be foreseen: each costs the viewer a tenth of a millisecond
SEEN = 15.0  # m round the robot that a map is foreseen to hold
COARSEST = 3  # times that cells are halved at most, where a map must not cost much


@dataclass(frozen=True, slots=True)
class Block:
    """A block's new look: the part of its entity's path, empty for the one about the origin, and what it shows."""

    part: str
    content: Content


def edge_for(poses: NDArray[np.float64], cell: float) -> int:
    """How many cells wide blocks should be for a map of a drive along ``poses`` (n, 3), of cells of so many m."""
    for edge in EDGES[:-1]:
        width = edge * cell
        around = SEEN * np.array([[i, j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
        touched = [np.floor((poses[:, :2] + offset) / width).astype(np.int64) for offset in around]
        if len(np.unique(np.concatenate(touched), axis=0)) <= MOST_BLOCKS:
            return edge
    return EDGES[-1]


class Changes:
    """Finds the blocks of one map in which something changed since the last time."""

    def __init__(self, edge: int, halo: int = 0) -> None:
        """``edge`` cells wide; what a block looks like depends on so many cells round it too (``halo``)."""
        self.edge, self.halo = edge, halo
        self._keys, self._prints = np.zeros(0, np.int64), np.zeros(0, np.uint32)

    def find(self, tiled: Tiled) -> list[Place]:
        """The blocks with a tile that is new, gone or another; in order."""
        prints = kernels.fingerprints(tiled.pool.view(np.uint32), np.asarray(tiled.index, np.int64))
        keys = (tiled.rows.astype(np.int64) << 32) + tiled.columns
        order = np.argsort(keys)
        keys, prints = keys[order], prints[order]
        known, at = _found(keys, self._keys)
        known[known] = self._prints[at[known]] == prints[known]
        changed = np.concatenate([keys[~known], self._keys[~_found(self._keys, keys)[0]]])
        self._keys, self._prints = keys, prints
        return self._blocks_of(changed, tiled.size)

    def _blocks_of(self, keys: NDArray[np.int64], size: int) -> list[Place]:
        columns = ((keys + 2**31) & (2**32 - 1)) - 2**31
        tiles = np.stack([(keys - columns) >> 32, columns], axis=-1) * size
        low = (tiles - self.halo + self.edge // 2) // self.edge
        high = (tiles + size - 1 + self.halo + self.edge // 2) // self.edge
        found: set[Place] = set()
        for (top, left), (bottom, right) in zip(low.tolist(), high.tolist(), strict=True):
            found.update((i, j) for i in range(top, bottom + 1) for j in range(left, right + 1))
        return sorted(found)

    def box(self, block: Place, halo: int = 0) -> tuple[int, int, int, int]:
        """First row and column, last row and column of a block's cells, and so many more to every side."""
        top, left = (index * self.edge - self.edge // 2 for index in block)
        return top - halo, left - halo, top + self.edge - 1 + halo, left + self.edge - 1 + halo


class GridBlocks:
    """The blocks of one map that is drawn as cells."""

    def __init__(self, changes: Changes, cell: float, z: float) -> None:
        """Cells of ``cell`` m, drawn at height ``z`` m."""
        self.changes = changes
        self._cell, self._z = cell, z
        self._looks: dict[Place, int] = {}  # of what was drawn last
        self._coarse: set[Place] = set()  # drawn with fewer cells than there are
        self.coarsened = False

    def update(self, tiled: Tiled, draw: Callable[[Place], Image], allowance: int | None = None) -> list[Block]:
        """The blocks that look different now, at most about so many bytes of them (None: whatever it takes).

        ``draw`` gives the cells of a block: numbers, :data:`UNKNOWN` where nothing is known, or RGBA colours. Where all
        of them are too many bytes, larger cells are drawn; as soon as there is room, or with None, small ones again.
        """
        drawn: list[tuple[Place, Image, Crop]] = []
        for block in self.changes.find(tiled):
            image = draw(block)
            crop = _crop(image)
            look = hash(image.tobytes()) if crop is not None else 0
            if look != self._looks.get(block, 0):
                self._looks[block] = look
                drawn.append((block, image, crop))
        level, size = 0, sum(_size(image, crop) for _, image, crop in drawn)
        while allowance is not None and level < COARSEST and size >> (2 * level) > allowance:
            level += 1
        out = [self._block(block, image, crop, level) for block, image, crop in drawn]
        self._coarse.difference_update(block for block, _, _ in drawn)
        if level:
            self.coarsened = True
            self._coarse.update(block for block, _, _ in drawn)
            return out
        left = None if allowance is None else allowance - size
        for block in sorted(self._coarse):
            image = draw(block)
            crop = _crop(image)
            size = _size(image, crop)
            if left is not None and size > left:
                break
            left = None if left is None else left - size
            out.append(self._block(block, image, crop, 0))
            self._coarse.discard(block)
        return out

    def _block(self, block: Place, image: Image, crop: Crop, level: int) -> Block:
        """A block's known part, its cells halved ``level`` times; a single unknown cell where nothing is known."""
        top, left, _, _ = self.changes.box(block)
        if crop is None:
            image, cell = image[:1, :1], self._cell * self.changes.edge
            return Block(
                _part(block), Cells(image, cell, (left * self._cell, -(top + self.changes.edge) * self._cell, self._z))
            )
        if level:
            image = _halved(image, level)
            crop = _crop(image) or (slice(0, 1), slice(0, 1))
        cell = self._cell * 2**level
        row, column = crop[0].start, crop[1].start
        image = image[crop]
        x, y = left * self._cell + column * cell, -top * self._cell - (row + len(image)) * cell
        return Block(_part(block), Cells(np.ascontiguousarray(image), cell, (x, y, self._z)))


class WallBlocks:
    """The blocks of one map whose walls are raised: boxes."""

    def __init__(self, changes: Changes) -> None:
        self.changes = changes
        self._looks: dict[Place, int] = {}

    def update(self, tiled: Tiled, draw: Callable[[Place], Boxes]) -> Iterator[Block]:
        """The blocks whose walls are other ones now."""
        for block in self.changes.find(tiled):
            boxes = draw(block)
            look = hash(boxes.centers.tobytes() + boxes.half_sizes.tobytes()) if len(boxes.centers) else 0
            if look != self._looks.get(block, 0):
                self._looks[block] = look
                yield Block(_part(block), boxes)


def _found(keys: NDArray[np.int64], among: NDArray[np.int64]) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """Which of the ``keys`` (k,) are ``among`` others (n,), all in order and each once, and where; else anywhere."""
    at = np.searchsorted(among, keys)
    if not len(among):
        return np.zeros(len(keys), np.bool_), at
    at[at == len(among)] = 0
    return among[at] == keys, at


def _part(block: Place) -> str:
    """The part of the path that tells a block from others."""
    return "" if block == (0, 0) else f"{block[0]}_{block[1]}"


def _known(image: Image) -> NDArray[np.bool_]:
    return np.asarray(image[..., 3] > 0 if image.ndim == 3 else image != UNKNOWN)


def _crop(image: Image) -> Crop:
    """The rows and columns of an image that hold everything known; None where nothing is."""
    known = _known(image)
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        return None
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _size(image: Image, crop: Crop) -> int:
    """Bytes of a cropped image; of one cell where nothing is known."""
    return image[:1, :1].nbytes if crop is None else image[crop].nbytes


def _halved(image: Image, times: int) -> Image:
    """An image with cells 2^``times`` as wide: of four cells, the one most surely occupied, or a painted one."""
    for _ in range(times):
        four = [image[i::2, j::2] for i in (0, 1) for j in (0, 1)]
        if image.ndim == 2:
            image = np.maximum.reduce([part + np.uint8(1) for part in four]) - np.uint8(1)  # unknown, 255, counts least
        else:
            image = _first_painted(four)
    return image


def _first_painted(images: Sequence[Image]) -> Image:
    out = images[0].copy()
    for image in images[1:]:
        bare = out[..., 3] == 0
        out[bare] = image[bare]
    return out
