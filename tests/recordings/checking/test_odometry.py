"""Odometry of another kind or unit, jumps, standstill, none; and lidars that look another way."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.recordings.findings import Finding
from pfslam_viz.recordings.recording import Recording

Only = Callable[[Recording, str], Finding]
Write = Callable[..., Path]
ANGLES = np.radians(np.linspace(-135, 135, 181))


def test_poses_where_motions_are_due(ring: Any, only: Only) -> None:
    got = ring.checked(odometry=ring.truth)
    assert only(got, "note").what == "odometry_cumulative"
    np.testing.assert_allclose(got.odometry[2:], geometry.increments(ring.truth)[2:], atol=1e-12)
    assert np.hypot(*got.odometry[1, :2]) < 0.13  # the first pose is lost, and is no jump from the origin


@pytest.mark.parametrize(("unit", "name"), [(1e3, "millimetres"), (1e2, "centimetres")])
def test_motions_of_another_unit(ring: Any, only: Only, unit: float, name: str) -> None:
    got = ring.checked(odometry=ring.odometry * (unit, unit, 1))
    assert only(got, "note").what == f"odometry_in_{name}"
    np.testing.assert_allclose(got.odometry[1:], ring.odometry[1:], atol=1e-12)


def test_turns_in_degrees(ring: Any, only: Only) -> None:
    got = ring.checked(odometry=ring.odometry * (1, 1, np.degrees(1)))
    assert only(got, "note").what == "turns_in_degrees"
    np.testing.assert_allclose(got.odometry[1:], ring.odometry[1:], atol=1e-12)


def test_a_gyro_in_degrees_a_second(write_ring: Write) -> None:
    """The wheels' motion was bent by the turn, and is bent back."""
    plain = load_recording(write_ring())
    got = load_recording(write_ring(Imu={"angular_velocity": np.degrees}))
    assert [f.what for f in got.findings if f.what != "reader_note"] == ["turns_in_degrees"]
    np.testing.assert_allclose(got.odometry[:, 2], plain.odometry[:, 2], atol=1e-9)
    assert np.hypot(*(got.dead_reckoning() - plain.dead_reckoning())[:, :2].T).max() < 0.05


def test_headings_of_poses_in_degrees_cannot_be_mended(ring: Any, only: Only) -> None:
    finding = only(ring.checked(odometry_poses=ring.truth * (1, 1, np.degrees(1))), "doubtful")
    assert finding.what == "scans_contradict_odometry"


def test_motions_where_poses_are_due(ring: Any, only: Only) -> None:
    assert only(ring.checked(odometry_poses=ring.odometry), "doubtful").what == "scans_contradict_odometry"


def test_speeds_that_no_robot_reaches_are_refused(ring: Any, only: Only) -> None:
    rng = np.random.default_rng(1)
    wild = ring.odometry + rng.normal(0, 30, ring.odometry.shape) * (1, 1, 0)
    finding = only(ring.checked(odometry=wild), "wrong")
    assert finding.what == "odometry_impossible" and "m/s" in finding.message


def test_a_reset_is_not_believed(write_log: Write, ring: Any) -> None:
    poses = geometry.between(ring.truth[0], ring.truth)
    poses[200:] = geometry.between(poses[200], poses[200:])
    got = load_recording(write_log(poses))
    (finding,) = (f for f in got.findings if f.what != "reader_note")
    assert (finding.severity, finding.what, finding.scan) == ("doubtful", "odometry_reset", 200)
    assert got.odometry_known is not None
    assert np.flatnonzero(~got.odometry_known).tolist() == [200]
    truth = geometry.between(ring.truth[0], ring.truth)
    assert np.hypot(*(got.dead_reckoning() - truth)[:, :2].T).max() < 0.15  # one step of 0.12 m was guessed


@pytest.mark.parametrize("jump", [(1.5, 0.0, 0.0), (0.0, -40.0, 0.0), (0.0, 0.0, 1.5), (-65.536, 0.0, 0.0)])
def test_a_jump_is_not_believed(ring: Any, only: Only, jump: tuple[float, float, float]) -> None:
    odometry = ring.odometry.copy()
    odometry[60] += jump
    got = ring.checked(odometry=odometry)
    finding = only(got, "doubtful")
    assert (finding.what, finding.scan) == ("odometry_jump", 60)
    assert np.flatnonzero(~got.odometry_known).tolist() == [60]
    np.testing.assert_allclose(got.odometry[60], 0.5 * (ring.odometry[59] + ring.odometry[61]), atol=1e-9)
    rest = np.delete(np.arange(len(odometry)), [0, 60])
    np.testing.assert_array_equal(got.odometry[rest], ring.odometry[rest])


