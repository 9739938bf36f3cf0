import bz2
import gzip
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import carmen

Numbers = Sequence[float] | NDArray[np.float64]


def flaser(ranges: Numbers, odometry: Numbers, stamp: float, laser: Sequence[float] = (0, 0, 0)) -> str:
    numbers = " ".join(f"{r:.2f}" for r in ranges)
    poses = " ".join(f"{v:f}" for v in (*laser, *odometry))
    return f"FLASER {len(ranges)} {numbers} {poses} {stamp:f} host {stamp + 0.5:f}"


def robotlaser(
    ranges: Sequence[float],
    laser: Sequence[float],
    robot: Sequence[float],
    stamp: float,
    start: float = -math.pi / 2,
    resolution: float = math.pi / 4,
    remissions: Sequence[int] = (),
) -> str:
    head = f"ROBOTLASER1 0 {start:f} 3.141593 {resolution:f} 81.900000 0.010000 0 {len(ranges)}"
    numbers = " ".join(f"{r:.3f}" for r in ranges)
    poses = " ".join(f"{v:f}" for v in (*laser, *robot))
    tail = f"{len(remissions)} {' '.join(str(e) for e in remissions)}".strip()
    return f"{head} {numbers} {tail} {poses} 0.1 0.2 0.3 0.4 0.5 {stamp:f} host 0.1"


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


BEAMS = np.linspace(1.0, 2.79, 180).round(2).tolist()


def test_flaser(tmp_path: Path) -> None:
    path = write(
        tmp_path / "x.log",
        "# a comment",
        "PARAM robot_frontlaser_offset 0.25 0.0 host 0.0",
        "PARAM robot_use_laser on 0.0 host 0.0",
        "ODOM 9 9 9 0 0 0 10.0 host 0.0",
        flaser(BEAMS, (1, 1, math.pi / 2), 10.0),
        flaser([r + 1 for r in BEAMS], (1, 3, math.pi), 10.5),
    )
    recording = carmen.load(path)
    assert (recording.name, recording.format, len(recording)) == ("x", "carmen", 2)
    assert recording.stamps.tolist() == [10.0, 10.5]
    np.testing.assert_allclose(recording.ranges[1], np.array(BEAMS) + 1, rtol=1e-6)
    # From (1, 1) facing +y to (1, 3) facing -x: two metres ahead and a left turn of 90 degrees.
    np.testing.assert_allclose(recording.odometry, [[0.0, 0, 0], [2, 0, math.pi / 2]], atol=1e-6)
    assert recording.lidar.pose.tolist() == [0.25, 0, 0]
    np.testing.assert_allclose(np.degrees(recording.lidar.angles), np.arange(-90, 90), atol=1e-9)
    assert recording.lidar.range_max == 80.0
    assert recording.notes == ()
    assert [(stream.name, len(stream.stamps)) for stream in recording.streams] == [("lidar", 2), ("odometry", 1)]


@pytest.mark.parametrize(
    ("beams", "first", "last"), [(180, -90, 89), (181, -90, 90), (360, -90, 89.5), (361, -90, 90), (5, -90, 90)]
)
def test_angles_by_the_number_of_beams(tmp_path: Path, beams: int, first: float, last: float) -> None:
    angles = carmen.load(write(tmp_path / "x.log", flaser([1.0] * beams, (0, 0, 0), 1.0))).lidar.angles
    assert len(angles) == beams
    np.testing.assert_allclose(np.degrees(angles[[0, -1]]), [first, last], atol=1e-9)


def test_robotlaser(tmp_path: Path) -> None:
    path = write(
        tmp_path / "x.clf",
        robotlaser([1, 2, 3, 4, 81.91], (0.2, 0, 0), (0, 0, 0), 5.0),
        robotlaser([2, 3, 4, 5, 81.83], (1, 0.2, math.pi / 2), (1, 0, math.pi / 2), 6.0, remissions=[7, 8, 9]),
    )
    recording = carmen.load(path)
    np.testing.assert_allclose(recording.ranges[:, :4], [[1, 2, 3, 4], [2, 3, 4, 5]])
    assert (recording.ranges[:, 4] > recording.lidar.range_max).all()
    np.testing.assert_allclose(recording.lidar.pose, [0.2, 0, 0], atol=1e-9)
    np.testing.assert_allclose(recording.lidar.angles, np.radians([-90, -45, 0, 45, 90]), atol=1e-5)
    np.testing.assert_allclose(recording.odometry[1], [1, 0, math.pi / 2], atol=1e-6)


