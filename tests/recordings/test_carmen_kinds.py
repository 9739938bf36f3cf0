"""Logs of the kinds that users bring, each made here."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import carmen
from pfslam_viz.recordings.beam_grid import resample
from pfslam_viz.recordings.carmen_angles import declared_grid
from pfslam_viz.recordings.carmen_stamps import wrap_period

Array = NDArray[np.float64]
ROOM = 4.0  # half the side of a square room with the robot somewhere in it


def cast(pose: Sequence[float] | Array, angles: Array) -> Array:
    """Ranges in m to the walls of the square room |x|, |y| <= ROOM from a lidar at ``pose``."""
    x, y, theta = (float(v) for v in pose)
    c, s = np.cos(theta + angles), np.sin(theta + angles)
    with np.errstate(divide="ignore"):
        along = np.where(c > 0, (ROOM - x) / c, np.where(c < 0, (-ROOM - x) / c, np.inf))
        across = np.where(s > 0, (ROOM - y) / s, np.where(s < 0, (-ROOM - y) / s, np.inf))
    ranges: Array = np.minimum(along, across)
    return ranges


def drive(n: int = 12) -> Array:
    """Poses (n, 3) of a robot that runs a curve in the room."""
    k = np.linspace(0.0, 11.0, n)
    return np.column_stack([0.1 * k, 0.01 * k**2, 0.1 * k])


def numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{v:f}" for v in values)


def flaser(ranges: Array, laser: Array, robot: Array, stamp: float, kind: str = "FLASER") -> str:
    readings = " ".join(f"{r:.2f}" for r in ranges)
    return f"{kind} {len(ranges)} {readings} {numbers(laser)} {numbers(robot)} {stamp:f} host {stamp:f}"


def robotlaser(ranges: Array, start: float, resolution: float, robot: Array, stamp: float) -> str:
    head = f"ROBOTLASER1 0 {start:f} {abs(resolution) * len(ranges):f} {resolution:f} 12.0 0.01 0 {len(ranges)}"
    return f"{head} {numbers(ranges)} 0 {numbers(robot)} {numbers(robot)} 0 0 0 0 0 {stamp:f} host 0.1"


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def front_log(beams: int, first: float, step: float) -> list[str]:
    """FLASER lines of the drive with a lidar whose beams start at ``first`` degrees, ``step`` degrees apart."""
    angles = np.radians(first + step * np.arange(beams))
    return [flaser(cast(pose, angles), pose, pose, float(k)) for k, pose in enumerate(drive())]


def errors(path: Path) -> Array:
    """How far the end points of all beams of a loaded log lie off the room's walls (m), by its odometry and mount."""
    recording = carmen.load(path)
    poses = geometry.compose(geometry.accumulate(recording.odometry), recording.lidar.pose)
    off = [np.abs(cast(p, recording.lidar.angles) - r) for p, r in zip(poses, recording.ranges, strict=True)]
    return np.array(off)


@pytest.mark.parametrize(
    ("beams", "params", "first", "step"),
    [
        (271, ("laser_front_laser_resolution 1.0", "laser_front_laser_fov 4.71239"), -135, 1.0),
        (271, ("laser_front_laser_resolution 0.0174533",), -135, 1.0),
        (271, ("laser_front_laser_fov 270",), -135, 1.0),
        (541, ("laser_frontlaser_resolution 0.5", "laser_frontlaser_fov 270"), -135, 0.5),
        (360, ("laser_front_laser_resolution 1.0", "laser_front_laser_fov 6.28319"), -180, 1.0),
        (360, ("laser_front_laser_resolution 1.0",), -180, 1.0),
        (360, ("laser_laser1_fov 360.0",), -180, 1.0),
        (240, ("laser_laser1_resolution 1.0", "laser_laser1_start_angle -100"), -100, 1.0),
        (360, ("laser_front_laser_resolution 0.5",), -90, 0.5),
        (101, ("laser_front_laser_type LMS", "laser_front_laser_resolution 1.0"), -50, 1.0),
        # An LMS's 361 beams are half a degree apart whatever the left-over setting says.
        (361, ("laser_front_laser_type LMS", "laser_front_laser_resolution 1.0"), -90, 0.5),
        (181, ("laser_rear_laser_resolution 0.5",), -90, 1.0),
        (181, ("laser_front_laser_resolution 7.0",), -90, 1.0),
    ],
)
def test_param_gives_the_angles_of_flaser(
    tmp_path: Path, beams: int, params: tuple[str, ...], first: float, step: float
) -> None:
    lines = [f"PARAM {param} robot 0" for param in params]
    path = write(tmp_path / "x.log", *lines, *front_log(beams, first, step))
    angles = np.degrees(carmen.load(path).lidar.angles)
    np.testing.assert_allclose(angles, first + step * np.arange(beams), atol=1e-3)
    assert errors(path).max() < 0.02


