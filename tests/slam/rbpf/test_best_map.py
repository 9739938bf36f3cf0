"""One of the tile maps, seen as an occupancy grid."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.rbpf.best_map import BestMap
from pfslam_viz.slam.rbpf.settings import RbpfConfig
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings

CONFIG = MapConfig(cell=0.05, log_odds_hit=0.75, log_odds_miss=0.25, log_odds_bound=3.0)
SETTINGS = TileSettings.of(RbpfConfig(map=CONFIG))
POSES = np.array([[0.025, 0.025, 0.0], [3.025, 0.025, 0.0]])
POINT = np.array([[0.5, 0.0]])


@pytest.fixture
def maps() -> TileMaps:
    """Map 0 with a wall at (0.525, 0.025), map 1 with one at (3.525, 0.025)."""
    maps = TileMaps(2, SETTINGS)
    maps.write(POSES, POINT, np.zeros(2))
    return maps


def occupied_at(grid: OccupancyGrid) -> set[tuple[float, float]]:
    return {(round(float(x), 3), round(float(y), 3)) for x, y in grid.centers(np.argwhere(grid.occupied))}


@pytest.mark.parametrize("index", [0, 1])
def test_it_is_the_followed_map(maps: TileMaps, index: int) -> None:
    """Numbers and place: the wall is occupied at 0.75, the ten cells before it are free at -0.25."""
    grid = BestMap(CONFIG, maps)
    grid.follow(index)
    log_odds, origin = maps.log_odds_of(index)
    np.testing.assert_array_equal(grid.log_odds, log_odds)
    assert grid.origin == origin and grid.shape == log_odds.shape
    assert occupied_at(grid) == {(0.525 + 3 * index, 0.025)}
    assert (grid.log_odds == -0.25).sum() == 10 and grid.log_odds.max() == 0.75
    row, column = grid.cells(np.array([[0.26 + 3 * index, 0.026]]))[0]
    assert grid.log_odds[row, column] == -0.25


def test_before_it_follows_a_map_it_is_unknown() -> None:
    grid = BestMap(CONFIG, TileMaps(1, SETTINGS))
    assert not grid.log_odds.any() and not grid.occupied.any()


def test_it_changes_when_told_and_not_before(maps: TileMaps) -> None:
    grid = BestMap(CONFIG, maps)
    grid.follow(0)
    first = grid.log_odds
    maps.write(POSES, -POINT, np.zeros(2))
    assert grid.log_odds is first and occupied_at(grid) == {(0.525, 0.025)}
    grid.follow(0)
    assert occupied_at(grid) == {(0.525, 0.025), (-0.475, 0.025)}
    assert grid.log_odds is not first


def test_the_copy_is_made_when_somebody_looks(maps: TileMaps, monkeypatch: pytest.MonkeyPatch) -> None:
    """However often it is told to follow, it copies once, at the first look, the map as it is then."""
    grid = BestMap(CONFIG, maps)
    looked: list[int] = []
    copy = TileMaps.log_odds_of

    def counted(maps: TileMaps, index: int) -> tuple[NDArray[np.float32], tuple[int, int]]:
        looked.append(index)
        return copy(maps, index)

    monkeypatch.setattr(TileMaps, "log_odds_of", counted)
    grid.follow(0)
    grid.follow(1)
    assert looked == [] and grid.cell == 0.05
    maps.write(POSES, -POINT, np.zeros(2))
    assert occupied_at(grid) == {(3.525, 0.025), (2.525, 0.025)}
    grid.log_odds, grid.shape, grid.lower_left  # noqa: B018
    assert looked == [1]


@pytest.mark.parametrize("look", ["log_odds", "occupied", "origin", "shape", "lower_left"])
def test_any_look_is_up_to_date(maps: TileMaps, look: str) -> None:
    """Whichever attribute is asked for first belongs to the map as it is now."""
    grid = BestMap(CONFIG, maps)
    grid.follow(1)
    up_to_date = BestMap(CONFIG, maps)
    up_to_date.follow(1)
    up_to_date._refresh()
    np.testing.assert_array_equal(getattr(grid, look), getattr(up_to_date, look))
    fresh = OccupancyGrid(CONFIG)
    assert not np.array_equal(getattr(grid, look), getattr(fresh, look))


def test_points_and_hits_are_looked_up_in_it(maps: TileMaps) -> None:
    """From (0, 0, 90°) the point (0.04, -0.51) lies in the wall's cell; beyond the map nothing is hit."""
    grid = BestMap(CONFIG, maps)
    grid.follow(0)
    points, hits = grid.project(np.array([0.0, 0.0, np.pi / 2]), np.array([[0.04, -0.51], [0.04, 0.51], [900.0, 0.0]]))
    np.testing.assert_allclose(points[0], [0.51, 0.04], atol=1e-12)
    assert hits.tolist() == [True, False, False]


def test_correlation_counts_in_it(maps: TileMaps) -> None:
    """(26) on a map of another size than the grid began with: one of the two end points is on the wall."""
    grid = BestMap(CONFIG, maps)
    grid.follow(1)
    points = np.array([[0.51, 0.01], [0.2, 0.01]])
    np.testing.assert_array_equal(grid.correlation(np.array([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), points), [1, 0])
    assert [marks.shape for marks in grid._marks] == 2 * [grid.shape]  # or the kernel would write beyond its end


def test_it_can_be_shown_other_maps(maps: TileMaps) -> None:
    other = TileMaps(1, SETTINGS)
    other.write(POSES[:1], 2 * POINT, np.zeros(2))
    grid = BestMap(CONFIG, maps)
    grid.follow(1)
    grid.show(other, 0)
    assert occupied_at(grid) == {(1.025, 0.025)}