def test_scans_of_180_and_181_beams(tmp_path: Path) -> None:
    path = write(tmp_path / "x.log", flaser(BEAMS, (0, 0, 0), 1.0), flaser([*BEAMS, 7.0], (0, 0, 0), 2.0))
    recording = carmen.load(path)
    assert recording.ranges.shape == (2, 181)
    np.testing.assert_allclose(recording.ranges[:, 180], [0.0, 7.0])
    np.testing.assert_allclose(recording.ranges[0, :180], recording.ranges[1, :180])
    assert any("180 or 181 beams" in note for note in recording.notes)


def test_interlaced_scans_share_one_grid(tmp_path: Path) -> None:
    step, start = math.radians(1), -math.pi / 2
    path = write(
        tmp_path / "x.log",
        robotlaser([1, 2, 3], (0, 0, 0), (0, 0, 0), 1.0, start, step),
        robotlaser([4, 5], (0, 0, 0), (0, 0, 0), 2.0, start + step / 2, step),
    )
    recording = carmen.load(path)
    np.testing.assert_allclose(recording.ranges, [[1, 0, 2, 0, 3], [0, 4, 0, 5, 0]])
    np.testing.assert_allclose(np.degrees(recording.lidar.angles), [-90, -89.5, -89, -88.5, -88], atol=1e-3)
    assert any("interlaced at 1/2" in note for note in recording.notes)


def test_scan_of_another_resolution_is_brought_to_the_grid_of_most(tmp_path: Path) -> None:
    lines = [flaser([1.0] * 180, (k, 0, 0), k) for k in range(4)]
    finer = flaser(np.linspace(2.0, 5.6, 361).round(2), (4, 0, 0), 4.0)  # 0.5 degrees apart: every other beam
    recording = carmen.load(write(tmp_path / "x.log", *lines, finer, flaser([1.0] * 180, (5, 0, 0), 5.0)))
    assert recording.stamps.tolist() == [0, 1, 2, 3, 4, 5]
    np.testing.assert_allclose(recording.ranges[4], np.linspace(2.0, 5.58, 180), atol=1e-6)
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 1, 1, 1, 1, 1])
    assert any("1 scans with other beam angles" in note for note in recording.notes)


def test_scans_with_impossible_angles_are_left_out(tmp_path: Path) -> None:
    good = [robotlaser([1, 2], (0, 0, 0), (k, 0, 0), k) for k in range(3)]
    bad = [
        robotlaser([1, 2], (0, 0, 0), (9, 0, 0), 1.5, start=start, resolution=resolution)
        for start, resolution in ((math.nan, 0.1), (0.0, 0.0), (1e6, 0.1), (0.0, 9.0))
    ]
    recording = carmen.load(write(tmp_path / "x.log", *good, *bad))
    assert recording.stamps.tolist() == [0, 1, 2]
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 1, 1])
    with pytest.raises(InputError, match="no scan has usable beam angles"):
        carmen.load(write(tmp_path / "x.log", *bad))


def test_scans_are_sorted_and_their_odometry_with_them(tmp_path: Path) -> None:
    lines = [flaser(np.full(180, t + 1.0), (t, 0, 0), t) for t in (0.0, 2.0, 1.0, 3.0)]
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    assert recording.stamps.tolist() == [0, 1, 2, 3]
    assert len(recording.notes) == 1
    assert recording.ranges[:, 0].tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 1, 1, 1])
    assert any("backwards 1 times" in note for note in recording.notes)


def test_stamps_that_scramble_the_odometry_are_noted(tmp_path: Path) -> None:
    # The robot went 0, 1, 2, 3 m; by its stamps it went 0, 2, 1, 3 m: five metres.
    lines = [flaser([1.0] * 180, (x, 0, 0), t) for x, t in ((0, 0.0), (1, 2.0), (2, 1.0), (3, 3.0))]
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 2, -1, 2])
    assert any("3 m in the order of the lines and 5 m by time stamp" in note for note in recording.notes)


def test_repeated_stamps(tmp_path: Path) -> None:
    first, other = flaser([1.0] * 180, (0, 0, 0), 1.0), flaser([2.0] * 180, (1, 0, 0), 1.0)
    recording = carmen.load(write(tmp_path / "x.log", first, first, other, flaser([3.0] * 180, (2, 0, 0), 2.0)))
    assert recording.stamps.tolist() == [1.0, 1.5, 2.0]
    assert recording.ranges[:, 0].tolist() == [1, 2, 3]
    assert len(recording.notes) == 2


