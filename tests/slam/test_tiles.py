"""Arrays that become a window on tiles, against arrays that hold everything."""

from collections.abc import Iterator

import numpy as np
import pytest

from pfslam_viz.errors import PfslamError
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam import occupancy_grid, tiles
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.tiles import TILE, Tiled, TiledArrays

CONFIG = MapConfig(cell=0.1)
HERE = np.zeros(2)


def limit(monkeypatch: pytest.MonkeyPatch, most: int, widest: int, slack: int = 32) -> None:
    """Windows from so many cells on, so wide at most."""
    for module in (tiles, occupancy_grid):
        monkeypatch.setattr(module, "WIDEST", widest)
        monkeypatch.setattr(module, "SLACK", slack)
    monkeypatch.setattr(tiles, "MOST", most)


# The arrays


def test_what_leaves_the_window_comes_back_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A walk to and fro over 3,000 cells, one of which is written at each step: a dictionary knows as much."""
    limit(monkeypatch, 20_000, 256, 16)
    arrays = TiledArrays({"value": (np.float32, ()), "color": (np.uint8, (3,))})
    known: dict[tuple[int, int], int] = {}
    rng = np.random.default_rng(0)
    walk = np.concatenate([np.arange(-1500, 1500, 7), np.arange(1500, -1500, -11)])
    for k, column in enumerate(walk.tolist()):
        row = int(rng.integers(-20, 20)) + column // 3
        arrays.cover(row - 5, column - 5, row + 5, column + 5)
        i, j = row + arrays.origin[0], column + arrays.origin[1]
        assert 0 < i < arrays.shape[0] - 1 and 0 < j < arrays.shape[1] - 1
        assert arrays.arrays["value"][i, j] == known.get((row, column), 0)
        known[row, column] = k + 1
        arrays.arrays["value"][i, j], arrays.arrays["color"][i, j] = k + 1, (k % 256, 1, 2)
    assert arrays.windowed and max(arrays.shape) <= 256 + TILE
    value, color = arrays.tiled("value", "color")
    assert len(value) < 400  # of the 1,500 tiles of the box that it walked through
    top, left, _, _ = value.box()
    dense, colors = value.dense(value.box()), color.dense(value.box())
    found = {(int(i) + top, int(j) + left): int(dense[i, j]) for i, j in np.argwhere(dense)}
    assert found == known
    assert {c: colors[c[0] - top, c[1] - left].tolist() for c in known} == {
        c: [(k - 1) % 256, 1, 2] for c, k in known.items()
    }
    assert [tuple(c) for c in value.where(lambda v: v > 0).tolist()] == sorted(known)


def test_a_cell_that_is_unknown_again_is_so_in_the_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, 1_000, 256, 16)
    arrays = TiledArrays({"value": (np.float32, ())})
    for value in (1.0, 0.0):
        arrays.cover(0, 0, 5, 5)
        arrays.arrays["value"][3 + arrays.origin[0], 3 + arrays.origin[1]] = value
        arrays.cover(5000, 5000, 5005, 5005)
    assert not arrays.tiled("value")[0].any(lambda v: v != 0)


def test_far_cells_are_read_and_written_without_a_window(monkeypatch: pytest.MonkeyPatch) -> None:
    limit(monkeypatch, 1_000, 256, 16)
    arrays = TiledArrays({"value": (np.float32, ())})
    arrays.cover(0, 0, 100, 100)
    cells = np.array([[9000, -9000], [9001, -9000], [-70000, 3]])
    assert arrays.outside(cells).all() and not arrays.outside(np.array([[50, 50]])).any()
    assert arrays.far("value", cells).tolist() == [0, 0, 0]
    arrays.put("value", cells, np.array([1, 2, 3], np.float32))
    assert arrays.far("value", cells[::-1]).tolist() == [3, 2, 1]
    arrays.cover(9000, -9000, 9001, -9000)
    row, column = arrays.origin
    assert arrays.arrays["value"][9001 + row, -9000 + column] == 2
    assert len(arrays.tiled("value")[0]) == 2


def test_a_box_of_tiles_is_cut_at_its_edges() -> None:
    pool = np.arange(2 * 4 * 4, dtype=np.float32).reshape(2, 4, 4)
    tiled = Tiled(np.array([0, -1]), np.array([0, 1]), np.array([0, 1]), pool)
    assert tiled.box() == (-4, 0, 3, 7)
    expected = np.zeros((8, 8), np.float32)
    expected[4:, :4], expected[:4, 4:] = pool
    np.testing.assert_array_equal(tiled.dense((-4, 0, 3, 7)), expected)
    np.testing.assert_array_equal(tiled.dense((-2, 2, 1, 5)), expected[2:6, 2:6])
    np.testing.assert_array_equal(tiled.dense((-9, -9, 9, 9))[5:13, 9:17], expected)


@pytest.mark.parametrize("band", [1, 3, 4, 19, 20])
def test_a_box_is_put_together_band_by_band(monkeypatch: pytest.MonkeyPatch, band: int) -> None:
    """Some of 6 x 6 tiles of 4 x 4 cells of three colours, cell by cell from a dictionary; a box ends anywhere."""
    monkeypatch.setattr(tiles, "BAND", band)
    rng = np.random.default_rng(7)
    rows, columns = np.divmod(rng.permutation(36)[:20], 6)
    pool = rng.integers(1, 255, (30, 4, 4, 3), np.uint8)
    tiled = Tiled(rows - 3, columns - 2, rng.permutation(30)[:20], pool)
    cells = {
        (4 * row + i, 4 * column + j): pool[index, i, j].tolist()
        for row, column, index in zip(tiled.rows.tolist(), tiled.columns.tolist(), tiled.index.tolist(), strict=True)
        for i in range(4)
        for j in range(4)
    }
    for top, left, bottom, right in ((-12, -8, 11, 15), (-7, -5, 11, 2), (-20, 3, -2, 30), (5, 5, 5, 5)):
        box = tiled.dense((top, left, bottom, right))
        expected = [[cells.get((i, j), [0, 0, 0]) for j in range(left, right + 1)] for i in range(top, bottom + 1)]
        assert box.tolist() == expected and box.dtype == np.uint8


# The occupancy grid


def scans(stray: bool = True) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Twice round a circle of 50 m; two of the scans have a range of some hundreds of metres."""
    rng = np.random.default_rng(4)
    angles = np.linspace(-2.3, 2.3, 91)
    for k in range(120):
        turn = k * 4 * np.pi / 120
        ranges = rng.uniform(3, 25, 91)
        if stray and k in (40, 100):
            ranges[17] = 420.0
        pose = np.array([50 * np.sin(turn), 50 * np.cos(turn), turn])
        yield pose, np.stack([np.cos(angles), np.sin(angles)], axis=-1) * ranges[:, None], np.array([0.3, 0.0])


