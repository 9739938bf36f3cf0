"""Rawlogs written here by MRPT's own layouts (its serializeTo functions), byte by byte."""

import gzip
import math
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import rawlog

START = 1_137_834_225.5  # s since 1970


def packed(name: str, version: int, body: bytes, old: bool = False) -> bytes:
    """An object: header, body, end byte; ``old``: as MRPT before 0.5.5 wrote it."""
    if old:
        return struct.pack("<I", len(name)) + name.encode() + struct.pack("<i", version) + body
    return bytes([0x80 | len(name)]) + name.encode() + bytes([version]) + body + b"\x88"


def ticks(stamp: float | None) -> bytes:
    """100 ns since 1601; 0 is MRPT's invalid time."""
    days = 369 * 365 + 89  # to 1970, with 89 leap days
    return struct.pack("<Q", 0 if stamp is None else round(stamp * 10_000_000) + days * 86_400 * 10_000_000)


def text(words: str) -> bytes:
    return struct.pack("<I", len(words)) + words.encode()


def pose_2d(x: float, y: float, phi: float, version: int = 1, old: bool = False) -> bytes:
    return packed("CPose2D", version, struct.pack("<3d" if version else "<3f", x, y, phi), old)


def rotation(yaw: float, roll: float = 0.0) -> NDArray[np.float64]:
    c, s = math.cos(yaw), math.sin(yaw)
    a, b = math.cos(roll), math.sin(roll)
    return np.array([[c, -s * a, s * b], [s, c * a, -c * b], [0, b, a]])


def matrix(name: str, values: NDArray[np.float64], old: bool = False) -> bytes:
    kind = "<f8" if name == "CMatrixD" else "<f4"
    return packed(name, 0, struct.pack("<II", *values.shape) + values.astype(kind).tobytes(), old)


def pose_3d(
    x: float, y: float, z: float, yaw: float, roll: float = 0.0, version: int = 2, old: bool = False, prefix: str = ""
) -> bytes:
    turn = rotation(yaw, roll)
    if version <= 1:
        whole = np.eye(4)
        whole[:3, :3], whole[:3, 3] = turn, (x, y, z)
        body = matrix("CMatrixD" if version else "CMatrixF", whole, old)
    elif version == 2:
        cy, sy, cr, sr = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(roll / 2), math.sin(roll / 2)
        body = struct.pack("<7d", x, y, z, cy * cr, cy * sr, sy * sr, sy * cr)
    else:
        body = struct.pack("<12d", x, y, z, *turn.reshape(-1))
    return packed(prefix + "CPose3D", version, body, old)


def scan(
    ranges: Sequence[float],
    stamp: float | None,
    version: int = 6,
    aperture: float = math.pi,
    counter_clockwise: bool = True,
    pose: bytes | None = None,
    label: str = "LASER",
    valid: Sequence[int] | None = None,
    name: str = "CObservation2DRangeScan",
    old: bool = False,
) -> bytes:
    n = len(ranges)
    body = struct.pack("<fBf", aperture, counter_clockwise, 80.0) + (pose or pose_3d(0.2, 0.1, 0.5, 0.0, old=old))
    if version < 6:
        body += matrix("CMatrixF", np.zeros((6, 6)), old)
    body += struct.pack(f"<I{n}f", n, *ranges)
    if version >= 1:
        body += bytes(valid or [1] * n)
    if version >= 2:
        body += struct.pack("<f", 0.01)
    if version >= 3:
        body += ticks(stamp)
    if version >= 4:
        body += struct.pack("<f", 0.004)
    if version >= 5:
        body += text(label) + struct.pack("<d", 0.0)
    if version >= 7:
        body += b"\x01" + struct.pack(f"<{n}i", *range(n))
    if version >= 8:
        body += struct.pack("<f", 0.025)
    return packed(name, version, body, old)


def odometry(x: float, y: float, phi: float, stamp: float, version: int = 2, prefix: str = "") -> bytes:
    body = pose_2d(x, y, phi) + text("ODOMETRY") + ticks(stamp)
    if version == 1:
        body += b"\x00" + struct.pack("<ii", 0, 0) + b"\x01" + struct.pack("<ff", 0.5, 0.1)
    if version == 2:
        body += b"\x01" + struct.pack("<ii", 3, 4) + b"\x01" + struct.pack("<ddd", 0.5, 0.0, 0.1)
    return packed(prefix + "CObservationOdometry", version, body)


