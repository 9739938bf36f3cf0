"""The robot files against RobotConfiguration.pdf's numbers, and the camera's matrix against (36) and (37)."""

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from pfslam_viz.config import load_robot
from pfslam_viz.errors import InputError
from pfslam_viz.robot import CameraGeometry, LidarMount, Robot


def test_the_courses_robot() -> None:
    robot = load_robot()
    assert robot.meters_per_tick == pytest.approx(0.00221657, abs=1e-8)  # pi 0.254 / 360
    assert robot.lidar.position == (0.29833, 0.0, 0.51435)
    assert robot.camera is not None
    assert robot.camera.position == (0.33276, 0.0, 0.38001)
    assert robot.camera.pitch == 0.36  # the later hand-out's; the one real image says 20.70 degrees
    paper = load_robot("ece276a-paper")
    assert paper.camera is not None and math.degrees(paper.camera.pitch) == pytest.approx(18)
    same = paper.camera.model_copy(update={"pitch": 0.36})
    assert paper.model_copy(update={"camera": same}) == robot


def test_the_hand_outs_camera_is_counted_from_the_rear_axle() -> None:
    camera = load_robot("ece276a-handout").camera
    assert camera is not None
    assert camera.position == pytest.approx((0.18 + 0.3302 / 2, 0.005, 0.36))
    assert (camera.pitch, camera.roll, camera.yaw) == (0.36, 0.0, 0.021)


def test_a_level_camera_looks_along_x() -> None:
    matrix = CameraGeometry(position=(1, 2, 3)).robot_from_optical()
    # (37): optical z (ahead) is the robot's x, optical x (right) is -y, optical y (down) is -z.
    np.testing.assert_allclose(matrix @ [0, 0, 1, 1], [2, 2, 3, 1], atol=1e-12)
    np.testing.assert_allclose(matrix @ [1, 0, 0, 1], [1, 1, 3, 1], atol=1e-12)
    np.testing.assert_allclose(matrix @ [0, 1, 0, 1], [1, 2, 2, 1], atol=1e-12)


def test_pitch_looks_down() -> None:
    ahead = CameraGeometry(position=(0, 0, 0), pitch=math.radians(18)).robot_from_optical() @ [0, 0, 1, 0]
    np.testing.assert_allclose(ahead[:3], [math.cos(math.radians(18)), 0, -math.sin(math.radians(18))], atol=1e-12)


def test_yaw_turns_left_and_roll_leans_right() -> None:
    left = CameraGeometry(position=(0, 0, 0), yaw=0.1).robot_from_optical() @ [0, 0, 1, 0]
    np.testing.assert_allclose(left[:3], [math.cos(0.1), math.sin(0.1), 0], atol=1e-12)
    right = CameraGeometry(position=(0, 0, 0), roll=0.1).robot_from_optical() @ [1, 0, 0, 0]
    assert right[2] == pytest.approx(-math.sin(0.1))  # the right side goes down


def test_angles_apply_in_the_order_yaw_pitch_roll() -> None:
    camera = CameraGeometry(position=(0, 0, 0), yaw=math.pi / 2, pitch=math.pi / 2)
    # Pitched straight down first, then turned: it still looks straight down.
    np.testing.assert_allclose((camera.robot_from_optical() @ [0, 0, 1, 0])[:3], [0, 0, -1], atol=1e-12)


def test_ground_camera_adds_the_axles_height() -> None:
    ground = load_robot().ground_camera()
    assert ground is not None
    assert ground.position == pytest.approx((0.33276, 0.0, 0.50701))
    bare = Robot(
        axle_height=0.1, wheel_diameter=0.2, ticks_per_revolution=10, lidar=LidarMount(position=(0.0, 0.0, 0.0))
    )
    assert bare.ground_camera() is None


@pytest.mark.parametrize("change", [{"wheel_diameter": 0}, {"ticks_per_revolution": -1}, {"axle_height": math.nan}])
def test_impossible_robots_are_refused(change: dict[str, float]) -> None:
    values = load_robot().model_dump() | change
    with pytest.raises(ValidationError):
        Robot.model_validate(values)


@pytest.mark.parametrize("roll", [math.pi, -3.1416, 3.1])
def test_a_lidar_may_hang_upside_down(roll: float) -> None:
    assert LidarMount(position=(0.0, 0.0, 0.0), roll=roll, yaw=3.1416).upside_down
    assert not LidarMount(position=(0.0, 0.0, 0.0), roll=0.05, pitch=-0.05).upside_down


@pytest.mark.parametrize(("turn", "expected"), [("roll", "upside down"), ("pitch", "level plane")])
def test_a_lidar_that_leans_is_refused(turn: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text(
        "axle_height = 0.1\nwheel_diameter = 0.2\nticks_per_revolution = 10\n"
        f"[lidar]\nposition = [0.0, 0.0, 0.0]\n{turn} = 0.5\n"
    )
    with pytest.raises(InputError, match=rf"robot\.toml: 'lidar\.{turn}' = 0\.5: .*{expected}"):
        load_robot(path)