def drive(together: int = 1) -> tuple[OccupancyGrid, list[np.ndarray]]:
    """A grid with all scans, so many written at a time, and what was looked up in it before each of them."""
    grid, seen, waiting = OccupancyGrid(CONFIG), [], []
    offsets = np.random.default_rng(1).normal(0.0, 0.1, (30, 3))
    for pose, points, lidar in scans():
        seen += [grid.correlation(pose + offsets, points), grid.project(pose, points)[1]]
        if together == 1:
            grid.add(pose, points, lidar)
            continue
        waiting.append((pose, points, lidar))
        if len(waiting) == together:
            grid.add_all(waiting)
            waiting = []
    return grid, seen


@pytest.mark.parametrize(("most", "widest", "together"), [(60_000, 2048, 1), (60_000, 640, 1), (1_000, 640, 8)])
def test_a_window_holds_and_answers_what_a_dense_grid_does(
    most: int, widest: int, together: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit(monkeypatch, 10**9, 10**6)
    dense, answers = drive(together)
    limit(monkeypatch, most, widest)
    grid, others = drive(together)
    assert grid._cells.windowed and not dense._cells.windowed
    assert np.prod(grid._cells.shape) < 0.15 * np.prod(dense.shape)
    for name in ("log_odds", "occupied"):
        whole, windowed = getattr(dense, name), getattr(grid, name)
        np.testing.assert_array_equal(np.argwhere(windowed) - grid.origin, np.argwhere(whole) - dense.origin)
        np.testing.assert_array_equal(windowed[windowed != 0], whole[whole != 0])
    np.testing.assert_array_equal(grid.occupied_cells(), np.argwhere(dense.occupied) - dense.origin)
    np.testing.assert_allclose(grid.wall_positions(), dense.centers(np.argwhere(dense.occupied)), atol=1e-9)
    assert grid.has_walls
    np.testing.assert_array_equal(np.concatenate(others[1::2]), np.concatenate(answers[1::2]))
    # Cells are found in float32, counted from the array's corner: at a cell's edge, one count may differ.
    counts, same = np.concatenate(others[::2]), np.concatenate(answers[::2])
    assert np.abs(counts - same).max() <= 1 and (counts != same).mean() < 0.002 and same.sum() > 500


def test_beyond_a_window_there_is_no_wall(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where its outermost cells are walls, a point that is looked up there must not count."""
    limit(monkeypatch, 1_000, 640)
    grid = OccupancyGrid(CONFIG)
    for x in np.arange(0.0, 120.0, 2.0):  # a wall along the way
        grid.add(np.array([x, 0.0, 0.0]), np.array([[0.05 + 0.1 * k, 5.0] for k in range(20)]), HERE)
    assert grid._cells.windowed
    grid._reshape(grid._cells.cover(0, 600, 1, 601))
    occupied, _ = grid.window()
    assert occupied.any() and not occupied[[0, -1]].any() and not occupied[:, [0, -1]].any()
    assert (grid.log_odds > 0).sum() == grid.occupied.sum() > 1000  # they are walls all the same


@pytest.mark.parametrize("reach", [2_000.0, 20_000.0])
def test_one_stray_range_takes_little(reach: float) -> None:
    """Its cells, 5 bytes each and what shares their tiles, and not the box that they are the diagonal of."""
    grid = OccupancyGrid(MapConfig())
    points = np.array([[3.0, 1.0], [3.0, 1.1], [reach * 0.8, reach * 0.6]])
    grid.add(np.zeros(3), points, HERE)
    assert sum(pool.nbytes for pool in grid._cells._pools.values()) < 40_000 * reach
    assert np.prod(grid._cells.shape) < 4_000_000
    assert len(grid.occupied_cells()) == 3
    cells = np.argwhere(grid.occupied) if reach < 3_000.0 else grid.occupied_cells()
    assert len(cells) == 3
    x, y = grid.wall_positions().max(axis=0)
    assert (x, y) == pytest.approx((reach * 0.8, reach * 0.6), abs=0.08)
    assert grid.project(np.zeros(3), points)[1].all()


def test_a_scan_that_no_map_holds_is_refused_with_what_to_do() -> None:
    grid = OccupancyGrid(MapConfig())
    angles = np.linspace(-2.3, 2.3, 500)
    points = 20_000.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    with pytest.raises(PfslamError, match=r"20,000 m .* observation\.max_range"):
        grid.add(np.zeros(3), points, HERE)
