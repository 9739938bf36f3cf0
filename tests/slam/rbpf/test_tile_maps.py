"""Maps that share tiles, against one dictionary of cells per map."""

import math
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from threading import Event
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.rbpf import tile_kernels, tile_maps
from pfslam_viz.slam.rbpf.settings import RaoBlackwellizedConfig, RbpfConfig
from pfslam_viz.slam.rbpf.tile_kernels import SIZE
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings, field_kernel
from pfslam_viz.slam.worker import Worker
from tests.kernels import from_python

Array = NDArray[np.float64]

agreement = from_python(tile_kernels.agreement)
Cell = tuple[int, int]

CELL = 0.05
SENSOR = np.array([0.12, 0.03])


def config(**settings: Any) -> TileSettings:
    return TileSettings(**({"cell": CELL} | settings))


class PlainMap:
    """One map as a dictionary of log-odds; the field is computed from the occupied cells when somebody asks."""

    def __init__(self, config: TileSettings) -> None:
        self.config = config
        self.log_odds: defaultdict[Cell, np.float32] = defaultdict(lambda: np.float32(0.0))
        self.appeared = self.vanished = 0

    def copy(self) -> "PlainMap":
        out = PlainMap(self.config)
        out.log_odds.update(self.log_odds)
        return out

    def occupied(self) -> set[Cell]:
        return {cell for cell, value in self.log_odds.items() if value > np.float32(self.config.threshold)}

    def write(self, pose: Array, points: Array, sensor: Array) -> None:
        c = self.config
        before = self.occupied()
        start = cell_of(geometry.transform(pose, sensor[None])[0])
        ends = [cell_of(point) for point in geometry.transform(pose, points)]
        for end in ends[:: 1 + (len(ends) - 1) // c.free_beams]:
            for cell in line(start, end)[:-1]:
                self.log_odds[cell] = np.float32(max(float(self.log_odds[cell]) - c.log_odds_miss, -c.log_odds_bound))
        for cell in ends:
            self.log_odds[cell] = np.float32(min(float(self.log_odds[cell]) + c.log_odds_hit, c.log_odds_bound))
        after = self.occupied()
        self.appeared += len(after - before)
        self.vanished += len(before - after)

    def field(self) -> dict[Cell, np.float32]:
        """The greatest stamp of all the occupied cells round each cell."""
        out: dict[Cell, np.float32] = {}
        for row, column in self.occupied():
            for i in range(-self.config.reach, self.config.reach + 1):
                for j in range(-self.config.reach, self.config.reach + 1):
                    value = np.float32(stamp(i, j, self.config))
                    if value > 0:
                        at = row + i, column + j
                        out[at] = max(out.get(at, value), value)
        return out


def stamp(i: int, j: int, config: TileSettings) -> float:
    """Log of a Gaussian over a floor, above the log of the floor; nothing beyond the reach."""
    square = i * i + j * j
    if square > config.reach**2:
        return 0.0
    bell = math.exp(-0.5 * square * (config.cell / config.sigma) ** 2)
    return math.log(config.floor + (1 - config.floor) * bell) - math.log(config.floor)


def cell_of(point: Array) -> Cell:
    return math.floor(-point[1] / CELL), math.floor(point[0] / CELL)


def line(start: Cell, end: Cell) -> list[Cell]:
    """The cells nearest to the straight line, one a step along its longer axis; a tie goes to the start's side."""
    down, right = end[0] - start[0], end[1] - start[1]
    long = max(abs(down), abs(right))
    out = []
    for k in range(long + 1):
        rows, columns = (-((long - 2 * k * abs(d)) // (2 * long)) if long else 0 for d in (down, right))
        out.append((start[0] + (rows if down > 0 else -rows), start[1] + (columns if right > 0 else -columns)))
    return out


def cells_of(maps: TileMaps, index: int, tiles: NDArray[np.float32]) -> dict[Cell, np.float32]:
    """The cells of one map that are not 0, counted from the world's origin."""
    rows, columns = maps.table.shape[1:]
    out = {}
    for row in range(rows):
        for column in range(columns):
            tile = tiles[maps.table[index, row, column]]
            for i, j in zip(*np.nonzero(tile), strict=True):
                at = row * SIZE + int(i) - int(maps.origin[0]), column * SIZE + int(j) - int(maps.origin[1])
                out[at] = tile[i, j]
    return out


def dense(maps: TileMaps, index: int, tiles: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.block([[tiles[tile] for tile in row] for row in maps.table[index]])


def random_scan(rng: np.random.Generator, beams: int = 25, longest: float = 1.2) -> Array:
    """A jagged scan: walls that come and go from scan to scan."""
    bearing = np.sort(rng.uniform(-2.3, 2.3, beams))
    distance = rng.uniform(0.15, longest, beams)
    return SENSOR + np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)


def random_poses(rng: np.random.Generator, count: int, size: float = 1.0) -> Array:
    return np.column_stack([rng.uniform(-size, size, (count, 2)), rng.uniform(-np.pi, np.pi, count)])


def assert_equal_to(maps: TileMaps, twins: list[PlainMap]) -> None:
    for index, twin in enumerate(twins):
        assert cells_of(maps, index, maps.log_odds) == {k: v for k, v in twin.log_odds.items() if v != 0}
        assert cells_of(maps, index, maps.field) == pytest.approx(twin.field(), abs=1e-6)


def assert_consistent(maps: TileMaps) -> None:
    """References count the table's entries, a free tile is nobody's, and nobody has written on the empty tile."""
    used, count = np.unique(maps.table, return_counts=True)
    shared = dict(zip(used.tolist(), count.tolist(), strict=True)) | {0: 0}
    references = {tile: int(n) for tile, n in enumerate(maps._references) if tile and n}
    assert references | {0: 0} == shared
    free = maps._free[: maps._free_count[0]]
    assert len(np.unique(free)) == len(free) and 0 not in free
    assert not np.isin(free, used).any()
    assert len(free) + len(np.union1d(used, [0])) == len(maps.log_odds)
    assert not maps.log_odds[0].any() and not maps.field[0].any()


def test_the_field_round_one_cell() -> None:
    """On it log(1 / floor); 2 cells of 5 cm away log((0.1 + 0.9 exp(-2)) / 0.1) for sigma 5 cm; a round shape."""
    kernel = field_kernel(0.05, 0.05, 0.1, 3)
    assert kernel.shape == (7, 7)
    assert kernel[3, 3] == pytest.approx(math.log(10))
    assert kernel[3, 5] == kernel[1, 3] == pytest.approx(math.log(1 + 9 * math.exp(-2)))
    assert kernel[4, 5] == pytest.approx(math.log(1 + 9 * math.exp(-2.5)))
    assert kernel[3, 0] == pytest.approx(math.log(1 + 9 * math.exp(-4.5)))  # the reach itself counts
    assert kernel[2, 0] == kernel[0, 2] == kernel[0, 0] == 0


def test_one_beam_by_hand() -> None:
    """From (0.025, 0.025) to (0.225, 0.075): cells of row -1 then -2, the end point's not among the missed."""
    maps = TileMaps(1, config(log_odds_hit=1.0, log_odds_miss=0.25))
    maps.write(np.array([[0.025, 0.025, 0.0]]), np.array([[0.2, 0.05]]), np.zeros(2))
    assert cells_of(maps, 0, maps.log_odds) == {
        (-1, 0): -0.25, (-1, 1): -0.25, (-1, 2): -0.25, (-2, 3): -0.25, (-2, 4): 1.0,
    }  # fmt: skip
    log_odds, origin = maps.log_odds_of(0)
    assert log_odds[origin[0] - 2, origin[1] + 4] == 1.0 and log_odds.sum() == 0.0


def test_every_beam_counts_and_the_bounds_hold() -> None:
    """Three beams into one cell give three hits; the lidar's own cell loses a miss for each, down to the bound."""
    maps = TileMaps(1, config(log_odds_hit=0.9, log_odds_miss=0.1, log_odds_bound=1.0, free_beams=10))
    points = np.tile([[0.15, 0.0]], (3, 1))
    maps.write(np.array([[0.025, 0.025, 0.0]]), points[:1], np.zeros(2))
    assert cells_of(maps, 0, maps.log_odds)[-1, 3] == pytest.approx(0.9)
    maps.write(np.array([[0.025, 0.025, 0.0]]), points, np.zeros(2))
    assert cells_of(maps, 0, maps.log_odds)[-1, 0] == pytest.approx(-0.4)
    assert cells_of(maps, 0, maps.log_odds)[-1, 3] == 1.0
    for _ in range(5):
        maps.write(np.array([[0.025, 0.025, 0.0]]), points, np.zeros(2))
    assert cells_of(maps, 0, maps.log_odds)[-1, 0] == -1.0


@pytest.mark.parametrize(("beams", "cleared"), [(10, 10), (11, 6), (35, 9)])
def test_only_some_beams_clear_but_all_mark(beams: int, cleared: int) -> None:
    """At most 10 of the beams: every one of 10, every second of 11, every fourth of 35."""
    maps = TileMaps(1, config(free_beams=10, log_odds_hit=1.0, log_odds_miss=0.0625))
    x = 0.15 + 0.05 * np.arange(beams)
    maps.write(np.array([[0.025, 0.025, 0.0]]), np.column_stack([x, 0 * x]), np.zeros(2))
    cells = cells_of(maps, 0, maps.log_odds)
    assert cells[-1, 0] == -0.0625 * cleared
    assert sum(value > 0 for value in cells.values()) == beams


@pytest.mark.parametrize(("threshold", "reach"), [(0.0, 3), (0.9, 2)])
def test_random_scans_equal_the_plain_twin(threshold: float, reach: int) -> None:
    """Log-odds exactly, and the field as walls appear and vanish over tile borders; one hit may be no wall yet."""
    rng = np.random.default_rng(0)
    settings = config(log_odds_miss=0.7, log_odds_bound=2.0, free_beams=10, threshold=threshold, reach=reach)
    maps, twin = TileMaps(1, settings), PlainMap(settings)
    for k in range(60):
        points, pose = random_scan(rng), random_poses(rng, 1)
        maps.write(pose, points, SENSOR)
        twin.write(pose[0], points, SENSOR)
        if k % 6 == 0:
            assert_equal_to(maps, [twin])
            assert_consistent(maps)
    assert_equal_to(maps, [twin])
    assert twin.appeared > (100 if threshold else 800) and twin.vanished > (
        30 if threshold else 250
    )  # there was something to keep up with
    values = list(twin.log_odds.values())
    _, hits = maps.project(0, np.zeros(3), np.array([[(c + 0.5) * CELL, -(r + 0.5) * CELL] for r, c in twin.log_odds]))
    assert hits.tolist() == [cell in twin.occupied() for cell in twin.log_odds]
    assert min(values) == -2.0 and max(values) == 2.0


def test_a_wall_that_vanishes_in_one_scan_leaves_no_field() -> None:
    """Neighbouring cells that vanish together are not stamped back for each other's sake."""
    settings = config(log_odds_hit=0.5, log_odds_miss=1.0)
    maps = TileMaps(1, settings)
    pose = np.array([[0.025, 0.025, 0.0]])
    wall = np.column_stack([np.full(9, 0.5), np.linspace(-0.2, 0.2, 9)])
    maps.write(pose, wall, np.zeros(2))
    assert len(cells_of(maps, 0, maps.field)) > 9
    maps.write(pose, 3 * wall[::-1], np.zeros(2))  # nine beams through the nine cells
    far = PlainMap(settings)
    far.write(pose[0], 3 * wall, np.zeros(2))
    assert cells_of(maps, 0, maps.field) == pytest.approx(far.field())


def test_siblings_part_when_they_write() -> None:
    """Five maps that resample and draw at random stay equal to five dictionaries that are copied."""
    rng = np.random.default_rng(1)
    settings = config(log_odds_miss=0.35)
    maps, twins = TileMaps(5, settings), [PlainMap(settings) for _ in range(5)]
    for _ in range(25):
        points = random_scan(rng, beams=14)
        poses = random_poses(rng, 5)
        maps.write(poses, points, SENSOR)
        for twin, pose in zip(twins, poses, strict=True):
            twin.write(pose, points, SENSOR)
        assert_consistent(maps)
        if rng.random() < 0.6:
            parents = rng.integers(0, 5, 5)
            maps.resample(parents)
            twins = [twins[parent].copy() for parent in parents]
            assert_consistent(maps)
    assert_equal_to(maps, twins)


def test_descendants_share_tiles_until_they_write() -> None:
    """Tiles are of 1.6 m: a scan from (4, 4) to 4.5 needs one, the other 8 of the 3 x 3 drawn before stay shared."""
    maps = TileMaps(3, config())
    centers = 0.8 + 1.6 * np.array([[i, j, 0] for i in range(3) for j in range(3)], np.float64)
    for center in centers:
        center[2] = 0.0
        maps.write(np.tile(center, (3, 1)), np.array([[0.5, 0.0]]), np.zeros(2))
    assert len(np.unique(maps.table)) - 1 == 27
    maps.resample(np.array([1, 1, 1]))
    assert len(np.unique(maps.table)) - 1 == 9
    maps.write(np.tile([4.0, 4.0, 0.0], (3, 1)), np.array([[0.0, 0.5]]), np.zeros(2))
    assert len(np.unique(maps.table)) - 1 == 8 + 3
    assert len(maps.log_odds) == tile_maps.FIRST_TILES


def test_an_only_owner_writes_in_place() -> None:
    maps = TileMaps(1, config())
    pose, points = np.array([[0.8, 0.8, 0.0]]), np.array([[0.5, 0.0]])
    maps.write(pose, points, np.zeros(2))
    before = maps.table.copy()
    maps.write(pose, points, np.zeros(2))
    np.testing.assert_array_equal(maps.table, before)


def test_what_nobody_maps_any_more_is_used_again() -> None:
    """Each round needs 2 tiles of which 1 survives; 256 tiles last for 600 rounds."""
    maps = TileMaps(2, config())
    for k in range(600):
        maps.write(np.array([[0.8, 0.8, 0.0], [0.8, 0.8, 1.0]]), np.array([[0.5, 0.0]]), np.zeros(2))
        maps.resample(np.array([k % 2, k % 2]))
        assert len(np.unique(maps.table)) == 2
    assert len(maps.log_odds) == tile_maps.FIRST_TILES


def test_more_tiles_are_made_in_the_midst_of_a_scan() -> None:
    """Four maps of a star of 11 m: more than 256 tiles, and each map the same as when it is alone."""
    rng = np.random.default_rng(2)
    bearing = np.linspace(-np.pi, np.pi, 40)
    points = 11.0 * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    poses = random_poses(rng, 4)
    maps = TileMaps(4, config())
    maps.write(poses, points, SENSOR)
    assert len(maps.log_odds) > tile_maps.FIRST_TILES
    assert_consistent(maps)
    for index, pose in enumerate(poses):
        alone = TileMaps(1, config())
        alone.write(pose[None], points, SENSOR)
        assert cells_of(maps, index, maps.log_odds) == cells_of(alone, 0, alone.log_odds)
        assert cells_of(maps, index, maps.field) == cells_of(alone, 0, alone.field)


@pytest.mark.parametrize("direction", [(1, 0), (-1, 0), (0, 1), (0, -1), (1, -1), (-1, 1)])
def test_the_tables_grow_in_every_direction(direction: Cell) -> None:
    settings = config()
    maps, twins = TileMaps(2, settings), [PlainMap(settings) for _ in range(2)]
    for step in (0.0, 1.4, 5.0, 12.0, 12.5, 0.2):
        pose = np.array([step * direction[0], step * direction[1], 0.5])
        points = np.array([[0.6, 0.1], [0.3, -0.4], [-0.2, 0.5]])
        poses = np.stack([pose, pose + np.array([0.02, 0.03, 0.4])])
        maps.write(poses, points, SENSOR)
        for twin, at in zip(twins, poses, strict=True):
            twin.write(at, points, SENSOR)
    assert_equal_to(maps, twins)
    assert_consistent(maps)
    _, origin = maps.log_odds_of(0)
    assert origin == tuple(maps.origin)


def test_the_lidar_may_be_farther_out_than_any_end_point() -> None:
    """The robot stands by the table's right border with the lidar 0.6 m ahead, beyond it, looking back."""
    settings = config()
    maps, twin = TileMaps(1, settings), PlainMap(settings)
    pose, points, sensor = np.array([1.3, 0.0, 0.0]), np.array([[0.02, 0.0]]), np.array([0.6, 0.0])
    maps.write(pose[None], points, sensor)
    twin.write(pose, points, sensor)
    assert maps.table.shape[2] > 2
    assert_equal_to(maps, [twin])


def test_no_end_points_change_nothing() -> None:
    maps = TileMaps(2, config())
    maps.write(np.array([[50.0, 0, 0], [0, 0, 0]]), np.zeros((0, 2)), np.zeros(2))
    assert maps.table.shape == (2, 2, 2) and not maps.table.any()


def test_log_odds_of_is_a_copy() -> None:
    maps = TileMaps(1, config())
    maps.write(np.zeros((1, 3)), np.array([[0.5, 0.0]]), np.zeros(2))
    log_odds, _ = maps.log_odds_of(0)
    log_odds[:] = 7.0
    assert maps.log_odds.max() < 1.0


def test_points_and_hits_of_one_map() -> None:
    """The wall at (0.525, 0.025) of map 1 alone: inside, beside, in the other map, far away."""
    here = np.zeros(3)
    maps = TileMaps(2, config())
    maps.write(np.array([[5.025, 5.025, 0.0], [0.025, 0.025, 0.0]]), np.array([[0.5, 0.0]]), np.zeros(2))
    points = np.array([[0.501, 0.049], [0.549, 0.001], [0.499, 0.02], [0.52, -0.001], [0.3, 0.02], [5.525, 5.025]])
    far = np.array([[-100.0, 0.025], [100.0, 0.025], [0.525, 100.0], [0.525, -100.0]])
    height, width = (SIZE * CELL * n for n in maps.table.shape[1:])
    wrapped = np.array([0.525, 0.025]) + np.array([[-width, 0.0], [width, 0.0], [0.0, height], [0.0, -height]])
    assert maps.project(1, here, points)[1].tolist() == [True, True, False, False, False, False]
    assert maps.project(0, here, points)[1].tolist() == [False] * 5 + [True]
    assert not maps.project(1, here, np.vstack([far, wrapped]))[1].any()
    log_odds, origin = maps.log_odds_of(1)
    pose = np.array([0.4, 0.1, 2.0])
    some = np.random.default_rng(5).uniform(-0.5, 0.5, (500, 2))
    world, hits = maps.project(1, pose, some)
    np.testing.assert_allclose(world, geometry.transform(pose, some), atol=1e-12)
    cells = np.array([cell_of(point) for point in geometry.transform(pose, some)]) + origin
    assert 0 < hits.sum() < len(some)
    np.testing.assert_array_equal(hits, log_odds[cells[:, 0], cells[:, 1]] > 0)
    assert maps.project(1, pose, np.zeros((0, 2)))[0].shape == (0, 2)


def test_the_joined_tiles() -> None:
    """Every place of a table of three by two tiles shows its tile, the empty one zeros."""
    tiles = np.random.default_rng(6).normal(size=(6, SIZE, SIZE)).astype(np.float32)
    tiles[0] = 0.0
    table = np.array([[3, 0], [5, 1], [0, 2]], np.int32)
    expected = np.vstack([np.hstack([tiles[tile] for tile in row]) for row in table])
    maps = TileMaps(1, config())
    maps._table, maps._log_odds, maps._origin = table[None], tiles, np.array([SIZE, 2 * SIZE])
    joined, origin = maps.log_odds_of(0)
    np.testing.assert_array_equal(joined, expected)
    assert origin == (SIZE, 2 * SIZE)


def test_settings_come_from_the_map_and_the_filter() -> None:
    numbers: dict[str, Any] = {
        "cell": 0.1,
        "log_odds_hit": 0.5,
        "log_odds_miss": 0.2,
        "log_odds_bound": 3.0,
        "threshold": 0.3,
    }
    filter_numbers: dict[str, Any] = {"sigma": 0.07, "floor": 0.2, "free_beams": 99}
    settings = TileSettings.of(
        RbpfConfig(map=MapConfig(**numbers), rao_blackwellized=RaoBlackwellizedConfig(**filter_numbers, field_reach=2))
    )
    assert settings == TileSettings(**numbers, **filter_numbers, reach=2)


def plain_agreement(field: NDArray[np.float32], origin: NDArray[np.int64], pose: Array, points: Array) -> float:
    """Bilinear between the centres of the cells; nothing outside the outermost centres."""
    total = 0.0
    for x, y in geometry.transform(pose, points):
        column, row = x / CELL + origin[1] - 0.5, origin[0] - y / CELL - 0.5
        i, j = math.floor(row), math.floor(column)
        if not (0 <= i < field.shape[0] - 1 and 0 <= j < field.shape[1] - 1):
            continue
        down, right = row - i, column - j
        total += (1 - down) * ((1 - right) * field[i, j] + right * field[i, j + 1])
        total += down * ((1 - right) * field[i + 1, j] + right * field[i + 1, j + 1])
    return total


def test_a_scan_written_beside_is_there_for_whoever_looks() -> None:
    """Before the other thread has come to it, by every way of looking; and nothing overtakes it."""
    rng = np.random.default_rng(5)
    settings = config()
    poses, more, points, other = random_poses(rng, 2), random_poses(rng, 2), random_scan(rng), random_scan(rng)
    whole = TileMaps(2, settings)
    whole.write(poses, points, SENSOR)
    ends = geometry.transform(poses[1], points)
    for threads in (1, 2):
        looks: tuple[Callable[[TileMaps], Any], ...] = (
            lambda maps: maps.table.tolist(),
            lambda maps: maps.log_odds.tolist(),
            lambda maps: maps.field.tolist(),
            lambda maps: maps.origin.tolist(),
            lambda maps: maps.box(),
            lambda maps: maps.log_odds_of(1)[0].tolist(),
            lambda maps: maps.tiled(1).pool.tolist(),
            lambda maps: maps.project(1, np.zeros(3), ends)[1].tolist(),
        )
        for look in looks:
            worker = Worker(threads)
            held = Event()
            worker.submit(held.wait)  # the other thread is late
            maps = TileMaps(2, settings)
            maps.write_beside(worker, poses, points, SENSOR)
            assert look(maps) == look(whole)
            held.set()
            worker.close()
    worker = Worker(2)
    apart, together = TileMaps(2, settings), TileMaps(2, settings)
    for maps, write in ((apart, partial(apart.write_beside, worker)), (together, together.write)):
        write(poses, points, SENSOR)
        maps.resample(np.array([1, 1]))
        write(more, other, SENSOR)
        maps.write(more[::-1].copy(), points, SENSOR)
    worker.close()
    np.testing.assert_array_equal(apart.table, together.table)
    np.testing.assert_array_equal(apart.log_odds, together.log_odds)
    np.testing.assert_array_equal(apart.field, together.field)
    assert_consistent(apart)


def test_nobody_waits_for_the_map_that_is_written_before_the_others() -> None:
    """Nor for its descendant; the others are there for whoever asks, though the other thread never gets to them."""
    rng = np.random.default_rng(6)
    poses, points = random_poses(rng, 3), random_scan(rng)
    whole, maps = TileMaps(3, config()), TileMaps(3, config())
    whole.write(poses, points, SENSOR)
    worker, held = Worker(2), Event()
    worker.submit(held.wait)
    maps.write_beside(worker, poses, points, SENSOR, before=1)
    ends = geometry.transform(poses[1], points)
    for at in (1, 2):
        np.testing.assert_array_equal(maps.project(at, np.zeros(3), ends)[1], whole.project(1, np.zeros(3), ends)[1])
        np.testing.assert_array_equal(maps.log_odds_of(at)[0], whole.log_odds_of(1)[0])
        assert maps._writing is not None
        if at == 1:
            maps.resample(np.array([0, 0, 1]))
    whole.resample(np.array([0, 0, 1]))
    for index in (0, 1, 2):
        np.testing.assert_array_equal(maps.log_odds_of(index)[0], whole.log_odds_of(index)[0])
    assert maps._writing is None and whole.log_odds_of(0)[0].any()
    assert_consistent(maps)
    held.set()
    worker.close()


def test_agreement_equals_its_twin() -> None:
    """On 3 x 4 tiles of random numbers, some of them the empty tile: within, over borders and corners, outside."""
    rng = np.random.default_rng(3)
    maps = TileMaps(1, config())
    maps._table = np.array([[[1, 0, 2, 3], [0, 4, 5, 0], [6, 7, 0, 8]]], np.int32)
    maps.field[1:9] = rng.uniform(0, 2, (8, SIZE, SIZE))
    field = dense(maps, 0, maps.field)
    for k in range(40):
        points, pose = rng.uniform(-3.5, 4.5, (30, 2)), random_poses(rng, 1, 1.0)[0]
        if k == 0:
            pose = np.zeros(3)
        got = agreement(maps.table[0], maps.field, maps.origin, CELL, points, *pose)
        assert got == pytest.approx(plain_agreement(field, maps.origin, pose, points), abs=1e-5)


def test_agreement_on_every_side_of_a_tiles_corner() -> None:
    """Single points round the corner of four tiles and round the table's own corners."""
    rng = np.random.default_rng(4)
    maps = TileMaps(1, config())
    maps._table = np.array([[[1, 2], [3, 4]]], np.int32)
    maps.field[1:5] = rng.uniform(0, 2, (4, SIZE, SIZE))
    field = dense(maps, 0, maps.field)
    some = 0
    for x in (-1.6, 0.0, 1.6):
        for y in (-1.6, 0.0, 1.6):
            for dx, dy in rng.uniform(-0.06, 0.06, (12, 2)):
                point = np.array([[x + dx, y + dy]])
                got = agreement(maps.table[0], maps.field, maps.origin, CELL, point, 0.0, 0.0, 0.0)
                assert got == pytest.approx(plain_agreement(field, maps.origin, np.zeros(3), point), abs=1e-5)
                some += got > 0
    assert some > 30


def test_agreement_is_greatest_where_the_scan_was_drawn() -> None:
    """End points on the centres of cells find log(1 / floor) each, and less from anywhere else."""
    maps = TileMaps(1, config(floor=0.1))
    points = np.array([[0.525, 0.025], [0.525, 0.375], [-0.375, 0.825]])
    maps.write(np.zeros((1, 3)), points, np.zeros(2))
    args = maps.table[0], maps.field, maps.origin, CELL
    assert agreement(*args, points, 0.0, 0.0, 0.0) == pytest.approx(3 * math.log(10), rel=1e-6)
    assert agreement(*args, points, 0.02, 0.0, 0.0) < 0.95 * 3 * math.log(10)
    assert agreement(*args, points, 0.0, 0.0, 0.1) < 0.95 * 3 * math.log(10)
    assert agreement(*args, np.zeros((0, 2)), 0.0, 0.0, 0.0) == 0.0
