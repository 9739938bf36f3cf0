from pathlib import Path

import numpy as np
import pytest

from pfslam_viz.config import configs_dir, load_robot
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.robot_beside import robot_of


def test_a_set_alone_is_of_the_courses_robot(tmp_path: Path) -> None:
    assert robot_of(tmp_path, "21") == load_robot("ece276a")
    np.savez(tmp_path / "ground_truth.npz", time_stamps=np.arange(3.0), pose=np.zeros((3, 3)))
    assert robot_of(tmp_path, "21") == load_robot("ece276a")
    (tmp_path / "ground_truth21.npz").write_bytes(b"no archive")
    assert robot_of(tmp_path, "21") == load_robot("ece276a")


def test_a_simulated_set_without_a_robot_file_has_the_papers_camera(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "ground_truth.npz", time_stamps=np.arange(3.0), walls=np.zeros((2, 4)))
    assert robot_of(tmp_path, "1") == load_robot("ece276a-paper")


def test_the_file_beside_a_set_counts(tmp_path: Path) -> None:
    np.savez(tmp_path / "ground_truth.npz", walls=np.zeros((2, 4)))
    text = (configs_dir() / "robots" / "ece276a.toml").read_text().replace("pitch = 0.36", "pitch = 0.5")
    (tmp_path / "robot.toml").write_text(text)
    camera = robot_of(tmp_path, "1").camera
    assert camera is not None and camera.pitch == 0.5
    (tmp_path / "robot.toml").write_text("wheels = 4\n")
    with pytest.raises(InputError, match=r"robot\.toml: .*'wheels'"):
        robot_of(tmp_path, "1")


def test_twin21_is_read_with_the_camera_that_it_was_rendered_with(shared_data: Path) -> None:
    assert robot_of(shared_data / "twin21", "21") == load_robot("ece276a-paper")
