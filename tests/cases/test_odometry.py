"""Odometry that is not there, starts again, jumps, or is of another kind."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pfslam_viz as pf
from pfslam_viz.recordings.checking.check import check


@pytest.mark.parametrize("seed", [0, 1])
def test_no_odometry(kit: Any, tmp_path: Path, seed: int) -> None:
    """noodom: says so; scans are matched with each other instead."""
    drive = kit.scanner(beams=181, seed=seed)
    got = kit.replayed(drive.changed(odometry=0 * drive.odometry).flaser(tmp_path / "noodom.log"), drive.truth)
    assert got.found == [("doubtful", "no_odometry")]
    assert got.settled < 0.06
    assert got.settled < got.online + 0.01


def test_no_odometry_at_ten_hertz_in_a_room(kit: Any) -> None:
    """A lidar of arrays alone, carried round a table in a room of 8 x 6 m."""
    walls = np.array([*kit.box(-1.5, -1.5, 6.5, 4.5), *kit.box(1.5, 1.0, 3.5, 2.0), *kit.box(5.8, -1.5, 6.5, 0.5)])
    corners = np.array([[0, 0], [4.8, 0], [4.8, 3.2], [0, 3.2], [0, 0.0]])
    times, poses = [0.0], [[0.0, 0.0, 0.0]]
    for turn, (x, y) in enumerate(corners[1:]):
        times += [times[-1] + float(np.hypot(x - poses[-1][0], y - poses[-1][1])) / 0.5]
        poses += [[x, y, turn * np.pi / 2]]
        times, poses = [*times, times[-1] + 2.0], [*poses, [x, y, (turn + 1) * np.pi / 2]]
    drive = kit.drive(kit.degrees(-135, 135, 181), rate=10, way=kit.Way(np.array(times), np.array(poses)), walls=walls)
    got = kit.replayed(
        pf.Recording.from_arrays(stamps=drive.stamps, ranges=drive.ranges, angles=drive.angles), drive.truth
    )
    assert got.found == [("doubtful", "no_odometry")]
    assert got.reckoned > 2.0
    assert got.settled < 0.06
    assert got.settled < got.online + 0.01


def test_odometry_starts_again(kit: Any, tmp_path: Path) -> None:
    """odomreset: says so at that scan; the jump is not believed."""
    drive = kit.scanner(beams=181)
    at, odometry = 205, drive.odometry.copy()
    x, y, turn = odometry[at].copy()
    c, s = np.cos(turn), np.sin(turn)
    dx, dy = odometry[at:, 0] - x, odometry[at:, 1] - y
    odometry[at:] = np.column_stack([c * dx + s * dy, c * dy - s * dx, odometry[at:, 2] - turn])
    got = kit.replayed(drive.changed(odometry=odometry).flaser(tmp_path / "reset.log"), drive.truth)
    assert got.found == [("doubtful", "odometry_reset")]
    (finding,) = got.result.recording.findings
    assert finding.scan == at and f"scan {at}" in finding.message
    assert got.reckoned < 3.0
    assert got.settled < 0.02
    assert got.settled < got.online + 0.01


def test_odometry_starts_again_in_y_alone(kit: Any, tmp_path: Path) -> None:
    drive = kit.scanner(beams=181)
    odometry = drive.odometry.copy()
    odometry[210:, 1] -= odometry[210, 1]
    assert abs(odometry[209, 1]) > 5
    got = kit.replayed(drive.changed(odometry=odometry).flaser(tmp_path / "reset.log"), drive.truth)
    ((severity, what),) = got.found
    assert severity == "doubtful" and what in ("odometry_jump", "odometry_reset")
    assert got.result.recording.findings[0].scan == 210
    assert got.settled < 0.02
    assert got.settled < got.online + 0.01


@pytest.mark.parametrize("wheels", [slice(0, 4), slice(2, 3)], ids=["all", "the third"])
def test_a_wheel_count_that_wraps(course: Any, kit: Any, tmp_path: Path, wheels: slice) -> None:
    """n_int16: says so; the sample is not believed."""

    def spoil(counts: Any) -> Any:
        counts = counts.copy()
        counts[wheels, 600] = -32768
        return counts

    drive = course()
    got = kit.replayed(drive.course(tmp_path / "set", Encoders={"counts": spoil}), drive.truth)
    assert got.found == [("doubtful", "odometry_jump")]
    assert got.result.recording.findings[0].scan == 150
    assert got.reckoned < 0.4
    assert got.settled < 0.032
    assert got.settled < got.online + 0.01


def test_a_gyro_in_degrees_a_second(course: Any, tmp_path: Path) -> None:
    drive = course()
    plain = pf.load_recording(drive.course(tmp_path / "plain"))
    got = pf.load_recording(drive.course(tmp_path / "set", Imu={"angular_velocity": np.degrees}))
    assert [(f.severity, f.what) for f in got.findings] == [("note", "turns_in_degrees")]
    np.testing.assert_allclose(got.odometry, plain.odometry, atol=2e-3)
    np.testing.assert_allclose(got.dead_reckoning()[-1], plain.dead_reckoning()[-1], atol=0.05)


def test_poses_where_motions_are_due(kit: Any) -> None:
    drive = kit.scanner(beams=91)
    arrays = {"stamps": drive.stamps, "angles": drive.angles, "ranges": drive.ranges}
    got = check(pf.Recording.from_arrays(odometry=drive.odometry, **arrays))
    assert [(f.severity, f.what) for f in got.findings] == [("note", "odometry_cumulative")]
    plain = check(pf.Recording.from_arrays(odometry_poses=drive.odometry, **arrays))
    np.testing.assert_allclose(got.odometry[2:], plain.odometry[2:], atol=1e-9)
    np.testing.assert_allclose(got.odometry[1], plain.odometry[1], atol=0.02)  # from the first pose, which is lost
