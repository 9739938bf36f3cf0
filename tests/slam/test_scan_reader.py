"""From ranges to end points, (22)."""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.recording import Lidar
from pfslam_viz.settings import ScanConfig
from pfslam_viz.slam.scan_reader import ScanReader

QUARTER = math.pi / 2


def lidar(yaw: float = 0.0) -> Lidar:
    return Lidar(np.array([-QUARTER, 0.0, QUARTER]), 0.1, 30.0, np.array([0.3, 0.1, yaw]))


def ranges(*values: float) -> NDArray[np.float32]:
    return np.array(values, np.float32)


def test_end_points_by_hand() -> None:
    scan = ScanReader.of(lidar(), ScanConfig()).read(7, 1.5, ranges(1, 2, 4))
    np.testing.assert_allclose(scan.points, [[0.3, -0.9], [2.3, 0.1], [0.3, 4.1]], atol=1e-12)
    np.testing.assert_array_equal(scan.lidar_position, [0.3, 0.1])
    assert (scan.index, scan.stamp) == (7, 1.5)


def test_the_lidars_yaw_turns_the_beams_about_it() -> None:
    scan = ScanReader.of(lidar(yaw=QUARTER), ScanConfig()).read(0, 0.0, ranges(1, 2, 4))
    np.testing.assert_allclose(scan.points, [[1.3, 0.1], [0.3, 2.1], [-3.7, 0.1]], atol=1e-12)


def test_ranges_outside_the_limits_are_no_return() -> None:
    reader = ScanReader.of(lidar(), ScanConfig())
    assert len(reader.read(0, 0.0, ranges(0.0, 0.05, 30.5)).points) == 0
    assert len(reader.read(0, 0.0, ranges(0.11, 29.9, 0.0)).points) == 2
    near = ScanReader.of(lidar(), ScanConfig(max_range=3.0))
    np.testing.assert_allclose(near.read(0, 0.0, ranges(4, 2, 4)).points, [[2.3, 0.1]], atol=1e-12)
    far = ScanReader.of(lidar(), ScanConfig(max_range=300.0))  # no further than the lidar sees
    assert len(far.read(0, 0.0, ranges(40, 40, 40)).points) == 0


def test_thinning_keeps_the_first_and_the_last_beam() -> None:
    scanner = Lidar(np.linspace(-1, 1, 101), 0.1, 30.0, np.zeros(3))
    points = ScanReader.of(scanner, ScanConfig(max_beams=5)).read(0, 0.0, np.full(101, 2.0, np.float32)).points
    np.testing.assert_allclose(np.arctan2(points[:, 1], points[:, 0]), [-1, -0.5, 0, 0.5, 1], atol=1e-12)
    single = ScanReader.of(scanner, ScanConfig(max_beams=1)).read(0, 0.0, np.full(101, 2.0, np.float32))
    assert len(single.points) == 1


TURNING = np.array([[0.0, 0.0, math.pi], [0.0, 0.0, 2 * math.pi]])  # rad/s before and after the stamp


def test_beams_are_seen_from_where_the_robot_was_then() -> None:
    """The robot turns in place, by 45 degrees in the quarter second before the stamp and 90 in that after it.

    The right beam (of the lidar at (0.3, 0.1)) ends at (0.3, -0.9) then, 45 degrees before; the left at (0.3, 4.1).
    """
    reader = ScanReader.of(lidar(), ScanConfig(), np.array([-0.25, 0.0, 0.25]))
    points = reader.read(0, 0.0, ranges(1, 2, 4), TURNING).points
    h = math.sqrt(0.5)
    np.testing.assert_allclose(points, [[h * (0.3 - 0.9), h * (-0.3 - 0.9)], [2.3, 0.1], [-4.1, 0.3]], atol=1e-12)
    # Beams without a return are left out with their times.
    np.testing.assert_allclose(reader.read(0, 0.0, ranges(0, 2, 4), TURNING).points, points[1:], atol=1e-12)


def test_beams_of_a_robot_that_drives_on() -> None:
    """2 m/s ahead: a beam of half a second later ends 1 m farther."""
    reader = ScanReader.of(lidar(), ScanConfig(), np.array([0.0, 0.25, 0.5]))
    points = reader.read(0, 0.0, ranges(1, 2, 4), np.array([[9.0, 9.0, 9.0], [2.0, 0.0, 0.0]])).points
    np.testing.assert_allclose(points, [[0.3, -0.9], [2.8, 0.1], [1.3, 4.1]], atol=1e-12)


def test_beam_times_may_be_left_alone() -> None:
    times = np.array([-0.25, 0.0, 0.25])
    plain = ScanReader.of(lidar(), ScanConfig()).read(0, 0.0, ranges(1, 2, 4)).points
    for reader in (ScanReader.of(lidar(), ScanConfig(deskew=False), times), ScanReader.of(lidar(), ScanConfig())):
        np.testing.assert_array_equal(reader.read(0, 0.0, ranges(1, 2, 4), TURNING).points, plain)
    reader = ScanReader.of(lidar(), ScanConfig(), times)
    np.testing.assert_array_equal(reader.read(0, 0.0, ranges(1, 2, 4)).points, plain)


def test_a_range_at_the_limit_is_judged_alike_with_and_without_beam_times() -> None:
    """0.3 m as a lidar logs it, in float32, lies 1e-8 m beyond a limit of 0.3: no return, and no time for it either."""
    scanner = Lidar(np.array([-QUARTER, 0.0, QUARTER]), 0.1, 0.3, np.zeros(3))
    times = np.array([0.0, 0.1, 0.2])
    scan = ScanReader.of(scanner, ScanConfig(), times).read(0, 0.0, ranges(0.3, 0.2, 0.3), TURNING)
    np.testing.assert_allclose(scan.points, [[0.2 * math.cos(0.2 * math.pi), 0.2 * math.sin(0.2 * math.pi)]])