def test_param_that_differs_from_the_usual_is_said(tmp_path: Path) -> None:
    fov = "PARAM laser_front_laser_fov 4.71239 robot 0"
    notes = carmen.load(write(tmp_path / "x.log", fov, *front_log(271, -135, 1.0))).notes
    assert notes == ("lidar: by the log's PARAM lines its 271 beams lie 1° apart, from -135° to 135°",)
    usual = "PARAM laser_front_laser_resolution 0.5 robot 0"
    assert carmen.load(write(tmp_path / "x.log", usual, *front_log(361, -90, 0.5))).notes == ()
    impossible = "PARAM laser_front_laser_resolution 7.0 robot 0"
    assert "impossible" in carmen.load(write(tmp_path / "x.log", impossible, *front_log(181, -90, 1.0))).notes[0]


@pytest.mark.parametrize(
    ("beams", "resolution", "fov", "degrees"),
    [
        (271, 1.0, None, (-135, 1.0)),
        (1081, 0.25, 4.71239, (-135, 0.25)),
        (1081, 0.00436332, 270.0, (-135, 0.25)),
        (682, 0.3515625, None, (-119.70703, 0.3515625)),
        (180, None, 180.0, (-90, 1.0)),
        (181, None, math.pi, (-90, 1.0)),
        (360, None, 2 * math.pi, (-180, 1.0)),
        (720, 0.5, 360.0, (-180, 0.5)),
        (450, None, 6.28, (-180, 0.8)),  # a whole turn, written roughly
        (271, -1.0, 270.0, (135, -1.0)),
        (271, 1.0, 180.0, (-135, 1.0)),  # contradictory: the resolution counts
    ],
)
def test_declared_grid(beams: int, resolution: float | None, fov: float | None, degrees: tuple[float, float]) -> None:
    grid = declared_grid(beams, resolution, fov)
    assert grid is not None
    np.testing.assert_allclose(np.degrees(grid), degrees, atol=2e-3)


REAR = np.array([-0.3, 0.0, math.pi])
HALF_TURN = np.radians(np.arange(-90, 91.0))


def rear_log(kind: str = "FLASER", corrected: bool = False) -> list[str]:
    """A lidar 0.3 m behind that looks back; ``corrected``: its pose column holds SLAM's result instead of its place."""
    lines = []
    for k, pose in enumerate(drive()):
        laser = geometry.compose(pose, REAR)
        written = geometry.compose([0.02 * k, -0.03 * k, 0.02 * k], pose) if corrected else laser
        lines.append(flaser(cast(laser, HALF_TURN), written, pose, float(k), kind))
    return lines


def test_laser_pose_of_flaser_is_the_mount(tmp_path: Path) -> None:
    recording = carmen.load(write(tmp_path / "x.log", *rear_log()))
    np.testing.assert_allclose(recording.lidar.pose, REAR, atol=1e-9)
    assert len(recording.notes) == 1 and "-0.300 m ahead, 0.000 m left, turned by 180.0°" in recording.notes[0]
    assert errors(tmp_path / "x.log").max() < 0.02


def test_one_jump_of_the_laser_pose_does_not_hide_the_mount(tmp_path: Path) -> None:
    lines = rear_log()
    broken = lines[5].split(" ")
    broken[-9] = "55.0"  # the laser's x
    recording = carmen.load(write(tmp_path / "x.log", *lines[:5], " ".join(broken), *lines[6:]))
    np.testing.assert_allclose(recording.lidar.pose, REAR, atol=1e-9)


def test_corrected_poses_are_no_mount(tmp_path: Path) -> None:
    assert carmen.load(write(tmp_path / "x.log", *rear_log(corrected=True))).lidar.pose.tolist() == [0, 0, 0]


@pytest.mark.parametrize("offset", ["3.14159265", "180.0"])
def test_param_goes_before_the_laser_pose(tmp_path: Path, offset: str) -> None:
    params = ["PARAM robot_frontlaser_offset -0.25 robot 0", f"PARAM robot_frontlaser_angular_offset {offset} robot 0"]
    pose = carmen.load(write(tmp_path / "x.log", *params, *rear_log(corrected=True))).lidar.pose
    np.testing.assert_allclose(pose, [-0.25, 0, math.pi], atol=1e-6)


def test_small_angular_offset_in_degrees_is_told_by_the_laser_pose(tmp_path: Path) -> None:
    place = np.array([0.1, 0.0, math.radians(3.0)])
    lines = [
        flaser(cast(laser, HALF_TURN), laser, pose, float(k))
        for k, pose in enumerate(drive())
        for laser in [geometry.compose(pose, place)]
    ]
    path = write(tmp_path / "x.log", "PARAM robot_frontlaser_angular_offset 3.0 robot 0", *lines)
    np.testing.assert_allclose(carmen.load(path).lidar.pose, place, atol=1e-6)