def movement(x: float, y: float, phi: float, version: int = 6, old: bool = False) -> bytes:
    """A CActionRobotMovement2D by odometry."""
    velocities = b"\x00" + (b"" if version >= 7 else struct.pack("<ff", 0, 0))
    encoders = b"\x00" + (b"" if version >= 7 else struct.pack("<ii", 0, 0))
    if version < 2:
        density = packed("CPosePDFGaussian", 1, pose_2d(x, y, phi, 0, old) + struct.pack("<6f", *[0.1] * 6), old)
        body = density + struct.pack("<i", 0) + (velocities + encoders if version else b"")
        return packed("CActionRobotMovement2D", version, body, old)
    model = {
        2: bytes(44),
        3: struct.pack("<i5fi4f", 0, *[0.1] * 5, 300, *[0.1] * 4),
        4: struct.pack("<i6fi4f", 0, *[0.1] * 6, 300, *[0.1] * 4),
    }.get(version, struct.pack("<i6fi6f", 0, *[0.1] * 6, 300, *[0.1] * 6))
    stamp = ticks(None) if version >= 6 else b""
    body = struct.pack("<i", 0) + pose_2d(x, y, phi, old=old) + model + velocities + encoders + stamp
    return packed("CActionRobotMovement2D", version, body, old)


def matched(x: float, y: float, phi: float) -> bytes:
    """A CActionRobotMovement2D by scan matching, a Gaussian."""
    density = packed("CPosePDFGaussian", 2, pose_2d(x, y, phi) + struct.pack("<6d", *[0.1] * 6))
    body = struct.pack("<i", 1) + density + b"\x00" + struct.pack("<ff", 0, 0) + b"\x00" + struct.pack("<ii", 0, 0)
    return packed("CActionRobotMovement2D", 6, body + ticks(None))


def actions(*items: bytes, old: bool = False) -> bytes:
    return packed("CActionCollection", 0, struct.pack("<I", len(items)) + b"".join(items), old)


def frame(*items: bytes, old: bool = False) -> bytes:
    return packed("CSensoryFrame", 2, struct.pack("<I", len(items)) + b"".join(items), old)


def write(path: Path, *items: bytes) -> Path:
    path.write_bytes(b"".join(items))
    return path


RANGES = [1.0, 2.0, 3.0, 4.0, 5.0]


def shifted(k: float) -> list[float]:
    return [r + 0.25 * k for r in RANGES]


def test_frames_with_movements(tmp_path: Path) -> None:
    """Two steps of 0.5 m with a quarter turn between; beams without a valid range have no return."""
    path = write(
        tmp_path / "x.rawlog",
        frame(scan(RANGES, START, valid=[1, 0, 1, 1, 1])),
        actions(movement(0.5, 0.0, math.pi / 2)),
        frame(scan(shifted(1), START + 0.1)),
        actions(movement(0.5, 0.0, 0.0)),
        frame(scan(shifted(2), START + 0.2)),
    )
    assert rawlog.claims(path) and rawlog.looks_like(path)
    recording = rawlog.load(path)
    assert (recording.name, recording.format, recording.notes) == ("x", "rawlog", ())
    np.testing.assert_allclose(recording.stamps, [START, START + 0.1, START + 0.2], atol=1e-6)
    np.testing.assert_allclose(
        recording.odometry, [[0.0, 0.0, 0.0], [0.5, 0.0, math.pi / 2], [0.5, 0.0, 0.0]], atol=1e-9
    )
    np.testing.assert_allclose(recording.dead_reckoning()[2], [0.5, 0.5, math.pi / 2], atol=1e-9)
    assert recording.ranges.tolist() == [[1, 0, 3, 4, 5], shifted(1), shifted(2)]
    np.testing.assert_allclose(np.degrees(recording.lidar.angles), [-90, -45, 0, 45, 90], atol=1e-4)
    np.testing.assert_allclose(recording.lidar.pose, [0.2, 0.1, 0.0], atol=1e-6)
    assert (recording.lidar.height, recording.lidar.range_max) == (0.5, 80.0)


