import numpy as np
import pytest

from pfslam_viz.config import load_robot
from pfslam_viz.simulation.drive import RATE, Drive
from pfslam_viz.simulation.sensors import (
    SensorErrors,
    beam_angles,
    count_ticks,
    jittered_stamps,
    read_imu,
    scan,
    true_ranges,
)
from pfslam_viz.simulation.world import Plan

SQUARE = np.array([[-2.0, -1.0, 3.0, -1.0], [3.0, -1.0, 3.0, 4.0], [3.0, 4.0, -2.0, 4.0], [-2.0, 4.0, -2.0, -1.0]])
EXACT = SensorErrors(slip=0.0, gyro_bias=0.0, gyro_noise=0.0, gyro_drift=0.0, gyro_scale=0.0)


def steady(seconds: float, speed: float, yaw_rate: float) -> Drive:
    times = np.arange(int(seconds * RATE) + 1) / RATE
    heading = yaw_rate * times
    radius = speed / yaw_rate if yaw_rate else 0.0
    x, y = (radius * np.sin(heading), radius * (1 - np.cos(heading))) if yaw_rate else (speed * times, 0 * times)
    return Drive(times, np.stack([x, y, heading], -1), 0 * times + speed, 0 * times + yaw_rate, 0.0, 0.0)


