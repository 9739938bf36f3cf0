"""Maps, whatever is written into them: the grid that grows, and the particles' maps that share tiles."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]
Cell = tuple[int, int]

CELL = 0.25  # m; a power of two, so that cells can be told exactly
BOUND = 3.0
HIT, MISS = 1.25, 0.5

PLACES = st.floats(-60.0, 60.0)
POSES = st.tuples(PLACES, PLACES, st.floats(-4.0, 4.0)).map(np.array)
END_POINTS = st.lists(st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), max_size=12).map(
    lambda points: np.array(points, np.float64).reshape(-1, 2)
)
MOUNTS = st.sampled_from([(0.0, 0.0), (0.3, -0.1)]).map(np.array)
SCANS = st.tuples(POSES, END_POINTS, MOUNTS)


def cell_of(point: Array) -> Cell:
    return math.floor(-point[1] / CELL), math.floor(point[0] / CELL)


def line(start: Cell, end: Cell) -> list[Cell]:
    """Bresenham's cells from ``start`` up to, but not with, ``end``."""
    rows, columns = abs(end[0] - start[0]), abs(end[1] - start[1])
    down, right = (1 if end[0] >= start[0] else -1), (1 if end[1] >= start[1] else -1)
    (row, column), error, cells = start, columns - rows, []
    for _ in range(max(rows, columns)):
        cells.append((row, column))
        twice = 2 * error
        if twice > -rows:
            error, column = error - rows, column + right
        if twice < columns:
            error, row = error + columns, row + down
    return cells


def cells_of_scan(scan: tuple[Array, Array, Array]) -> tuple[Cell, list[Cell]]:
    """The lidar's cell and those of the end points."""
    pose, points, mount = scan
    return cell_of(geometry.transform(pose, mount[None])[0]), [cell_of(p) for p in geometry.transform(pose, points)]


def known(log_odds: NDArray[np.float32], origin: tuple[int, int]) -> dict[Cell, float]:
    """The cells that are not 0, counted from the world's origin."""
    return {(int(i) - origin[0], int(j) - origin[1]): float(log_odds[i, j]) for i, j in np.argwhere(log_odds != 0)}


@given(st.lists(SCANS, min_size=1, max_size=6), st.permutations(range(6)))
@settings(max_examples=40)
def test_a_grid_that_grows_is_one_that_has_no_end(scans: list[tuple[Array, Array, Array]], other: list[int]) -> None:
    """(28): hit cells gain, crossed ones lose, once a scan, within bounds; wherever the drive leads, in any order."""
    config = MapConfig(cell=CELL, log_odds_hit=HIT, log_odds_miss=MISS, log_odds_bound=BOUND)
    expected: dict[Cell, float] = {}
    grid, at_once, grown_before = OccupancyGrid(config), OccupancyGrid(config), OccupancyGrid(config)
    for k in sorted(range(len(scans)), key=other.index):  # so large already that nothing makes it grow
        empty = np.zeros((0, 2))
        pose, points, mount = scans[k]
        for point in geometry.transform(pose, points):
            grown_before.add(np.array([*point, 0.0]), empty, np.zeros(2))
        grown_before.add(pose, empty, mount)
    np.testing.assert_array_equal(grown_before.log_odds, 0)
    shape = grown_before.shape
    for pose, points, mount in scans:
        start, ends = cells_of_scan((pose, points, mount))
        crossed = {cell for end in ends for cell in line(start, end)} - set(ends)
        for cell in set(ends):
            expected[cell] = min(expected.get(cell, 0.0) + HIT, BOUND)
        for cell in crossed:
            expected[cell] = max(expected.get(cell, 0.0) - MISS, -BOUND)
        world = grid.add(pose, points, mount)
        np.testing.assert_allclose(world, geometry.transform(pose, points), atol=1e-9)
        grown_before.add(pose, points, mount)
    at_once.add_all(scans)
    expected = {cell: value for cell, value in expected.items() if value != 0}
    for g in (grid, at_once, grown_before):
        assert known(g.log_odds, g.origin) == expected
        np.testing.assert_array_equal(g.occupied > 0, g.log_odds > 0)
        outer = np.concatenate([g.log_odds[[0, -1]].ravel(), g.log_odds[:, [0, -1]].ravel()])
        assert not outer.any()
    assert grown_before.shape == shape