def test_a_wheel_count_out_of_range(write_ring: Write, ring: Any) -> None:
    """-32768 ticks of one wheel: 18 m by the mean of four, in 25 ms."""

    def spoil(counts: Any) -> Any:
        counts = counts.copy()
        counts[1, 1500] = -32768
        return counts

    got = load_recording(write_ring(Encoders={"counts": spoil}))
    assert [(f.severity, f.what) for f in got.findings if f.what != "reader_note"] == [("doubtful", "odometry_jump")]
    truth = geometry.between(ring.truth[0], ring.truth)
    assert np.hypot(*(got.dead_reckoning() - truth)[-1, :2]) < 0.15


def test_a_wrap_now_and_then(ring: Any, only: Only) -> None:
    """A position of 16 bits in tenths of a millimetre comes round every 6.5536 m."""
    poses = ring.truth.copy()
    poses[:, 0] %= 6.5536
    got = ring.checked(odometry_poses=poses)
    assert "3 more such steps" in only(got, "doubtful").message
    assert int((~got.odometry_known).sum()) == 4
    end = got.dead_reckoning()[-1] - geometry.between(ring.truth[0], ring.truth)[-1]
    assert np.hypot(end[0], end[1]) < 0.05


def test_a_hard_turn_is_no_jump(ring: Any) -> None:
    """A step that stands out is believed where the scans bear it out: here the robot was carried on by 1.5 m."""
    kept = np.r_[0:60, 72 : len(ring.stamps)]
    stamps = np.arange(len(kept)) / 5.0
    got = ring.checked(stamps=stamps, ranges=ring.ranges[kept], odometry_poses=ring.truth[kept])
    assert got.findings == ()


def test_no_odometry(ring: Any, only: Only) -> None:
    finding = only(ring.checked(odometry=0 * ring.odometry), "doubtful")
    assert finding.what == "no_odometry" and "robot moves" in finding.message
    rest = np.tile(ring.ranges[:1], (len(ring.stamps), 1))
    assert only(ring.checked(ranges=rest, odometry=0 * ring.odometry), "note").what == "no_odometry"


@pytest.mark.parametrize("columns", [slice(0, 3), slice(0, 2)])
def test_odometry_that_stands_still_for_a_while(ring: Any, only: Only, columns: slice) -> None:
    odometry = ring.odometry.copy()
    odometry[50:121, columns] = 0.0
    finding = only(ring.checked(odometry=odometry), "doubtful")
    assert (finding.what, finding.scan) == ("odometry_stands_still", 49)
    assert "14.2 s" in finding.message


def test_standing_still_with_a_creeping_gyro_is_good(ring: Any) -> None:
    """A minute's rest in which the heading creeps by 0.1 rad."""
    k, n = 100, 300
    rest = np.tile(ring.ranges[k], (n, 1)) + np.random.default_rng(2).normal(0, 0.01, (n, ring.ranges.shape[1]))
    creep = np.tile([0.0, 0.0, 0.1 / n], (n, 1))
    odometry = np.concatenate([ring.odometry[: k + 1], creep, ring.odometry[k + 1 :]])
    ranges = np.concatenate([ring.ranges[: k + 1], rest, ring.ranges[k + 1 :]])
    assert ring.checked(stamps=np.arange(len(ranges)) / 5.0, ranges=ranges, odometry=odometry).findings == ()


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"angles": -ANGLES}, "turns_reversed"),
        ({"angles": ANGLES + np.pi}, "lidar_looks_backwards"),
        ({"angles": ANGLES * 180 / 270}, "field_of_view"),
        ({"lidar_pose": (0.0, 0.0, np.pi)}, "lidar_looks_backwards"),
    ],
)
def test_a_lidar_that_looks_another_way(ring: Any, only: Only, changes: dict[str, Any], what: str) -> None:
    assert only(ring.checked(**changes), "doubtful").what == what


@pytest.mark.parametrize(
    ("times", "what"),
    [
        ((1, 1, -1), "turns_reversed"),
        ((-1, 1, 1), "lidar_looks_backwards"),
        ((1, 1, 0), "odometry_without_turns"),
    ],
)
def test_an_odometry_of_the_wrong_sign(ring: Any, only: Only, times: tuple[int, int, int], what: str) -> None:
    assert only(ring.checked(odometry=ring.odometry * times), "doubtful").what == what


def test_select_keeps_what_is_known(ring: Any) -> None:
    odometry = ring.odometry.copy()
    odometry[60] += (50.0, 0, 0)
    got = ring.checked(odometry=odometry)
    thinned = got.select(0, 100, 7)  # scan 63 is reached over step 60
    assert thinned.odometry_known is not None
    assert np.flatnonzero(~thinned.odometry_known).tolist() == [9]
    assert got.select(60).odometry_known.all() and thinned.checked


@pytest.mark.parametrize("scans", [1, 2, 4, 6, 11])
def test_a_few_scans_are_no_trouble(ring: Any, scans: int) -> None:
    short = ring.recording().select(50, 50 + scans)
    from pfslam_viz.recordings.checking.check import check

    assert check(short).findings == ()
