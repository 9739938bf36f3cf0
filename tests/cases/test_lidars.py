"""Beams whose angles, order, number or mount are told in other ways, or not at once."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pfslam_viz as pf

ROBOT = """axle_height = 0.127
wheel_diameter = 0.254
ticks_per_revolution = 360

[lidar]
position = [0.29833, 0.0, 0.51435]
roll = 3.14159265
"""


@pytest.mark.parametrize(
    ("first", "last", "beams", "head"),
    [
        (-135, 135, 271, ("laser_front_laser_fov 4.71239", "laser_front_laser_resolution 1.0")),
        (-180, 179, 360, ("laser_front_laser_fov 6.28319", "laser_front_laser_resolution 1.0")),
        (-100, 100, 201, ("laser_front_laser_fov 200.0", "laser_front_laser_resolution 1.0")),
        (-100, 100, 201, ("laser_front_laser_fov 3.490659",)),
    ],
    ids=["fov270", "flaser360", "fov200", "fov200 in radians alone"],
)
def test_a_field_of_view_by_param(
    kit: Any, tmp_path: Path, first: float, last: float, beams: int, head: tuple[str, ...]
) -> None:
    """fov270, flaser360: as the control, 0.008 m."""
    drive = kit.scanner(first, last, beams)
    lines = "".join(f"PARAM {line} robot 0\n" for line in head)
    recording = pf.load_recording(drive.flaser(tmp_path / "x.log", lines))
    np.testing.assert_allclose(np.degrees(recording.lidar.angles), np.linspace(first, last, beams), atol=1e-3)
    assert [f.what for f in recording.findings] == ["reader_note"]
    assert "by the log's PARAM lines" in recording.notes[0] and f"from {first}° to {last}°" in recording.notes[0]
    if beams > 201:
        got = kit.replayed(recording, drive.truth)
        assert got.settled < 0.016
        assert got.settled < got.online + 0.01


@pytest.mark.parametrize("told", ["pose", "param"])
def test_a_lidar_that_looks_back(kit: Any, tmp_path: Path, told: str) -> None:
    """rearpose, rearparam: 0.015 m both. 0.3 m behind the axle."""
    mount = (-0.3, 0.0, np.pi)
    drive = kit.drive(kit.degrees(-90, 90, 181), mount=mount)
    offsets = "PARAM robot_frontlaser_offset -0.3 robot 0\nPARAM robot_frontlaser_angular_offset 3.14159265 robot 0\n"
    if told == "pose":
        path = drive.flaser(tmp_path / "rear.log", laser=kit.compose(drive.odometry, mount))
    else:
        path = drive.flaser(tmp_path / "rear.log", offsets)
    recording = pf.load_recording(path)
    np.testing.assert_allclose(recording.lidar.pose[:2], mount[:2], atol=1e-3)
    assert abs(np.cos(recording.lidar.pose[2]) + 1) < 1e-5
    got = kit.replayed(recording, drive.truth)
    assert got.found == []
    assert ("turned by 180.0°" in got.said) == (told == "pose")
    assert got.settled < 0.03
    assert got.settled < got.online + 0.01


def test_a_lidar_that_looks_back_and_nothing_says_so(kit: Any, tmp_path: Path) -> None:
    drive = kit.drive(kit.degrees(-90, 90, 181), mount=(-0.3, 0.0, np.pi))
    recording = pf.load_recording(drive.flaser(tmp_path / "rear.log"))
    assert ("doubtful", "lidar_looks_backwards") in [(f.severity, f.what) for f in recording.findings]


def test_a_turn_of_240_beams(course: Any, kit: Any, tmp_path: Path) -> None:
    """n_360off, n_360ok: 0.014 m both: angle_min + k * angle_increment, where angle_max says one beam more or not."""
    drive = course(0, 358.5, 240)
    control = pf.load_recording(drive.course(tmp_path / "ok"))
    assert control.notes == ()
    recording = pf.load_recording(drive.course(tmp_path / "off", Hokuyo={"angle_max": 2 * np.pi}))
    assert "angle_max 6.28319 rad" in recording.notes[0]
    for one in (control, recording):
        np.testing.assert_allclose(one.lidar.angles, drive.angles, atol=1e-9)
    np.testing.assert_array_equal(recording.odometry, control.odometry)
    got = kit.replayed(recording, drive.truth)
    assert got.settled < 0.028
    assert got.settled < got.online + 0.01


def test_angles_in_degrees(course: Any, tmp_path: Path) -> None:
    """n_deg: converted with a note; then as the control."""
    drive = course()
    plain = pf.load_recording(drive.course(tmp_path / "plain"))
    got = pf.load_recording(
        drive.course(
            tmp_path / "set",
            Hokuyo={"angle_min": np.degrees, "angle_max": np.degrees, "angle_increment": np.degrees},
        )
    )
    assert [(f.severity, f.what) for f in got.findings if f.what != "reader_note"] == [("note", "angles_in_degrees")]
    np.testing.assert_allclose(got.lidar.angles, plain.lidar.angles, atol=1e-9)
    np.testing.assert_array_equal(got.odometry, plain.odometry)


def test_a_number_of_beams_that_varies(kit: Any, tmp_path: Path) -> None:
    """ld19: every scan used. 176 to 185 beams a turn."""
    drive = kit.scanner()
    rng = np.random.default_rng(3)
    scans = []
    for pose in drive.truth:
        beams = int(rng.integers(176, 186))
        angles = -np.pi + 2 * np.pi / beams * np.arange(beams)
        ranges = kit.cast(pose[None], angles)[0] + rng.normal(0, 0.01, beams)
        scans.append((np.where(ranges > 12, 0.0, ranges), -np.pi, 2 * np.pi / beams))
    got = kit.replayed(drive.robotlaser(tmp_path / "ld19.log", 12.0, scans), drive.truth)
    assert "176 to 185 beams" in got.said
    assert got.found == []
    assert got.settled < 0.03
    assert got.settled < got.online + 0.01


@pytest.mark.parametrize("beams", [91, 1081])
def test_a_clockwise_lidar(kit: Any, tmp_path: Path, beams: int) -> None:
    """clockwise: as its mirror."""
    drive = kit.drive(kit.degrees(-90, 90, beams), way=kit.way_round(length=28.0)).limited(8.0, 50.0)
    plain = pf.load_recording(drive.robotlaser(tmp_path / "plain.log", 50.0))
    mirrored = drive.changed(angles=drive.angles[::-1], ranges=drive.ranges[:, ::-1])
    got = pf.load_recording(mirrored.robotlaser(tmp_path / "clockwise.log", 50.0))
    np.testing.assert_allclose(got.lidar.angles, plain.lidar.angles, atol=2e-4)  # by six digits of the increment
    np.testing.assert_array_equal(got.ranges, plain.ranges)
    assert len(got) == len(drive.stamps)
    assert "clockwise" in got.notes[0]
    assert [f for f in got.findings if f.severity != "note"] == []


def test_a_replay_of_a_clockwise_lidar(kit: Any, tmp_path: Path) -> None:
    drive = kit.scanner(beams=91).limited(8.0, 50.0)
    mirrored = drive.changed(angles=drive.angles[::-1], ranges=drive.ranges[:, ::-1])
    got = kit.replayed(mirrored.robotlaser(tmp_path / "clockwise.log", 50.0), drive.truth)
    assert got.settled < 0.04
    assert got.settled < got.online + 0.01


def test_a_clockwise_set(course: Any, tmp_path: Path) -> None:
    """1,081 beams from the left to the right: angle_increment below zero."""
    drive = course(beams=1081)
    plain = pf.load_recording(drive.course(tmp_path / "plain"))
    mirrored = drive.changed(angles=drive.angles[::-1], ranges=drive.ranges[:, ::-1])
    got = pf.load_recording(mirrored.course(tmp_path / "clockwise"))
    order = np.argsort(got.lidar.angles)
    np.testing.assert_allclose(got.lidar.angles[order], plain.lidar.angles, atol=1e-9)
    np.testing.assert_array_equal(got.ranges[:, order], plain.ranges)
    assert [f for f in got.findings if f.severity != "note"] == []


def test_a_lidar_upside_down(course: Any, kit: Any, tmp_path: Path) -> None:
    """By the robot file's roll; without it the scans turn the other way, which is said."""
    drive = course()
    hanging = drive.changed(ranges=drive.ranges[:, ::-1])  # its first beam, at -135 degrees, looks to the left
    path = hanging.course(tmp_path / "set")
    (tmp_path / "robot.toml").write_text(ROBOT)
    recording = pf.load_recording(path, robot=tmp_path / "robot.toml")
    assert [f for f in recording.findings if f.severity != "note"] == []
    got = kit.replayed(recording, drive.truth)
    assert got.settled < 0.032
    assert got.settled < got.online + 0.01
    (finding,) = (f for f in pf.load_recording(path).findings if f.severity != "note")
    assert (finding.severity, finding.what) == ("doubtful", "turns_reversed")
    assert "upside down" in finding.advice


@pytest.mark.parametrize("seed", [0, 1])
def test_beams_of_one_scan_from_different_poses(kit: Any, tmp_path: Path, seed: int) -> None:
    """deskew: 0.1 m or better, and settled never worse than online."""
    way = kit.way_round(turn_rate=2.0, speed=0.8)
    drive = kit.drive(kit.degrees(-180, 178, 180), rate=5, way=way, sweep=0.2, seed=seed)
    got = kit.replayed(drive.robotlaser(tmp_path / "deskew.log", 50.0), drive.truth)
    assert "spread over 0.199 s, counter-clockwise, the stamp being that of the last one" in got.said
    assert got.settled < 0.1 and got.online < 0.1
    assert got.settled < got.online + 0.01
