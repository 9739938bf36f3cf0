"""One map that becomes the map of every particle, which then go their own ways."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings

Array = NDArray[np.float64]

LIDAR = np.zeros(2)


def cells(maps: TileMaps, index: int) -> dict[tuple[int, int], float]:
    """Log-odds other than 0, by the cell counted from the world's origin."""
    log_odds, origin = maps.log_odds_of(index)
    return {(int(r) - origin[0], int(c) - origin[1]): float(log_odds[r, c]) for r, c in np.argwhere(log_odds)}


def one_map() -> TileMaps:
    """Seen from the origin's cell, a wall point 3 cells on and one 5 m to the left, several tiles away."""
    maps = TileMaps(1, TileSettings(log_odds_hit=1.0, log_odds_miss=0.25))
    maps.write(np.array([[0.025, 0.025, 0.0]]), np.array([[0.15, 0.0]]), LIDAR)
    maps.write(np.array([[0.025, 5.025, 0.0]]), np.array([[0.15, 0.0]]), LIDAR)
    return maps


EXPECTED = {(-1, 0): -0.25, (-1, 1): -0.25, (-1, 2): -0.25, (-1, 3): 1.0} | {
    (-101, 0): -0.25, (-101, 1): -0.25, (-101, 2): -0.25, (-101, 3): 1.0,
}  # fmt: skip


@pytest.mark.parametrize("count", [1, 2, 7])
def test_all_are_like_the_first_and_take_no_more_room(count: int) -> None:
    maps = one_map()
    tiles = set(np.unique(maps.table).tolist())
    maps.spread(count)
    assert len(maps.table) == count and set(np.unique(maps.table).tolist()) == tiles
    assert all(cells(maps, index) == EXPECTED for index in range(count))


def test_they_part_where_they_write_and_nowhere_else() -> None:
    """Each draws the same scan from a row of its own: nobody's cells are in another's map."""
    maps = one_map()
    maps.spread(3)
    rows = np.array([[0.025, -0.125 - 0.1 * k, 0.0] for k in range(3)])  # row 2, 4, 6
    maps.write(rows, np.array([[0.1, 0.0]]), LIDAR)
    for k in range(3):
        row = 2 + 2 * k
        assert cells(maps, k) == EXPECTED | {(row, 0): -0.25, (row, 1): -0.25, (row, 2): 1.0}


def test_a_map_of_several_is_forgotten_but_the_first() -> None:
    """What the second alone had drawn is room again, and the first is written to in its place when it is alone."""
    maps = TileMaps(2, TileSettings(log_odds_hit=1.0, log_odds_miss=0.25))
    maps.write(np.array([[0.025, 0.025, 0.0], [3.025, 3.025, 0.0]]), np.array([[0.15, 0.0]]), LIDAR)
    first, second = cells(maps, 0), cells(maps, 1)
    assert first != second
    maps.spread(4)
    assert all(cells(maps, k) == first for k in range(4))
    maps.spread(1)
    before = maps.table.copy()
    maps.write(np.array([[0.025, 0.025, 0.0]]), np.array([[0.15, 0.0]]), LIDAR)
    np.testing.assert_array_equal(maps.table, before)
    assert cells(maps, 0) == {cell: 2 * value for cell, value in first.items()}
