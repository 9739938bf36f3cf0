"""Maps in blocks: what is drawn again, and whether all of it together is the map."""

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.tiles import TiledArrays
from pfslam_viz.viewer import blocks, contents
from pfslam_viz.viewer.blocks import Block, Changes, GridBlocks, WallBlocks, edge_for
from pfslam_viz.viewer.contents import UNKNOWN, Boxes, Cells

EDGE, CELL = 64, 0.1
HERE = np.zeros(2)


def some_map(steps: int = 40) -> OccupancyGrid:
    """A drive of 20 m among random end points, which crosses some blocks."""
    grid, rng = OccupancyGrid(MapConfig(cell=CELL)), np.random.default_rng(2)
    for k in range(steps):
        add(grid, 0.5 * k, rng)
    return grid


def add(grid: OccupancyGrid, x: float, rng: np.random.Generator) -> None:
    angles = np.linspace(-3, 3, 40)
    points = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * rng.uniform(1, 4, (40, 1))
    grid.add(np.array([x, 0.3 * x, 0.1]), points, HERE)


def drawn(grid: OccupancyGrid, shown: GridBlocks, allowance: int | None = None) -> list[Block]:
    tiled = grid.tiled()

    def draw(block: blocks.Place) -> NDArray[np.uint8]:
        return contents.map_block(grid, tiled, shown.changes.box(block))

    return shown.update(tiled, draw, allowance)


def fresh(cell: float = CELL) -> GridBlocks:
    return GridBlocks(Changes(EDGE, contents.gap_halo(cell)), cell, 0.0)


def cells_of(newest: dict[str, Cells]) -> dict[tuple[int, int], int]:
    """Known cells of all blocks by column and row, counted in cells of CELL m from the world's origin, y upwards."""
    out: dict[tuple[int, int], int] = {}
    for content in newest.values():
        rows = content.values.shape[0]
        for i, j in np.argwhere(content.values != UNKNOWN):
            x, y = content.corner[0] + (j + 0.5) * content.cell, content.corner[1] + (rows - i - 0.5) * content.cell
            assert content.cell == pytest.approx(CELL)
            place = int(np.floor(x / CELL)), int(np.floor(y / CELL))
            assert place not in out
            out[place] = int(content.values[i, j])
    return out


def whole(grid: OccupancyGrid) -> dict[tuple[int, int], int]:
    return cells_of({"": contents.grid_map(grid)})


def newest(*updates: list[Block]) -> dict[str, Cells]:
    out = {}
    for update in updates:
        for block in update:
            assert isinstance(block.content, Cells)
            out[block.part] = block.content
    return out


def test_the_blocks_together_are_the_map() -> None:
    """At every update, gaps between rays that lie across blocks included; nothing twice, nothing left over."""
    grid, rng, shown, updates = OccupancyGrid(MapConfig(cell=CELL)), np.random.default_rng(2), fresh(), []
    for k in range(40):
        add(grid, 0.5 * k, rng)
        if k % 8 == 7:
            updates.append(drawn(grid, shown))
            assert cells_of(newest(*updates)) == whole(grid)
    assert len(newest(*updates)) > 8 and "" in newest(*updates)
    assert len(updates[-1]) < len(newest(*updates))  # those that the robot has left are not drawn again


def test_what_looks_the_same_is_not_drawn_again() -> None:
    """Cells that are surer than before, but as white and black."""
    grid, shown = OccupancyGrid(MapConfig(cell=CELL)), fresh()
    points = np.array([[2.0, 0.0], [8.0, 1.0]])
    grid.add(np.zeros(3), points, HERE)
    assert len(drawn(grid, shown)) == 2
    assert drawn(grid, shown) == []
    grid.add(np.zeros(3), points, HERE)
    assert drawn(grid, shown) == []
    grid.add(np.zeros(3), np.array([[8.0, 2.0]]), HERE)
    assert len(drawn(grid, shown)) == 2