def test_laser_behind(tmp_path: Path) -> None:
    np.testing.assert_allclose(carmen.load(write(tmp_path / "x.log", *rear_log("RLASER"))).lidar.pose, REAR, atol=1e-9)
    params = ["PARAM robot_frontlaser_offset 0.2 robot 0", "PARAM robot_rearlaser_offset -0.3 robot 0"]
    path = write(tmp_path / "x.log", *params, *rear_log("REARLASER", corrected=True))
    np.testing.assert_allclose(carmen.load(path).lidar.pose, REAR, atol=1e-9)
    assert errors(path).max() < 0.02
    both = carmen.load(write(tmp_path / "x.log", *front_log(181, -90, 1.0), *rear_log("RLASER"), rear_log("RLASER")[0]))
    assert both.lidar.pose.tolist() == [0, 0, 0]
    assert both.notes == ("13 RLASER lines are not used: the scans are taken from FLASER",)


def test_raw_laser_takes_its_odometry_from_odom(tmp_path: Path) -> None:
    lines = []
    for k, pose in enumerate(drive()):
        lines.append(f"ODOM {numbers(pose)} 0 0 0 {k:f} host {k:f}")
        ranges = cast(pose, np.radians(np.arange(-45, 46.0)))
        lines.append(f"RAWLASER1 0 -0.785398 1.570796 0.0174533 30.0 0.01 0 91 {numbers(ranges)} 0 {k:f} host {k:f}")
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    assert carmen.looks_like_log(tmp_path / "x.log")
    assert recording.lidar.range_max == 30.0
    np.testing.assert_allclose(np.degrees(recording.lidar.angles), np.arange(-45, 46), atol=1e-3)
    np.testing.assert_allclose(geometry.accumulate(recording.odometry), drive(), atol=1e-5)
    assert errors(tmp_path / "x.log").max() < 0.02


def test_unknown_lasers_are_named(tmp_path: Path) -> None:
    path = write(tmp_path / "x.log", *["XYZLASER7 1 2 3"] * 5, "ODOM 0 0 0 0 0 0 1 h 1")
    with pytest.raises(InputError, match=r"holds no scans .*; it has 5 XYZLASER7 lines, which cannot be read"):
        carmen.load(path)


@pytest.mark.parametrize("ticks_per_second", [1, 1e3, 1e6])
@pytest.mark.parametrize("signed", [False, True])
def test_stamps_of_a_32_bit_counter(tmp_path: Path, ticks_per_second: float, signed: bool) -> None:
    period = 2.0**32 / ticks_per_second
    start = (period / 2 if signed else period) - 5.25
    true = start + np.arange(12.0)
    stamps = np.where(true >= start + 5.25, true - period, true)
    stamps[[6, 7]] = stamps[[7, 6]]  # a little disorder as well
    lines = []
    for pose, stamp in zip(drive(), stamps, strict=True):
        lines.append(flaser(cast(pose, HALF_TURN), pose, pose, float(stamp)))
        lines.append(f"ODOM {numbers(pose)} 0 0 0 {stamp:f} host 0")
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    np.testing.assert_allclose(recording.stamps, true, atol=1e-6)
    np.testing.assert_allclose(recording.streams[1].stamps, true, atol=1e-6)
    assert any("as a 32-bit counter does" in note for note in recording.notes)


def test_odometry_that_is_logged_from_the_wrap_on_keeps_up_with_the_scans(tmp_path: Path) -> None:
    period = 2.0**32 / 1e3
    true = period - 5.5 + np.arange(12.0)
    lines = []
    for pose, stamp in zip(drive(), true, strict=True):
        lines.append(flaser(cast(pose, HALF_TURN), pose * 0, pose * 0, stamp % period))
        if stamp > period:
            lines.append(f"ODOM {numbers(pose)} 0 0 0 {stamp % period:f} host 0")
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    np.testing.assert_allclose(recording.streams[1].stamps, true[6:], atol=1e-6)
    np.testing.assert_allclose(recording.dead_reckoning()[-1], geometry.between(drive()[6], drive()[-1]), atol=1e-5)


def test_stamps_that_only_run_backwards_are_no_counter() -> None:
    assert wrap_period(np.array([0.0, 2.0, 1.0, 3.0])) is None
    assert wrap_period(np.array([976052000.0, 976056294.0, 976052000.0])) is None  # of 2000: no counter in us
    assert wrap_period(np.array([10.0, 4000.0, 20.0])) is None