@given(st.lists(SCANS, min_size=1, max_size=3), st.integers(-9, 9), st.integers(-9, 9))
@settings(max_examples=25)
def test_the_correlation_is_how_many_occupied_cells_are_marked(
    scans: list[tuple[Array, Array, Array]], right: int, up: int
) -> None:
    """(26), counted with sets, for the scan's own pose and for others; alike with a second thread."""
    config = MapConfig(cell=CELL, log_odds_hit=HIT, log_odds_miss=MISS, log_odds_bound=BOUND)
    grid = OccupancyGrid(config)
    grid.add_all(scans)
    pose, points, _ = scans[-1]
    pose, points = pose + 0.0071, points + 0.0137  # off the cells' edges, where rounding decides
    poses = np.tile(pose, (150, 1))
    poses[1:, 0] += right * CELL * np.linspace(0, 1, 149)
    poses[1:, 1] += up * CELL
    occupied = {cell for cell, value in known(grid.log_odds, grid.origin).items() if value > 0}
    due = [len({cell_of(p) for p in geometry.transform(one, points)} & occupied) for one in poses]
    assert grid.correlation(poses, points).tolist() == due
    worker = Worker(threads=2)
    try:
        assert grid.correlation(poses, points, worker).tolist() == due
    finally:
        worker.close()


@st.composite
def histories(draw: st.DrawFn) -> tuple[int, list[tuple[str, int]]]:
    """How many maps there are, and what happens to them: a scan is written, or they are resampled; by a seed each."""
    count = draw(st.integers(1, 6))
    seeds = st.integers(0, 2**32 - 1)
    return count, draw(st.lists(st.tuples(st.sampled_from(["write", "write", "resample"]), seeds), max_size=9))


@given(histories())
@settings(max_examples=25)
def test_maps_that_share_tiles_are_as_maps_of_their_own(history: tuple[int, list[tuple[str, int]]]) -> None:
    """Every map of many is, cell by cell, the one that gets its ancestors' scans and shares nothing."""
    count, events = history
    config = TileSettings(cell=CELL, log_odds_hit=HIT, log_odds_miss=MISS, log_odds_bound=BOUND)
    maps = TileMaps(count, config)
    pasts: list[list[tuple[Array, Array, Array]]] = [[] for _ in range(count)]
    for what, seed in events:
        rng = np.random.default_rng(seed)
        if what == "resample":
            parents = np.sort(rng.integers(0, count, count))
            maps.resample(parents)
            pasts = [list(pasts[p]) for p in parents]
        else:
            poses = rng.uniform(-30, 30, (1, 3)) + rng.normal(0, 0.3, (count, 3))
            points, mount = rng.uniform(-15, 15, (int(rng.integers(0, 20)), 2)), np.array([0.3, -0.1])
            maps.write(poses, points, mount)
            for past, pose in zip(pasts, poses, strict=True):
                past.append((pose, points, mount))
    for index, past in enumerate(pasts):
        alone = TileMaps(1, config)
        for pose, points, mount in past:
            alone.write(pose[None], points, mount)
        assert known(*maps.log_odds_of(index)) == known(*alone.log_odds_of(0))
        log_odds, _ = maps.log_odds_of(index)
        assert np.abs(log_odds).max(initial=0.0) <= BOUND
        probe = np.zeros(3), np.random.default_rng(index).uniform(-45, 45, (200, 2))
        for mine, lone in zip(maps.project(index, *probe), alone.project(0, *probe), strict=True):
            np.testing.assert_array_equal(mine, lone)