def test_observations_one_after_the_other(tmp_path: Path) -> None:
    items = [odometry(k, 0.0, 0.0, START + k) for k in range(4)]
    items += [scan(RANGES, START + t) for t in (0.5, 1.0, 2.25)]
    path = write(tmp_path / "x.rawlog", *items)
    recording = rawlog.load(path)
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 0.5, 1.25], atol=1e-6)
    assert [(s.name, len(s.stamps)) for s in recording.streams] == [("lidar", 3), ("odometry", 4)]
    packed_path = tmp_path / "y.rawlog.gz"
    packed_path.write_bytes(gzip.compress(path.read_bytes()))
    assert rawlog.claims(packed_path) and rawlog.looks_like(packed_path)
    assert rawlog.load(packed_path).name == "y"
    np.testing.assert_array_equal(rawlog.load(packed_path).ranges, recording.ranges)


@pytest.mark.parametrize("version", range(9))
def test_every_version_of_a_scan(tmp_path: Path, version: int) -> None:
    items = [scan(shifted(k), START + k, version) for k in range(3)]
    recording = rawlog.load(write(tmp_path / "x.rawlog", *items))
    assert recording.ranges.tolist() == [shifted(k) for k in range(3)]
    assert any("no time stamps" in note for note in recording.notes) == (version < 3)
    np.testing.assert_allclose(recording.times, np.arange(3) * (1.0 if version >= 3 else 0.1), atol=1e-6)


@pytest.mark.parametrize("version", range(8))
def test_every_version_of_a_movement(tmp_path: Path, version: int) -> None:
    items = [frame(scan(RANGES, START)), actions(movement(0.25, 0.5, 0.125, version)), frame(scan(RANGES, START + 1))]
    recording = rawlog.load(write(tmp_path / "x.rawlog", *items))
    np.testing.assert_allclose(recording.odometry[1], [0.25, 0.5, 0.125], atol=1e-9)
    assert not any("could not be read" in note for note in recording.notes)


@pytest.mark.parametrize("version", range(3))
def test_every_version_of_odometry(tmp_path: Path, version: int) -> None:
    items = [odometry(k, 0.0, 0.0, START + k, version) + scan(RANGES, START + k) for k in range(3)]
    np.testing.assert_allclose(rawlog.load(write(tmp_path / "x.rawlog", *items)).odometry[:, 0], [0, 1, 1], atol=1e-6)


@pytest.mark.parametrize("version", range(4))
@pytest.mark.parametrize("roll", [0.0, math.pi])
def test_where_the_lidar_sits(tmp_path: Path, version: int, roll: float) -> None:
    """Upside down, the beams run the other way round."""
    pose = pose_3d(-0.3, 0.0, 0.4, 2.5, roll, version)
    recording = rawlog.load(
        write(tmp_path / "x.rawlog", scan(RANGES, START, pose=pose), scan(RANGES, START + 1, pose=pose))
    )
    np.testing.assert_allclose(recording.lidar.pose, [-0.3, 0, 2.5], atol=1e-6)
    assert recording.ranges[0].tolist() == (RANGES[::-1] if roll else RANGES)
    clockwise = [scan(RANGES, START + k, pose=pose, counter_clockwise=False) for k in range(2)]
    assert rawlog.load(write(tmp_path / "x.rawlog", *clockwise)).ranges[0].tolist() == (
        RANGES if roll else RANGES[::-1]
    )


def test_names_with_namespaces_and_the_oldest_headers(tmp_path: Path) -> None:
    pose = pose_3d(0.2, 0.1, 0.5, 0.0, version=3, prefix="mrpt::poses::")
    new = [
        odometry(k, 0.0, 0.0, START + k, prefix="mrpt::obs::")
        + scan(RANGES, START + k, 8, pose=pose, name="mrpt::obs::CObservation2DRangeScan")
        for k in range(3)
    ]
    np.testing.assert_allclose(rawlog.load(write(tmp_path / "x.rawlog", *new)).odometry[:, 0], [0, 1, 1], atol=1e-6)
    old = [
        item
        for k in range(3)
        for item in (
            actions(movement(0.5, 0.0, 0.0, 1, old=True), old=True),
            frame(scan(shifted(k), START + k, 3, pose=pose_3d(0, 0, 0, 0, version=0, old=True), old=True), old=True),
        )
    ]
    path = write(tmp_path / "x.rawlog", *old)
    assert rawlog.looks_like(path)
    recording = rawlog.load(path)
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 0.5, 0.5], atol=1e-6)
    assert recording.ranges.tolist() == [shifted(k) for k in range(3)]


