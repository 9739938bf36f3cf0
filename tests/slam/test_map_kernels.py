"""The kernels that write scans, against a plain NumPy twin that draws every line on random input."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam import map_kernels
from tests.kernels import from_python

Array = NDArray[np.float64]
Cell = tuple[int, int]
Layers = tuple[NDArray[np.float32], NDArray[np.uint8], NDArray[np.uint8]]

end_cells, bundles = from_python(map_kernels.end_cells), from_python(map_kernels.bundles)
write_scan = from_python(map_kernels.write_scan)

ORIGIN = (23, 17)
CELL = 0.1
SHAPE = (40, 50)


def cells_of(world: Array) -> NDArray[np.int64]:
    """(24) and (25) as printed."""
    return np.floor(np.stack([-world[:, 1], world[:, 0]], axis=1) / CELL).astype(np.int64) + ORIGIN


def bresenham_twin(start: Cell, end: Cell) -> list[Cell]:
    """The cells of a line without its last: one a step along the longer side, ties towards the start's side."""
    (r0, c0), (r1, c1) = start, end
    rows, columns = abs(r1 - r0), abs(c1 - c0)
    down, right = (1 if r1 >= r0 else -1), (1 if c1 >= c0 else -1)
    cells, error, row, column = [], columns - rows, r0, c0
    while (row, column) != (r1, c1):
        cells.append((row, column))
        doubled = 2 * error
        if doubled > -rows:
            error, column = error - rows, column + right
        if doubled < columns:
            error, row = error + columns, row + down
    return cells


def write_twin(log_odds: Array, start: Cell, ends: list[Cell], hit: float, miss: float, bound: float) -> Array:
    """(28) with sets: hit every cell that has an end point, miss every other cell that a beam crosses."""
    hits = set(ends)
    free = {cell for end in ends for cell in bresenham_twin(start, end)} - hits
    out = log_odds.copy()
    for cell in hits:
        out[cell] += hit
    for cell in free:
        out[cell] -= miss
    return np.clip(out, -bound, bound)


@pytest.mark.parametrize("kind", ["inside", "outside", "axes", "one", "empty"])
def test_end_cells(kind: str) -> None:
    rng = np.random.default_rng(8)
    points = {
        "inside": rng.uniform(-1.5, 1.5, (271, 2)),
        "outside": rng.uniform(-30.0, 30.0, (271, 2)),
        "axes": np.array(
            [[1.03, 0.0], [0.0, 1.03], [-1.03, 0.0], [0.0, -1.03], [0.0, 0.0], [0.52, 0.52], [-0.52, 0.52]]
        ),
        "one": rng.uniform(-1.5, 1.5, (1, 2)),
        "empty": np.zeros((0, 2)),
    }[kind]
    pose, sensor = np.array([0.213, -0.117, 0.4]), np.array([0.3, 0.02])
    cells, extent, world = end_cells(pose, points, sensor, CELL)
    np.testing.assert_allclose(world, geometry.transform(pose, points), atol=1e-12)
    twin = cells_of(geometry.transform(pose, np.vstack([sensor, points]))) - ORIGIN
    np.testing.assert_array_equal(cells, twin)
    assert extent.tolist() == [*twin.min(axis=0), *twin.max(axis=0)]


@pytest.mark.parametrize("kind", ["random", "axes", "empty", "saturated"])
def test_write_scan(kind: str) -> None:
    rng = np.random.default_rng(5)
    start = (23, 17)
    if kind == "axes":
        ends = [(23, 40), (23, 2), (3, 17), (38, 17), (33, 27), (13, 7), (13, 27), (33, 7), (23, 17)]
    elif kind == "empty":
        ends = []
    else:
        ends = [(int(r), int(c)) for r, c in zip(rng.integers(1, 39, 200), rng.integers(1, 49, 200), strict=True)]
        ends += ends[:20]
        ends += ends[-1:]
    bound = 2.5 if kind == "saturated" else 100.0
    log_odds = rng.uniform(-2, 2, SHAPE).astype(np.float32)
    before = log_odds.copy()
    occupied, touched = (log_odds > 0.5).astype(np.uint8), np.zeros(SHAPE, np.uint8)
    cells = np.array([start, *ends], np.int64) - ORIGIN
    numbers = [np.float32(v) for v in (1.4, 0.9, bound, 0.5)]
    write_scan(log_odds, occupied, touched, 7, cells, *ORIGIN, *numbers)
    twin = write_twin(before.astype(np.float64), start, ends, 1.4, 0.9, bound)
    np.testing.assert_allclose(log_odds, twin, atol=1e-6)
    np.testing.assert_array_equal(occupied, log_odds > np.float32(0.5))
    assert (log_odds != before).any() == (kind != "empty")