def test_no_odometry_in_the_scans_but_in_odom_lines(tmp_path: Path) -> None:
    lines = [f"ODOM {t} 0 0 0 0 0 {t} host 0" for t in range(4)]
    lines += [flaser([1.0] * 180, (0, 0, 0), t) for t in (0.5, 1.0, 2.25)]
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 0.5, 1.25])


@pytest.mark.parametrize(
    ("lines", "limit"),
    [
        ([flaser([1.0] * 90 + [81.83] * 90, (0, 0, 0), 1)], 80.0),
        (["PARAM robot_front_laser_max 40.5 0 h 0", flaser([1.0] * 180, (0, 0, 0), 1)], 40.5),
        (["PARAM robot_front_laser_max 81.9 0 h 0", flaser([1.0] * 180, (0, 0, 0), 1)], 80.0),
        ([flaser([1.0] * 150 + [30.0, 45.0, 49.9] + [50.0] * 27, (0, 0, 0), 1)], 80.0),  # cut: told in a drive
        ([flaser([25.0, 24.5, 24.0] * 60, (0, 0, 0), 1)], 80.0),  # a hall with a far wall: nothing is cut
        ([flaser([2.0] * 180, (0, 0, 0), 1)], 80.0),
    ],
)
def test_range_limit(tmp_path: Path, lines: list[str], limit: float) -> None:
    assert carmen.load(write(tmp_path / "x.log", *lines)).lidar.range_max == pytest.approx(limit)


def test_ranges_that_are_no_numbers(tmp_path: Path) -> None:
    line = flaser([1.0] * 180, (0, 0, 0), 1.0).replace("180 1.00 1.00", "180 nan inf")
    recording = carmen.load(write(tmp_path / "x.log", line))
    assert recording.ranges[0, :3].tolist() == [0, 0, 1]
    assert any("2 ranges" in note for note in recording.notes)


def test_odometry_that_is_no_number_is_held(tmp_path: Path) -> None:
    lines = [flaser([1.0] * 180, (x, 0, 0), k) for k, x in enumerate((1.0, math.nan, 3.0))]
    recording = carmen.load(write(tmp_path / "x.log", *lines))
    np.testing.assert_allclose(recording.odometry[:, 0], [0, 0, 2])


def test_broken_lines_are_left_out(tmp_path: Path) -> None:
    good = [flaser(BEAMS, (t, 0, 0), t) for t in range(3)]
    broken = ["FLASER 180 1.00 2.00", "FLASER", "FLASER x y z", good[0][:400], good[1].replace("1.05", "1.x5")]
    recording = carmen.load(write(tmp_path / "x.log", good[0], *broken, *good[1:]))
    assert recording.stamps.tolist() == [0, 1, 2]
    np.testing.assert_allclose(recording.ranges, np.tile(np.array(BEAMS, dtype=np.float32), (3, 1)))
    assert recording.notes[0].startswith("5 lines could not be read")