def test_odometry_goes_before_scan_matching_within_a_collection(tmp_path: Path) -> None:
    both = actions(matched(0.9, 0.0, 0.0), movement(0.5, 0.0, 0.0))
    items = [frame(scan(RANGES, START)), both, frame(scan(RANGES, START + 1)), actions(matched(0.9, 0.0, 0.0))]
    recording = rawlog.load(write(tmp_path / "x.rawlog", *items, frame(scan(RANGES, START + 2))))
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 0.5, 0.9], atol=1e-9)


def test_unknown_objects_are_stepped_over_and_named(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    camera = packed("CObservationImage", 4, rng.integers(0, 256, 5000, dtype=np.uint8).tobytes())
    odd = packed("CActionRobotMovement2D", 6, struct.pack("<i", 1) + packed("CPosePDFGrid", 0, bytes(40)) + bytes(30))
    items = [frame(scan(RANGES, START + k), camera) + actions(movement(0.5, 0, 0)) for k in range(3)]
    path = write(tmp_path / "x.rawlog", *items, actions(odd), frame(scan(RANGES, START + 3))[:-10])
    recording = rawlog.load(path)
    assert len(recording) == 3
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 0.5, 0.5], atol=1e-9)
    assert recording.notes == (
        "2 objects could not be read and are left out (1 movements given as CPosePDFGrid, 1 cut short)",
        "not used: 3 CObservationImage",
    )


def test_the_label_with_most_scans_and_level_ones_are_taken(tmp_path: Path) -> None:
    tilted = pose_3d(0, 0, 0, 0, roll=0.6)
    items = [scan(shifted(k), START + k, label="FRONT") for k in range(4)]
    items += [scan(RANGES, START + k + 0.5, label="REAR") for k in range(3)]
    items += [scan(RANGES, START + k + 0.5, label="DOWN", pose=tilted) for k in range(9)]
    recording = rawlog.load(write(tmp_path / "x.rawlog", *items))
    assert recording.ranges.tolist() == [shifted(k) for k in range(4)]
    assert any("9 scans of a tilted scanner left out" in note for note in recording.notes)
    assert any("3 scans of 'REAR' are not used" in note for note in recording.notes)
    assert any("odometry: the log holds none" in note for note in recording.notes)
    with pytest.raises(InputError, match="tilted"):
        rawlog.load(write(tmp_path / "x.rawlog", scan(RANGES, START, pose=tilted)))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (lambda: b"", "empty"),
        (lambda: b"FLASER 180 1.0 1.0", "not a rawlog"),
        (lambda: packed("CObservationImage", 4, bytes(9)), r"no laser scans .*; it has 1 CObservationImage"),
        (lambda: gzip.compress(frame(scan(RANGES, START)))[:-30], "damaged or only half downloaded"),
        (lambda: b"\x1f\x8b" + bytes(30), "damaged or only half downloaded"),
        (lambda: scan(RANGES, START, aperture=99.0), "no laser scans"),
    ],
)
def test_what_cannot_be_used(tmp_path: Path, content: Callable[[], bytes], message: str) -> None:
    path = write(tmp_path / "x.rawlog", content())
    with pytest.raises(InputError, match=message) as caught:
        rawlog.load(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_what_is_no_rawlog(tmp_path: Path) -> None:
    assert not rawlog.claims(Path("x.log")) and not rawlog.claims(Path("rawlog.gz"))
    assert not rawlog.looks_like(write(tmp_path / "x.rawlog", b"hello, world"))
    assert not rawlog.looks_like(tmp_path / "missing.rawlog")
    with pytest.raises(InputError, match="no such file"):
        rawlog.load(tmp_path / "missing.rawlog")


def test_a_drive_comes_back_as_it_was_written(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    steps = np.vstack([np.zeros(3), rng.normal(0, 0.2, (50, 3))])
    ranges = rng.uniform(0.5, 20.0, (51, 181)).astype(np.float32)
    items = [
        actions(movement(*steps[k])) + frame(scan(ranges[k].tolist(), START + 0.1 * k, pose=pose_3d(0, 0, 0, 0)))
        for k in range(51)
    ]
    recording = rawlog.load(write(tmp_path / "x.rawlog", *items))
    np.testing.assert_array_equal(recording.ranges, ranges)
    np.testing.assert_allclose(recording.dead_reckoning(), geometry.accumulate(steps), atol=1e-9)