def ranges_one_by_one(walls: np.ndarray, poses: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Plain twin: every beam against every wall, as a 2 x 2 linear system."""
    out = np.full((len(poses), len(angles)), np.inf)
    for k, (x, y, heading) in enumerate(poses):
        for i, angle in enumerate(angles):
            d = np.array([np.cos(heading + angle), np.sin(heading + angle)])
            for ax, ay, bx, by in walls:
                matrix = np.array([[d[0], ax - bx], [d[1], ay - by]])
                if abs(np.linalg.det(matrix)) > 1e-12:
                    r, t = np.linalg.solve(matrix, [ax - x, ay - y])
                    if r > 0 and 0 <= t <= 1:
                        out[k, i] = min(out[k, i], r)
    return out


def test_true_ranges_by_hand() -> None:
    ranges, grazing = true_ranges(SQUARE, np.zeros((1, 3)), np.array([-np.pi / 2, -np.pi / 4, 0.0, np.pi / 4]))
    assert ranges[0] == pytest.approx([1.0, np.sqrt(2.0), 3.0, np.sqrt(18.0)])
    assert grazing[0] == pytest.approx([1.0, np.sqrt(0.5), 1.0, np.sqrt(0.5)])


def test_true_ranges_match_the_plain_twin() -> None:
    rng = np.random.default_rng(0)
    walls = rng.uniform(-6.0, 6.0, (12, 4))
    poses = np.column_stack([rng.uniform(-6.0, 6.0, (6, 2)), rng.uniform(-9.0, 9.0, 6)])
    for angles in (beam_angles()[::31], np.linspace(-np.pi, np.pi, 49)[:-1]):
        expected = ranges_one_by_one(walls, poses, angles)
        assert true_ranges(walls, poses, angles)[0] == pytest.approx(expected, rel=1e-9)
        assert np.isfinite(expected).mean() > 0.5


def test_scan_is_taken_from_where_the_lidar_sits() -> None:
    plan = Plan()
    plan.room(-2.0, -1.0, 3.0, 4.0)
    plan.box(1.0, 0.0, 0.2, 0.2, height=0.5)  # too low for the lidar
    robot = load_robot()
    errors = SensorErrors(range_noise=0.0, range_growth=0.0, dropouts=0.0)
    ranges = scan(
        plan.build([(0, 0), (1, 0)]), steady(1.0, 0.0, 0.0), np.array([0.5]), robot, np.random.default_rng(0), errors
    )
    assert ranges.dtype == np.float32 and ranges.shape == (1, 1081)
    assert ranges[0, 540] == pytest.approx(3.0 - 0.29833, abs=0.001)
    assert ranges[0, 540 + 360] == pytest.approx(4.0, abs=0.001)
    assert np.array_equal(np.round(ranges * 1000), np.round(ranges.astype(np.float64) * 1000, 3))  # whole mm


def test_scan_noise_and_dropouts() -> None:
    plan = Plan()
    plan.room(-2.0, -1.0, 3.0, 4.0)
    world = plan.build([(0, 0), (1, 0)])
    drive = steady(10.0, 0.0, 0.0)
    errors = SensorErrors(range_noise=0.02, range_growth=0.0, dropouts=0.05)
    ranges = scan(world, drive, np.linspace(0, 10, 400), load_robot(), np.random.default_rng(0), errors)
    assert (ranges == 0).mean() == pytest.approx(0.05, abs=0.002)
    ahead = ranges[:, 540][ranges[:, 540] > 0]
    assert ahead.std() == pytest.approx(0.02, rel=0.15) and ahead.mean() == pytest.approx(2.7017, abs=0.004)


def test_beams_beyond_30_m_do_not_return() -> None:
    plan = Plan()
    plan.room(-2.0, -1.0, 35.0, 1.0)
    args = (steady(1.0, 0.0, 0.0), np.array([0.5]), load_robot(), np.random.default_rng(0), SensorErrors(dropouts=0.0))
    ranges = scan(plan.build([(0, 0), (1, 0)]), *args)
    assert ranges[0, 540] == 0.0 and ranges[0, 180] == pytest.approx(1.0, abs=0.06)


def test_ticks_count_how_far_each_wheel_rolled() -> None:
    robot = load_robot()
    drive = steady(20.0, 0.8, 0.5)
    times = np.arange(0.0, 20.0, 0.025)
    ticks = count_ticks(drive, times, robot, np.random.default_rng(0), EXACT)
    assert ticks.dtype == np.int16 and ticks.shape == (4, len(times)) and (ticks[:, 0] == 0).all()
    rolled = ticks.sum(axis=1) * np.pi * 0.254 / 360
    seconds = times[-1]
    right, left = (0.8 + 0.5 * 0.75 / 2) * seconds, (0.8 - 0.5 * 0.75 / 2) * seconds
    assert rolled == pytest.approx([right, left, right, left], abs=0.01)
    assert rolled.mean() == pytest.approx(0.8 * seconds, abs=0.01)


def test_larger_wheels_count_fewer_ticks() -> None:
    drive, times = steady(20.0, 1.0, 0.0), np.arange(0.0, 20.0, 0.025)
    errors = SensorErrors(wheel_scale=1.03, slip=0.0)
    ticks = count_ticks(drive, times, load_robot(), np.random.default_rng(0), errors)
    assert ticks.mean(axis=0).sum() * np.pi * 0.254 / 360 == pytest.approx(times[-1] / 1.03, abs=0.01)


def test_slip_is_as_large_as_asked_for() -> None:
    drive, times = steady(400.0, 1.0, 0.0), np.arange(0.0, 400.0, 2.0)
    ticks = count_ticks(drive, times, load_robot(), np.random.default_rng(0), SensorErrors(slip=0.05))
    ratio = ticks.mean(axis=0)[1:] * np.pi * 0.254 / 360 / 2.0
    assert ratio.mean() == pytest.approx(1.0, abs=0.012)
    assert 0.02 < ratio.std() < 0.06


def test_imu() -> None:
    drive, times = steady(30.0, 1.0, 0.4), np.arange(0.0, 30.0, 0.01)
    gyro, acceleration = read_imu(drive, times, np.random.default_rng(0), EXACT)
    assert gyro[2] == pytest.approx(np.full(len(times), 0.4)) and (gyro[:2] == 0).all()
    assert acceleration.mean(axis=1) == pytest.approx([0.0, 0.4 / 9.81, 1.0], abs=0.003)
    noisy, _ = read_imu(
        drive, times, np.random.default_rng(0), SensorErrors(gyro_bias=0.03, gyro_drift=0.0, gyro_scale=0.0)
    )
    assert noisy[2].mean() == pytest.approx(0.43, abs=0.0005) and noisy[2].std() == pytest.approx(0.004, rel=0.1)


def test_default_gyro_bias_is_the_measured_one() -> None:
    drive, times = steady(30.0, 0.0, 0.0), np.arange(0.0, 30.0, 0.01)
    errors = SensorErrors(gyro_drift=0.0)
    biases = [abs(read_imu(drive, times, np.random.default_rng(s), errors)[0][2].mean()) for s in range(8)]
    assert min(biases) > 0.0005 and max(biases) < 0.0020


def test_stamps_increase() -> None:
    stamps = jittered_stamps(1.0, 5.0, 0.025, 0.4, np.random.default_rng(0))
    assert len(stamps) == 160 and (np.diff(stamps) > 0).all() and np.diff(stamps).std() > 0.001
