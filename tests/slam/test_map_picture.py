"""Maps as one array of a stated size: as they are where they fit, cut and coarser where they do not."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pfslam_viz as pf
from pfslam_viz import figures_layers
from pfslam_viz.config import load_config
from pfslam_viz.evaluation.map_quality import map_quality, occupied_area, scan_to_map_score
from pfslam_viz.evaluation.metrics import metrics
from pfslam_viz.export import MOST_PIXELS, OCCUPIED, export, map_image, write_map
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam import tiles
from pfslam_viz.slam.map_picture import map_picture
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.sweep.trace import pack

CONFIG = MapConfig(cell=0.05)
ZERO = np.zeros((), np.float32)


def same(log_odds: NDArray[np.float32]) -> NDArray[np.float32]:
    return log_odds


def room(*, stray: float = 0.0) -> OccupancyGrid:
    """A round room of 4 m radius; with a ``stray`` range of so many m in one of its scans."""
    grid = OccupancyGrid(CONFIG)
    angles = np.radians(np.arange(0.0, 360.0, 0.5))
    for k in range(5):
        points = 4.0 * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        if stray and k == 2:
            points[90] *= stray / 4.0
        grid.add(np.zeros(3), points, np.zeros(2))
    return grid


def test_an_ordinary_map_is_its_known_cells_and_a_border() -> None:
    grid = room()
    picture = map_picture(grid, same, ZERO, most=1_000_000, border=2)
    rows, columns = np.nonzero(grid.log_odds)
    box = np.s_[rows.min() - 2 : rows.max() + 3, columns.min() - 2 : columns.max() + 3]
    np.testing.assert_array_equal(picture.values, grid.log_odds[box])
    assert picture.cell == 0.05 and picture.note is None
    left, top = (columns.min() - 2 - grid.origin[1]) * 0.05, (grid.origin[0] - rows.min() + 2) * 0.05
    assert picture.upper_left == pytest.approx((left, top))
    assert picture.lower_left == pytest.approx((left, top - 0.05 * len(picture.values)))


def test_a_stray_range_costs_none_of_the_map() -> None:
    """20 km at 45 degrees: 280,000 x 280,000 cells. The room is shown as ever, and where it was."""
    grid, plain = room(stray=20_000.0), room()
    picture = map_picture(grid, same, ZERO, most=1_000_000)
    assert picture.values.size <= 1_000_000 and picture.cell == 0.05
    assert picture.note is not None and "282," in picture.note and "where the walls are" in picture.note
    left, top = picture.upper_left
    within = (np.abs(plain.wall_positions()) < 4.2).all(axis=1)
    x, y = plain.wall_positions()[within].T
    seen = picture.values[((top - y) / 0.05).astype(int), ((x - left) / 0.05).astype(int)]
    assert (seen > 0).mean() > 0.99  # all but the wall that the stray beam did not see


def test_cells_that_are_put_together_keep_walls_before_free_space() -> None:
    grid = room()
    picture = map_picture(grid, same, ZERO, most=3_000)
    assert picture.values.size <= 3_000 and picture.cell == pytest.approx(0.2) and picture.note is not None
    assert "all of it, in cells of 0.2 m" in picture.note
    left, top = picture.upper_left
    walls = grid.wall_positions()
    assert (picture.values[((top - walls[:, 1]) / 0.2).astype(int), ((walls[:, 0] - left) / 0.2).astype(int)] > 0).all()
    assert picture.values[int(top / 0.2), int(-left / 0.2)] < 0  # the robot's place
    assert picture.values[0, 0] == 0


def test_walls_everywhere_are_cut_about_the_middle() -> None:
    """Nothing fits that is put together by whole tiles: what is left is still a part of the map."""
    picture = map_picture(room(), same, ZERO, most=4)
    assert 1 <= picture.values.size <= 4


def test_what_is_written_and_scored_stays_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The map's image, a figure's layer and the map's quality, of a room with one range of 20 km."""
    grid, plain = room(stray=20_000.0), room()
    asked: list[int] = []
    dense = tiles.Tiled.dense

    def counted(self: tiles.Tiled, box: tiles.Box) -> Any:
        asked.append((box[2] - box[0] + 1) * (box[3] - box[1] + 1))
        return dense(self, box)

    monkeypatch.setattr(tiles.Tiled, "dense", counted)
    monkeypatch.setattr(OccupancyGrid, "log_odds", property(lambda self: pytest.fail("the whole box was asked for")))
    monkeypatch.setattr(OccupancyGrid, "occupied", property(lambda self: pytest.fail("the whole box was asked for")))
    image, _ = map_image(grid)
    assert image.size <= MOST_PIXELS and (image == OCCUPIED).sum() > 400
    path, _ = write_map(tmp_path / "map.pgm", grid)
    assert path.stat().st_size <= MOST_PIXELS + 20
    assert "map.pgm: the map spans" in capsys.readouterr().err
    assert figures_layers.grid_layer(grid).alpha.size <= figures_layers.MOST_CELLS
    assert occupied_area(grid) == pytest.approx(occupied_area(plain), abs=3 * 0.05**2)
    points = plain.wall_positions()
    score = scan_to_map_score(points, grid)
    assert score is not None and score > 0.99
    assert max(asked, default=0) <= 1200**2


def test_a_recording_with_a_range_of_20_km(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """That its check does not see: run, exported, traced and scored in arrays of a few thousand cells."""
    angles, n = np.radians(np.arange(-90.0, 90.5, 2.0)), 30
    ranges = np.tile(4.0 / np.maximum(np.abs(np.cos(angles)), 0.6), (n, 1))
    ranges[15, 60] = 20_000.0
    made = pf.Recording.from_arrays(0.1 * np.arange(n), ranges, angles, odometry_poses=np.zeros((n, 3)))
    recording = replace(made, checked=True, lidar=replace(made.lidar, range_max=30_000.0))
    result = pf.run(recording, load_config("paper", ["particles=5"]))
    top, left, bottom, right = result.grid.box()
    assert max(bottom - top, right - left) > 100_000  # it is in the map
    export(result, tmp_path, metrics(result))
    assert (tmp_path / "map.pgm").stat().st_size < 2_000_000
    assert "where the walls are, in cells of 0.07 m" in capsys.readouterr().err
    assert pack(result)["image"].size < 2_000_000
    quality = map_quality(recording, result.estimate, result.grid)
    assert quality.scan_to_map_score is not None and quality.scan_to_map_score > 0.8


def test_the_score_is_that_of_one_distance_transform() -> None:
    """Blocks do not change it: the nearest wall within reach is the same, and beyond it counts nothing."""
    import cv2

    grid = room()
    points = np.random.default_rng(0).uniform(-6.0, 6.0, (5000, 2))
    walls = grid.occupied > 0
    distance = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * grid.cell
    rows, columns = grid.cells(points).T
    inside = (rows >= 0) & (columns >= 0) & (rows < walls.shape[0]) & (columns < walls.shape[1])
    d = distance[rows[inside], columns[inside]]
    assert scan_to_map_score(points, grid) == float(np.exp(-0.5 * (d / 0.1) ** 2).sum() / len(points))