def ends_of(kind: str, rng: np.random.Generator) -> NDArray[np.int64]:
    """Cells (m, 2) from the lidar's in which the beams of one turn end."""
    angles = np.linspace(-3.14, 3.14, 721)
    if kind == "room":  # the walls of 12 x 7 m, and 1 cm of noise
        ranges = np.minimum(6.0 / np.abs(np.cos(angles)), 3.5 / np.abs(np.sin(angles))) + rng.normal(0, 0.01, 721)
    elif kind == "posts":  # every third beam ends early
        ranges = np.where(np.arange(721) % 3 == 0, rng.uniform(0.0, 1.0, 721), 8.0)
    elif kind == "jagged":
        ranges = rng.uniform(0.0, 9.0, 721)
    elif kind == "spiral":
        ranges = np.linspace(0.1, 9.0, 721)
    elif kind == "shuffled":  # beams next to each other in the scan point anywhere
        ranges, angles = rng.uniform(0.0, 9.0, 721), rng.permutation(angles)
    else:  # "few": lines more than a cell apart from the start
        ranges, angles = np.full(9, 9.0), angles[::90]
    return np.floor(np.stack([-ranges * np.sin(angles), ranges * np.cos(angles)], axis=1) / CELL).astype(np.int64)


@pytest.mark.parametrize("kind", ["room", "posts", "jagged", "spiral", "shuffled", "few"])
def test_write_scan_crosses_the_cells_of_every_line(kind: str) -> None:
    """Also where lines lie side by side and are not drawn one by one; a cell changes once in each scan."""
    rng = np.random.default_rng(17)
    shape, origin = (200, 210), (100, 103)
    log_odds, occupied, touched = np.zeros(shape, np.float32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    twin = np.zeros(shape)
    for mark in (1, 2, 3):
        start = tuple(rng.integers(-5, 6, 2).tolist())
        cells = np.vstack([start, start + ends_of(kind, rng)]).astype(np.int64)
        write_scan(log_odds, occupied, touched, mark, cells, *origin, *(np.float32(v) for v in (1.5, 0.5, 100.0, 0.0)))
        (r, c), *ends = [tuple(cell) for cell in (cells + origin).tolist()]
        twin = write_twin(twin, (r, c), ends, 1.5, 0.5, 100.0)
    np.testing.assert_array_equal(log_odds, twin)
    np.testing.assert_array_equal(occupied, twin > 0)


def test_bundles_of_a_wall() -> None:
    """A wall of seven cells, two ahead: three lines straight on, and two to each side, one longer than the other."""
    cells = np.array([[0, 0], *([-2, column] for column in range(-3, 4))])
    steps, slopes = bundles(cells)
    found = [(*step, *slope) for step, slope in zip(steps.tolist(), slopes.tolist(), strict=True)]
    expected = [(0, 2, -1, 0, -1 / 2, 1 / 2)]
    for side in (-1, 1):
        expected += [(0, 2, 0, side, -1.0, -2 / 3), (2, 3, 0, side, -2 / 3, -2 / 3)]
    assert sorted(found) == sorted(expected)


def test_write_scan_rounds_half_a_cell_towards_the_start() -> None:
    """Lines to every cell of a square about the lidar, alone: half of them pass between two cells."""
    for row in range(-12, 13):
        for column in range(-12, 13):
            log_odds = np.zeros(SHAPE, np.float32)
            layers = log_odds, np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)
            numbers = (np.float32(v) for v in (1.5, 0.5, 100.0, 0.0))
            write_scan(*layers, 1, np.array([[0, 0], [row, column]]), *ORIGIN, *numbers)
            end = (ORIGIN[0] + row, ORIGIN[1] + column)
            np.testing.assert_array_equal(log_odds, write_twin(np.zeros(SHAPE), ORIGIN, [end], 1.5, 0.5, 100.0))