@pytest.mark.parametrize(
    "change",
    [
        lambda text: b"\xef\xbb\xbf" + text,
        lambda text: text.decode().encode("utf-16"),
        lambda text: b"\n".join(b" \t " + line for line in text.split(b"\n")),
        lambda text: text.replace(b" ", b"\t"),
        lambda text: text.replace(b"\n", b"\r\n"),
    ],
)
def test_what_editors_do_to_logs(tmp_path: Path, change) -> None:  # type: ignore[no-untyped-def]
    path = write(tmp_path / "x.log", *front_log(181, -90, 1.0))
    plain = carmen.load(path)
    path.write_bytes(change(path.read_bytes()))
    changed = carmen.load(path)
    assert carmen.looks_like_log(path)
    np.testing.assert_array_equal(plain.ranges, changed.ranges)
    np.testing.assert_array_equal(plain.odometry, changed.odometry)
    assert changed.notes == ()


def test_decimal_commas_are_refused(tmp_path: Path) -> None:
    lines = [line.replace(".", ",") for line in front_log(181, -90, 1.0)]
    with pytest.raises(
        InputError, match=r"x\.log: numbers are written with decimal commas \(1,5\); write them with po"
    ):
        carmen.load(write(tmp_path / "x.log", *lines))
    odometry = "ODOM 0,5 0,0 0,0 0 0 0 1,0 host 0"
    with pytest.raises(InputError, match="decimal commas"):
        carmen.load(write(tmp_path / "x.log", *front_log(181, -90, 1.0), odometry))


def test_clockwise_lidar(tmp_path: Path) -> None:
    angles = np.radians(np.arange(90.0, -91.0, -2.0))
    lines = [robotlaser(cast(p, angles), angles[0], -math.radians(2), p, float(k)) for k, p in enumerate(drive())]
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    np.testing.assert_allclose(np.degrees(recording.lidar.angles), np.arange(-90, 91, 2), atol=5e-3)
    assert errors(tmp_path / "x.log").max() < 0.001
    assert recording.notes == ("lidar: all scans run clockwise; read from their last beam",)


def test_angles_in_degrees(tmp_path: Path) -> None:
    angles = np.arange(-120.0, 121.0)
    lines = [robotlaser(cast(p, np.radians(angles)), -120, 1.0, p, float(k)) for k, p in enumerate(drive())]
    assert errors(write(tmp_path / "x.log", *lines)).max() < 0.001
    assert "taken as degrees" in carmen.load(tmp_path / "x.log").notes[0]


@pytest.mark.parametrize("turned", [0.0, 0.3])
def test_every_scan_of_a_lidar_of_uneven_speed_is_used(tmp_path: Path, turned: float) -> None:
    """176 to 185 beams a turn; ``turned``: each turn starts at another angle (rad) as well."""
    lines = []
    for k, pose in enumerate(drive(40)):
        beams = 176 + 7 * k % 10
        start, resolution = -math.pi + turned * (k % 7), 2 * math.pi / beams
        ranges = cast(pose, start + resolution * np.arange(float(beams)))
        lines.append(robotlaser(ranges, start, resolution, pose, float(k)))
    path = write(tmp_path / "x.log", *lines)
    recording = carmen.load(path)
    assert len(recording) == 40
    assert 176 <= len(recording.lidar.angles) <= 185
    assert np.ptp(recording.lidar.angles) < 2 * math.pi
    assert (recording.ranges > 0).all()
    # Between beams of one wall the range is a chord's: 2 degrees at a few metres bend it by millimetres.
    assert np.median(errors(path)) < 0.001 and np.quantile(errors(path), 0.99) < 0.05
    assert any("176 to 185 beams" in note for note in recording.notes)


def test_resampling() -> None:
    degrees = np.radians
    grid = degrees(np.array([0.0, 1.0, 2.0, 3.0, 4.0]))
    # Beams at 0.5, 1.5, 2.5 degrees: the first two on one surface, then a jump; nothing near 4 degrees.
    on_grid = resample(np.array([2.0, 2.1, 5.0]), degrees(0.5), degrees(1.0), grid)
    np.testing.assert_allclose(on_grid, [2.0, 2.05, on_grid[2], 5.0, 0.0], atol=1e-6)
    assert on_grid[2] in (2.1, 5.0)
    # No return (0) is not mixed with the wall beside it.
    assert set(resample(np.array([2.0, 0.0, 2.0]), 0.0, degrees(1.1), grid[:4])) <= {0.0, 2.0}
    # Beams twice as far apart as the grid's fill every other angle.
    assert resample(np.array([1.0, 2.0, 3.0]), 0.0, degrees(2.0), grid).tolist() == [1, 0, 2, 0, 3]
    # A whole turn closes: between the last beam at 270 and the first at 360 degrees.
    around = resample(np.array([4.0, 4.1, 4.2, 4.1]), 0.0, math.pi / 2, np.array([-math.pi / 4, math.pi / 4]))
    np.testing.assert_allclose(around, [4.05, 4.05], atol=1e-9)