def test_a_block_that_is_empty_now_becomes_unknown() -> None:
    """After a revision, where the robot is not believed to have been any more."""
    grid, other, shown = some_map(40), some_map(10), fresh()
    first = drawn(grid, shown)
    second = drawn(other, shown)
    assert cells_of(newest(first, second)) == whole(other)
    empty = [block.content for block in second if isinstance(block.content, Cells) and block.content.values.size == 1]
    assert len(empty) > 3
    for content in empty:  # one cell over all of the block
        assert content.values[0, 0] == UNKNOWN and content.cell == pytest.approx(EDGE * CELL)
        assert np.mod(np.array(content.corner[:2]) / (EDGE * CELL), 1.0) == pytest.approx([0.5, 0.5])


def test_a_small_allowance_is_kept_with_larger_cells_that_become_small_again() -> None:
    grid, shown = some_map(), fresh()
    size = sum(c.values.nbytes for c in newest(drawn(grid, fresh())).values())
    first = newest(drawn(grid, shown, size // 10))
    assert sum(c.values.nbytes for c in first.values()) <= size // 10
    assert {round(c.cell / CELL) for c in first.values()} == {4} and shown.coarsened
    coarse = np.concatenate([c.values.ravel() for c in first.values()])
    assert (coarse == 100).sum() > 50 and (coarse == 0).any()
    second = newest(drawn(grid, shown, size // 2))
    assert 0 < len(second) < len(first) and {round(c.cell / CELL) for c in second.values()} == {1}
    third = newest(drawn(grid, shown))
    assert cells_of(first | second | third) == whole(grid)
    assert drawn(grid, shown) == []


def test_a_large_cell_shows_the_wall_in_it() -> None:
    image = np.full((4, 4), UNKNOWN, np.uint8)
    image[0, 1], image[0, 0], image[2, 2] = 100, 0, 0
    np.testing.assert_array_equal(blocks._halved(image, 1), [[100, UNKNOWN], [UNKNOWN, 0]])
    colors = np.zeros((2, 2, 4), np.uint8)
    colors[1, 0] = (5, 6, 7, 255)
    np.testing.assert_array_equal(blocks._halved(colors, 1), [[[5, 6, 7, 255]]])


def test_walls_are_drawn_by_block_too() -> None:
    grid, shown = some_map(), WallBlocks(Changes(EDGE))
    tiled = grid.tiled()
    draw = partial(boxes, grid, shown)
    first = list(shown.update(tiled, draw))
    assert len(first) > 5 and list(shown.update(grid.tiled(), draw)) == []
    area = 0.0
    for block in first:
        assert isinstance(block.content, Boxes)
        area += float((4 * block.content.half_sizes[:, 0] * block.content.half_sizes[:, 1]).sum())
    assert area == pytest.approx(len(grid.occupied_cells()) * CELL**2, rel=1e-5)


def boxes(grid: OccupancyGrid, shown: WallBlocks, block: blocks.Place) -> Boxes:
    return contents.wall_block(grid, grid.tiled(), shown.changes.box(block))


def test_every_changed_cell_changes_its_tiles_fingerprint() -> None:
    """Each of 4,096 cells by itself, to 1, to -1 and by the last bit."""
    arrays = TiledArrays({"value": (np.float32, ())})
    values, (row, column) = arrays.arrays["value"], arrays.origin
    values[row : row + 64, column : column + 64] = np.random.default_rng(0).normal(0, 1, (64, 64))
    changes = Changes(64)
    changes.find(arrays.tiled("value")[0])
    for i, j in np.ndindex(64, 64):
        for value in (1.0, -1.0, np.nextafter(np.float32(-1.0), np.float32(0.0))):
            values[row + i, column + j] = value
            assert changes.find(arrays.tiled("value")[0]), (i, j, value)
    assert changes.find(arrays.tiled("value")[0]) == []


def test_blocks_are_larger_where_a_drive_is_long() -> None:
    """So that there are some hundred of them at most: the viewer asks each at every picture."""
    for meters in (50.0, 2_000.0, 20_000.0):
        along = np.arange(0.0, meters, 1.0)
        poses = np.stack([along, 10.0 * np.sin(along / 50.0), 0 * along], axis=-1)
        edge = edge_for(poses, 0.05)
        assert edge == (256 if meters < 1_000 else edge)
        assert (meters + 30.0) / (edge * 0.05) * (30.0 / (edge * 0.05) + 1) < 2.5 * blocks.MOST_BLOCKS
    assert edge > 256