def test_quick_and_careful_parsing_agree(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    lines = [flaser(rng.uniform(0, 90, 180), rng.normal(size=3), k) for k in range(20)]
    quick = carmen.load(write(tmp_path / "quick.log", *lines))
    careful = carmen.load(write(tmp_path / "careful.log", *lines, "FLASER 1 broken"))
    spaced = carmen.load(write(tmp_path / "spaced.log", *(line.replace(" ", "  ") for line in lines)))
    for other in (careful, spaced):
        np.testing.assert_array_equal(quick.ranges, other.ranges)
        np.testing.assert_array_equal(quick.odometry, other.odometry)


def test_gmapping_readings(tmp_path: Path) -> None:
    reading = "LASER_READING 5 1 2 3 4 5 1.5 2.5 0.5 9.25"
    recording = carmen.load(
        write(tmp_path / "x.gfs", "ODOM 1.5 2.5 0.5 9.25", reading, reading.replace("9.25", "9.75"))
    )
    assert recording.stamps.tolist() == [9.25, 9.75]
    assert recording.ranges[0].tolist() == [1, 2, 3, 4, 5]


def test_the_type_with_most_scans_is_taken(tmp_path: Path) -> None:
    lines = [flaser([1.0] * 180, (0, 0, 0), k) for k in range(3)]
    recording = carmen.load(write(tmp_path / "x.log", *lines, robotlaser([1, 2, 3, 4, 5], (0, 0, 0), (0, 0, 0), 1.0)))
    assert len(recording) == 3
    assert any("1 ROBOTLASER1 lines are not used" in note for note in recording.notes)


def test_relations_beside(tmp_path: Path) -> None:
    path = write(tmp_path / "x.clf.gz", "")
    path.write_bytes(gzip.compress((flaser(BEAMS, (0, 0, 0), 1.0) + "\n").encode()))
    write(tmp_path / "x.relations", "1.0 2.0 3.0 4.0 0.0 0.0 0.0 0.5", "2.0 3.0 1.0 0.0 0.0 0.0 0.0 -0.5")
    relations = carmen.load(path).relations
    assert relations is not None
    assert relations.start.tolist() == [1, 2] and relations.end.tolist() == [2, 3]
    assert relations.poses.tolist() == [[3, 4, 0.5], [1, 0, -0.5]]
    write(tmp_path / "x.relations", "1 2 3")
    recording = carmen.load(path)
    assert recording.relations is None and "damaged" in recording.notes[-1]


@pytest.mark.parametrize("suffix", [".log", ".clf", ".gfs"])
@pytest.mark.parametrize("packer", ["", ".gz", ".bz2"])
def test_suffixes(tmp_path: Path, suffix: str, packer: str) -> None:
    packers: dict[str, Callable[[bytes], bytes]] = {"": bytes, ".gz": gzip.compress, ".bz2": bz2.compress}
    pack = packers[packer]
    path = tmp_path / f"a.b{suffix}{packer}"
    path.write_bytes(pack((flaser(BEAMS, (0, 0, 0), 1.0) + "\r\n").encode()))
    assert carmen.is_log(path) and carmen.looks_like_log(path)
    assert carmen.load(path).name == "a.b"


def test_what_is_not_a_log(tmp_path: Path) -> None:
    assert not carmen.is_log(Path("x.txt")) and not carmen.is_log(Path("x.gz")) and not carmen.is_log(Path("log"))
    assert not carmen.looks_like_log(write(tmp_path / "x.log", "[12:00] INFO hello"))
    assert not carmen.looks_like_log(tmp_path / "missing.log")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.99])
@pytest.mark.parametrize("packer", [".gz", ".bz2"])
def test_half_downloaded(tmp_path: Path, packer: str, share: float) -> None:
    text = "\n".join(flaser(np.random.default_rng(k).uniform(1, 9, 180), (k, 0, 0), k) for k in range(50)).encode()
    content = gzip.compress(text) if packer == ".gz" else bz2.compress(text)
    path = tmp_path / f"x.clf{packer}"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=r"x\.clf\.\w+: damaged or only half downloaded") as caught:
        carmen.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("x.log", b"", "empty"),
        ("x.log", b" \n\n", "empty"),
        ("x.log", b"ODOM 0 0 0 0 0 0 1 h 1\n", "holds no scans"),
        ("x.log", b"FLASER 3 1 2\n", "holds no scans"),
        ("x.clf.bz2", b"<html>", r"not a \.bz2 file"),
        ("x.clf.bz2", b"BZh9" + b"\0" * 50, "damaged"),
        ("x.clf.gz", b"\x1f\x8b" + b"\0" * 50, "damaged"),
        ("x.log", b"FLASER 1 2 0 0 0 0 0 0 nan h 0\n", "no scan has a valid time stamp"),
    ],
)
def test_files_that_cannot_be_used(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        carmen.load(path)
    assert str(path) in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"x\.log: no such file"):
        carmen.load(tmp_path / "x.log")


@pytest.mark.parametrize(
    ("name", "shape", "span", "path", "none", "mount", "limit"),
    [
        ("intel", (13631, 180), 2691, 661, 81.83, 0.0, 80.0),
        ("fr079", (4934, 360), 1061, 392, 81.91, -0.04, 80.99),
    ],
)
def test_real_logs_against_the_published_table(
    shared_data: Path,
    name: str,
    shape: tuple[int, int],
    span: float,
    path: float,
    none: float,
    mount: float,
    limit: float,
) -> None:
    recording = carmen.load(shared_data / "carmen" / f"{name}.clf.bz2")
    assert recording.ranges.shape == shape
    assert recording.duration == pytest.approx(span, abs=1)
    assert geometry.path_length(recording.dead_reckoning()) == pytest.approx(path, abs=1)
    assert recording.lidar.range_max == limit < none
    assert recording.lidar.pose.tolist() == [mount, 0, 0]
    # 81.83 or 81.91 is all that lies beyond the limit.
    beyond = recording.ranges[recording.ranges > recording.lidar.range_max]
    assert np.unique(beyond).tolist() == pytest.approx([none])
    assert recording.relations is not None
    ends = np.concatenate([recording.relations.start, recording.relations.end])
    assert np.isin(ends.round(5), recording.stamps.round(5)).all()
