"""The viewer's kernels against plain NumPy."""

import numpy as np
import pytest

from pfslam_viz.viewer import kernels


def patchy(rows: slice, columns: slice) -> np.ndarray:
    """Values up to 12 (beyond the table) in a part of a map, a third of them 0."""
    rng = np.random.default_rng(8)
    values = np.zeros((9, 13), np.float32)
    part = values[rows, columns]
    part[:] = rng.normal(0.0, 4.0, part.shape) * (rng.random(part.shape) < 0.67)
    part[0, 0], part[-1, -1], part[0, -1] = 12.0, -12.0, 0.01
    return values


@pytest.mark.parametrize("rows", [slice(0, 9), slice(3, 5), slice(8, 9)])
@pytest.mark.parametrize("columns", [slice(0, 13), slice(11, 13), slice(4, 7)])
def test_shade_and_its_box(rows: slice, columns: slice) -> None:
    """The box is where the part lies, and each known cell's entry that of its level, 12 a unit, the middle at 128."""
    log_odds = patchy(rows, columns)
    table = np.random.default_rng(9).integers(0, 101, 256).astype(np.uint8)
    cells, box = kernels.shade(log_odds, table, 12.0, 255)
    assert box.tolist() == [rows.start, rows.stop - 1, columns.start, columns.stop - 1]
    part = log_odds[box[0] : box[1] + 1, box[2] : box[3] + 1]
    assert np.count_nonzero(part) == np.count_nonzero(log_odds)
    levels = np.clip(np.floor(part * 12.0 + 128.5), 0, 255).astype(int)
    np.testing.assert_array_equal(cells, np.where(part == 0, 255, table[levels]))


def bridged(cells: np.ndarray, most: int) -> np.ndarray:
    """Cell by cell: the nearest known ones on either side are free, and close enough."""
    out = cells.copy()
    for i, j in np.argwhere(cells == 255):
        for line, k in ((cells[i], j), (cells[:, j], i)):
            known = np.flatnonzero(line != 255)
            before, after = known[known < k], known[known > k]
            if len(before) and len(after) and after[0] - before[-1] <= most + 1:
                out[i, j] = 7 if max(line[before[-1]], line[after[0]]) < 50 else out[i, j]
    return out


@pytest.mark.parametrize("most", [0, 1, 2, 5])
def test_gaps_between_free_cells_are_bridged(most: int) -> None:
    row = np.array([[255, 0, 255, 255, 0, 255, 100, 0, 255, 100, 255, 0, 255]], np.uint8)
    if most >= 2:
        assert kernels.bridge(row, row, most, 50, 255, 7)[0].tolist()[:6] == [255, 0, 7, 7, 0, 255]
    rng = np.random.default_rng(10)
    for cells in (row, row.T.copy(), rng.choice(np.array([0, 60, 255, 255, 255], np.uint8), (30, 40))):
        np.testing.assert_array_equal(kernels.bridge(cells, cells, most, 50, 255, 7), bridged(cells, most))


@pytest.mark.parametrize("cell", [(0, 0), (5, 0), (0, 7), (8, 12)])
def test_the_box_of_one_cell(cell: tuple[int, int]) -> None:
    values = np.zeros((9, 13), np.float32)
    values[cell] = -0.1
    assert kernels.shade(values, np.zeros(256, np.uint8), 1.0, 0)[1].tolist() == [cell[0], cell[0], cell[1], cell[1]]


def test_the_box_of_nothing_is_one_cell() -> None:
    assert kernels.shade(np.zeros((9, 13), np.float32), np.zeros(256, np.uint8), 1.0, 0)[1].tolist() == [0, 0, 0, 0]


def test_descend() -> None:
    """Particles of the founders 0, 0, 1, 2: the last, which is nobody's parent, takes founder 2 with it."""
    founders = np.array([0, 0, 1, 2])
    own, count = kernels.descend(founders, np.array([2, 0, 1, 1]))
    assert own.tolist() == [1, 0, 0, 0] and count == 2
    assert kernels.descend(founders, np.arange(4))[1] == 3
    for nobody in (4, -1):
        assert kernels.descend(founders, np.array([0, 1, nobody, 2]))[1] == -1
