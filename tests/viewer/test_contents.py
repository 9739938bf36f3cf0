from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.tiles import TiledArrays
from pfslam_viz.viewer import contents


def test_one_observation_is_enough_for_white_or_black() -> None:
    """A map of key scans, each counted little, shows what one of many scans shows that count much."""
    hit, miss = 0.9, 0.1
    log_odds = np.array([[0.0, hit, -miss, 0.0, hit / 2, -miss / 2, 50.0, -50.0, hit - miss, 0.0]], np.float32)
    values, rows, columns = contents.occupancy(log_odds, hit, miss)
    assert (rows, columns) == (slice(0, 1), slice(1, 9)) and values.shape == (1, 8)
    assert values[0, :2].tolist() == [100, 0]
    assert values[0, 2] == contents.UNKNOWN
    assert values[0, 3:5] == pytest.approx([75, 25], abs=5)
    assert values[0, 5:7].tolist() == [100, 0]
    assert values[0, 7] == 95  # one of each: eight ninths of a hit, in steps of a 120th
    once, _, _ = contents.occupancy(np.array([[np.log(4), -np.log(4)]], np.float32), np.log(4), np.log(4))
    assert once.tolist() == [[100, 0]]


def test_a_marked_cell_lies_where_it_is_the_right_way_up() -> None:
    grid = OccupancyGrid(MapConfig(cell=0.5))
    for (x, y), value in {(2.25, 3.25): 9.0, (-1.25, 0.75): -9.0}.items():
        row, column = grid.cells([[x, y]])[0]
        grid.log_odds[row, column] = value
    drawn = contents.grid_map(grid)
    cells, corner = drawn.values, drawn.corner
    assert cells.shape == (6, 8)  # x from -1.5 to 2.5, y from 0.5 to 3.5
    assert corner[:2] == pytest.approx([-1.5, 0.5])
    assert cells[0, 7] == 100  # top right
    assert cells[5, 0] == 0  # bottom left
    assert np.count_nonzero(cells == 255) == 46


def test_narrow_gaps_between_rays_are_nearly_white() -> None:
    """Of 25 cm, five cells here; pale up to 60 cm; what is behind a wall, or beside free floor, stays unknown."""
    grid = OccupancyGrid(MapConfig(cell=0.05))
    miss, hit = -grid.config.log_odds_miss, grid.config.log_odds_hit
    for column, value in ((10, miss), (16, miss), (23, miss), (24, hit), (26, miss), (39, miss), (53, miss)):
        grid.log_odds[5, column] = value
    known = grid.log_odds.copy()
    (row,) = contents.grid_map(grid).values
    assert row.tolist() == [0, *[6] * 5, 0, *[20] * 6, 0, 100, 255, 0, *[20] * 12, 0, *[255] * 13, 0]
    np.testing.assert_array_equal(grid.log_odds, known)  # a drawing: the map keeps them unknown


def test_an_empty_map_is_one_unknown_cell() -> None:
    np.testing.assert_array_equal(contents.grid_map(OccupancyGrid(MapConfig())).values, [[255]])


def test_walls_stand_on_the_occupied_cells() -> None:
    grid = OccupancyGrid(MapConfig(cell=0.5))
    for x in (1.25, 1.75, 2.25, 3.75):
        row, column = grid.cells([[x, -0.75]])[0]
        grid.log_odds[row, column] = 1.0
    boxes = contents.wall_block(grid, grid.tiled(), (-10, -10, 20, 20))
    centers, halves = boxes.centers, boxes.half_sizes
    np.testing.assert_allclose(centers[:, :2], [[1.75, -0.75], [3.75, -0.75]], atol=1e-6)
    np.testing.assert_allclose(halves[:, :2], [[0.75, 0.25], [0.25, 0.25]], atol=1e-6)
    np.testing.assert_allclose(centers[:, 2], halves[:, 2])  # from the floor up


def test_texture_is_transparent_where_nothing_was_seen() -> None:
    arrays = TiledArrays({"weight": (np.float32, ()), "color": (np.uint8, (3,))})
    for row, column, color, weight in ((-1, 0, (10, 20, 30), 1.0), (0, -1, (40, 50, 60), 2.0)):
        i, j = row + arrays.origin[0], column + arrays.origin[1]
        arrays.arrays["color"][i, j], arrays.arrays["weight"][i, j] = color, weight
    color_tiles, weight_tiles = arrays.tiled("color", "weight")
    cells = contents.texture_block(color_tiles, weight_tiles, (-1, -1, 0, 0))
    np.testing.assert_array_equal(cells[0], [[0, 0, 0, 0], [10, 20, 30, 255]])
    np.testing.assert_array_equal(cells[1], [[40, 50, 60, 255], [0, 0, 0, 0]])


def due_steps(budget: contents.FrameBudget, steps: Any, size: Any) -> list[int]:
    out = []
    for step in range(steps):
        if budget.is_due(step):
            out.append(step)
            budget.spend(step, size(step))
    return out


def test_frames_are_spread_over_the_recording() -> None:
    steps = due_steps(contents.FrameBudget(1000, 100, 10**9), 1000, lambda step: 1)
    assert 99 <= len(steps) <= 105
    assert max(np.diff(steps)) <= 12 and steps[0] == 0 and steps[-1] > 980


def test_bytes_are_spread_too_and_what_is_not_spent_stays() -> None:
    """A tenth at once, the rest by and by; who takes nothing for half of the time has that much left."""
    budget, spent = contents.FrameBudget(1000, 200, 10_000), 0
    assert budget.allowance(0) == 1009
    for step in range(1000):
        allowed = budget.allowance(step)
        assert allowed is not None and spent + allowed <= 1000 + 9 * (step + 1)
        size = allowed if step < 500 else 0
        budget.spend(step, size)
        spent += size
    assert budget.allowance(999) == 10_000 - spent == 4_500 - 9 + 9
    assert contents.FrameBudget(10, 2, 1, every=3).allowance(5) is None


def test_a_fixed_stride_is_kept() -> None:
    assert due_steps(contents.FrameBudget(10, 2, 1, every=3), 10, lambda step: 100) == [0, 3, 6, 9]


def pixels(jpeg: contents.Jpeg | None) -> NDArray[np.uint8]:
    assert jpeg is not None
    return np.asarray(cv2.imdecode(jpeg.contents, cv2.IMREAD_COLOR), np.uint8)


def test_camera_images_become_small_jpegs(tmp_path: Path) -> None:
    color, disparity = tmp_path / "c.png", tmp_path / "d.png"
    cv2.imwrite(str(color), np.full((480, 640, 3), (30, 60, 200), np.uint8))
    raw = np.full((480, 640), 2047, np.uint16)  # the Kinect's "no depth"
    raw[:, :200], raw[:, 200:400] = 500, 900  # 0.58 m and 1.79 m: near and far
    cv2.imwrite(str(disparity), raw)
    image = pixels(contents.color_jpeg(color))
    assert image.shape == (240, 320, 3)
    np.testing.assert_allclose(image[120, 160], (30, 60, 200), atol=4)
    image = pixels(contents.disparity_jpeg(disparity))
    near, far, none = (int(image[120, column].sum()) for column in (50, 150, 280))
    assert near > far > none
    assert none < 15
    (tmp_path / "broken.png").write_bytes(b"not an image")
    assert contents.color_jpeg(tmp_path / "broken.png") is None
    assert contents.disparity_jpeg(tmp_path / "absent.png") is None