@pytest.mark.parametrize("reach", [1.4, 30.0])
def test_add_scan_writes_all_or_nothing(reach: float) -> None:
    rng = np.random.default_rng(13)
    pose, sensor = np.array([0.213, -0.117, 0.4]), np.array([0.3, 0.02])
    points = reach * rng.uniform(-1, 1, (50, 2)) / math.sqrt(2)
    log_odds, occupied, touched = np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)
    numbers = [np.float32(v) for v in (1.4, 0.9, 100.0, 0.0)]
    inside, extent, world = map_kernels.add_scan(
        pose, points, sensor, log_odds, occupied, touched, 3, *ORIGIN, CELL, *numbers
    )
    start, *ends = [tuple(c) for c in cells_of(geometry.transform(pose, np.vstack([sensor, points]))).tolist()]
    assert inside == (reach < 2)
    np.testing.assert_allclose(world, geometry.transform(pose, points), atol=1e-12)
    assert extent.tolist()[:2] == (np.min([start, *ends], axis=0) - ORIGIN).tolist()
    twin = write_twin(np.zeros(SHAPE), start, ends, 1.4, 0.9, 100.0) if inside else np.zeros(SHAPE)
    np.testing.assert_allclose(log_odds, twin, atol=1e-6)


def test_add_scans_stops_at_the_first_that_does_not_fit() -> None:
    """Five scans, the second empty, the fourth beyond the grid: three are written, as one by one, and that one told."""
    rng = np.random.default_rng(15)
    poses = np.column_stack([rng.uniform(-0.5, 0.5, (5, 2)), rng.uniform(-3, 3, 5)])
    sensors, sizes = rng.uniform(-0.2, 0.2, (5, 2)), [40, 0, 60, 30, 50]
    scans = [rng.uniform(-1, 1, (size, 2)) for size in sizes]
    scans[3] *= 30.0
    first = np.cumsum([0, *sizes])

    def layers() -> Layers:
        return np.zeros(SHAPE, np.float32), np.zeros(SHAPE, np.uint8), np.zeros(SHAPE, np.uint8)

    log_odds, occupied, touched = together = layers()
    one_by_one = layers()
    place: tuple[Any, ...] = (*ORIGIN, CELL, np.float32(1.4), np.float32(0.9), np.float32(100.0), np.float32(0.0))
    done, extent = map_kernels.add_scans(
        poses, np.vstack(scans), first, sensors, 0, log_odds, occupied, touched, 20, *place
    )
    for k in range(4):
        inside, expected, _ = map_kernels.add_scan(poses[k], scans[k], sensors[k], *one_by_one, k + 1, *place)
        assert inside == (k < 3)
    assert done == 3 and extent.tolist() == expected.tolist()
    for a, b in zip(together[:2], one_by_one[:2], strict=True):
        np.testing.assert_array_equal(a, b)
    done, _ = map_kernels.add_scans(poses, np.vstack(scans), first, sensors, 4, log_odds, occupied, touched, 30, *place)
    map_kernels.add_scan(poses[4], scans[4], sensors[4], *one_by_one, 40, *place)
    assert done == 5
    np.testing.assert_array_equal(together[0], one_by_one[0])


def test_bresenham_twin_draws_the_textbook_line() -> None:
    """(0, 0) to (2, 5), as every textbook draws it: the twin itself is right."""
    assert bresenham_twin((0, 0), (2, 5)) == [(0, 0), (0, 1), (1, 2), (1, 3), (2, 4)]
