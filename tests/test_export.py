"""Exported files, read back by other programs or by a parser written here."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.config import Config
from pfslam_viz.evaluation.trajectory_error import trajectory_error
from pfslam_viz.export import export, map_image, write_map, write_tum
from pfslam_viz.recordings.recording import Lidar, Recording
from pfslam_viz.replay import Result
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid


def make_result(n: int = 300) -> Result:
    """A winding drive at epoch stamps, 40 a second, with truth, whose estimate has drifted from it."""
    rng = np.random.default_rng(11)
    odometry = rng.normal([0.05, 0, 0.01], [0.01, 0.001, 0.03], (n, 3))
    odometry[0] = 0
    recording = Recording(
        name="winding",
        format="test",
        path=Path("winding"),
        stamps=1330000000.123456 + np.arange(float(n)) * 0.025,
        ranges=np.zeros((n, 1), np.float32),
        lidar=Lidar(np.zeros(1), 0.1, 30, np.zeros(3)),
        odometry=odometry,
    )
    truth = recording.dead_reckoning()
    noisy = geometry.accumulate(odometry + rng.normal(0, 0.002, odometry.shape) * (np.arange(n) > 0)[:, None])
    config = Config()
    grid = OccupancyGrid(config.map)
    grid.add(np.zeros(3), np.array([[1.0, 0.0], [0.0, 2.0]]), np.zeros(2))
    return Result(
        recording=recording,
        config=config,
        stamps=recording.stamps,
        estimate=noisy,
        online=noisy,
        dead_reckoning=truth,
        truth=truth,
        grid=grid,
        dead_reckoning_grid=grid,
        seconds={},
        resamplings=0,
        uninformative=0,
        interrupted=False,
    )


def read_pgm(path: Path) -> np.ndarray:
    """Binary PGM by its definition: magic, width, height, maximum, one white space, then rows from the top."""
    data = path.read_bytes()
    magic, width, height, maximum = data.split(maxsplit=4)[:4]
    assert (magic, maximum) == (b"P5", b"255")
    header = data.index(b"255") + 4
    assert len(data) - header == int(width) * int(height)
    return np.frombuffer(data[header:], np.uint8).reshape(int(height), int(width))


def read_yaml(path: Path) -> dict[str, str]:
    return dict(line.split(": ", 1) for line in path.read_text().splitlines())


def pixel_of(x: float, y: float, image: np.ndarray, yaml: dict[str, str]) -> int:
    """The pixel at a world position as ROS defines it: origin is the lower left corner, rows count from the bottom."""
    left, bottom, yaw = (float(v) for v in yaml["origin"].strip("[]").split(","))
    assert yaw == 0
    resolution = float(yaml["resolution"])
    column, row = int(np.floor((x - left) / resolution)), int(np.floor((y - bottom) / resolution))
    return int(image[image.shape[0] - 1 - row, column])


def test_writes_every_file(tmp_path: Path) -> None:
    files = export(make_result(), tmp_path / "new" / "folder", {"a": 1, "b": None})
    names = ["estimate.tum", "online.tum", "dead_reckoning.tum", "truth.tum", "map.pgm", "map.yaml", "metrics.json"]
    assert [file.name for file in files] == names
    assert sorted(p.name for p in (tmp_path / "new" / "folder").iterdir()) == sorted(names)  # and nothing half-written
    assert json.loads(files[-1].read_text()) == {"a": 1, "b": None}


def test_no_truth_no_file_and_a_second_export_replaces_the_first(tmp_path: Path) -> None:
    export(make_result(), tmp_path, {})
    (tmp_path / "truth.tum").unlink()
    files = export(replace(make_result(20), truth=None), tmp_path, {})
    assert not (tmp_path / "truth.tum").exists()
    assert len(files[0].read_text().splitlines()) == 20


def test_nan_in_metrics_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON"):
        export(make_result(), tmp_path, {"a": float("nan")})
    assert not (tmp_path / "metrics.json").exists()
    assert not [p for p in tmp_path.iterdir() if ".part" in p.name]


def test_tum_keeps_stamps_and_poses(tmp_path: Path) -> None:
    stamps = np.array([1e-05, 0.1, 976052857.338, 1330000000.1234567])
    poses = np.array([[0, 0, 0], [1.25, -2, np.pi / 2], [3, 4, -3.1], [-1e-12, 0, 1]])
    path = write_tum(tmp_path / "a.tum", stamps, poses)
    assert path.read_text().splitlines()[0] == "0.00001 0.000000000 0.000000000 0 0 0 0.000000000000 1.000000000000"
    table = np.loadtxt(path)
    np.testing.assert_array_equal(table[:, 0], stamps)  # to the last bit
    np.testing.assert_allclose(table[:, 1:3], poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(2 * np.arctan2(table[:, 6], table[:, 7]), poses[:, 2], atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(table[:, 4:], axis=1), 1, atol=1e-9)


def test_evo_gives_the_same_rmse(tmp_path: Path) -> None:
    pytest.importorskip("evo", reason="evo is not installed")
    from evo.core import metrics as evo_metrics
    from evo.core import sync
    from evo.tools import file_interface

    result = make_result()
    export(result, tmp_path, {})
    truth, estimate = sync.associate_trajectories(
        file_interface.read_tum_trajectory_file(str(tmp_path / "truth.tum")),
        file_interface.read_tum_trajectory_file(str(tmp_path / "estimate.tum")),
        max_diff=1e-6,
    )
    assert truth.num_poses == len(result.stamps)
    assert result.truth is not None
    ours = trajectory_error(result.truth, result.estimate)
    position = evo_metrics.APE(evo_metrics.PoseRelation.translation_part)
    position.process_data((truth, estimate))
    heading = evo_metrics.APE(evo_metrics.PoseRelation.rotation_angle_deg)
    heading.process_data((truth, estimate))
    assert ours.position_rmse > 0.01
    assert position.get_statistic(evo_metrics.StatisticsType.rmse) == pytest.approx(ours.position_rmse, abs=1e-7)
    assert position.get_statistic(evo_metrics.StatisticsType.max) == pytest.approx(ours.position_max, abs=1e-7)
    assert heading.get_statistic(evo_metrics.StatisticsType.rmse) == pytest.approx(ours.heading_rmse, abs=1e-5)
    assert heading.get_statistic(evo_metrics.StatisticsType.max) == pytest.approx(ours.heading_max, abs=1e-5)


def test_map_has_a_marked_cell_where_it_is_in_the_world(tmp_path: Path) -> None:
    grid = OccupancyGrid(MapConfig(cell=0.1))
    grid.add(np.zeros(3), np.array([[-3.05, 7.05], [1.55, -0.45]]), np.zeros(2))
    write_map(tmp_path / "map.pgm", grid)
    image, yaml = read_pgm(tmp_path / "map.pgm"), read_yaml(tmp_path / "map.yaml")
    assert pixel_of(-3.05, 7.05, image, yaml) == 0
    assert pixel_of(1.55, -0.45, image, yaml) == 0
    assert (image == 0).sum() == 2
    assert pixel_of(0.05, -0.05, image, yaml) == 254  # the ray passed here
    assert pixel_of(-3.05, 6.55, image, yaml) == 205
    # Cut to what is known: two cells of border around 4.7 m x 7.6 m.
    assert image.shape == (76 + 4, 47 + 4)
    assert yaml["image"] == "map.pgm" and yaml["negate"] == "0" and yaml["mode"] == "trinary"
    assert float(yaml["resolution"]) == 0.1


def test_map_server_reads_the_three_values_back(tmp_path: Path) -> None:
    """map_server: p = (255 - pixel) / 255; above occupied_thresh occupied, below free_thresh free, else unknown."""
    write_map(tmp_path / "map.pgm", make_result(3).grid)
    image, yaml = read_pgm(tmp_path / "map.pgm"), read_yaml(tmp_path / "map.yaml")
    p = (255 - image.astype(float)) / 255
    occupied, free = p > float(yaml["occupied_thresh"]), p < float(yaml["free_thresh"])
    assert (image[occupied] == 0).all() and (image[free] == 254).all() and (image[~occupied & ~free] == 205).all()
    assert occupied.any() and free.any() and (~occupied & ~free).any()


def test_a_map_of_nothing_is_all_unknown() -> None:
    grid = OccupancyGrid(MapConfig())
    image, corner = map_image(grid)
    assert image.shape == grid.shape and (image == 205).all()
    assert corner == grid.lower_left
