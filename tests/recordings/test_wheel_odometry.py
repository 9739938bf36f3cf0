from pathlib import Path

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.config import load_robot
from pfslam_viz.recordings.ece276a import read_sensors
from pfslam_viz.recordings.wheel_odometry import WheelOdometry, differential_drive


def test_a_quarter_turn_lands_on_the_circle() -> None:
    # Rolling pi/2 m while turning 90 degrees: a circle of radius 1 m, so the robot ends at (1, 1).
    np.testing.assert_allclose(differential_drive(np.pi / 2, np.pi / 2), [1.0, 1.0, np.pi / 2], atol=1e-12)


def test_straight_ahead_and_on_the_spot() -> None:
    np.testing.assert_allclose(differential_drive([2.0, 0.0], [0.0, 1.0]), [[2.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_ticks_are_counted_since_the_last_reading_and_averaged_over_the_wheels() -> None:
    counts = np.array([[0, 4, 8], [0, 4, 8], [0, 2, 0], [0, 2, 0]])
    odometry = WheelOdometry.from_sensors(np.arange(3.0), counts, 0.5, np.arange(3.0), np.zeros(3))
    np.testing.assert_allclose(odometry.distance, [0.0, 1.5, 3.5])
    np.testing.assert_allclose(odometry.dead_reckoning().poses[:, 0], [0.0, 1.5, 3.5])
    assert odometry.path_length() == pytest.approx(3.5)


def test_yaw_rate_is_integrated_by_the_trapezoid_rule() -> None:
    stamps = np.array([0.0, 1.0, 3.0])
    odometry = WheelOdometry.from_sensors(stamps, np.zeros((4, 3)), 1.0, stamps, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(odometry.heading, [0.0, 0.5, 1.5])


def test_between_and_outside_samples() -> None:
    odometry = WheelOdometry.from_sensors(
        np.array([1.0, 2.0]), np.array([[0, 4]] * 4), 1.0, np.array([1.0, 2.0]), np.array([0.0, 0.0])
    )
    steps = odometry.increments(np.array([0.0, 1.25, 2.0, 9.0]))
    np.testing.assert_allclose(steps[:, 0], [0.0, 1.0, 3.0, 0.0])  # interpolated; at rest before and after
    assert odometry.rolled_between(1.5, 9.0) == pytest.approx(2.0)


def test_backwards_counts_towards_the_path() -> None:
    stamps = np.arange(3.0)
    odometry = WheelOdometry.from_sensors(stamps, np.array([[0, 3, -2]] * 4), 1.0, stamps, np.zeros(3))
    assert odometry.path_length() == pytest.approx(5.0)
    assert odometry.distance[-1] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("number", "path", "gap", "imu_ends"),
    [("20", 96.60, 2.89, 1.42), ("21", 92.47, 3.15, 1.56), ("23", 73.51, 1.46, 1.75)],
)
def test_real_sets_against_the_published_table(
    shared_data: Path, number: str, path: float, gap: float, imu_ends: float
) -> None:
    odometry = read_sensors(shared_data / "ece276a", number, load_robot()).odometry
    trajectory = odometry.dead_reckoning()
    assert odometry.path_length() == pytest.approx(path, abs=0.01)
    assert geometry.path_length(trajectory.poses) == pytest.approx(path, abs=0.05)
    assert np.hypot(*trajectory.poses[-1, :2]) == pytest.approx(gap, abs=0.05)
    assert trajectory.stamps[-1] - odometry.gyro_stamps[-1] == pytest.approx(imu_ends, abs=0.01)
