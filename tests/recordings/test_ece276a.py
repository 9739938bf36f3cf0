import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.config import load_robot
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import ece276a
from pfslam_viz.robot import LidarMount
from pfslam_viz.settings import ScanConfig
from pfslam_viz.slam.scan_reader import ScanReader

# As in conftest's tiny_set: ten ticks of pi * 0.254 / 360 m forty times a second, on a circle.
SPEED = 10 * np.pi * 0.254 / 360 * 40
TURN_RATE = 0.5

WriteSet = Callable[..., Path]


def test_streams_come_to_the_lidar_stamps(write_set: WriteSet) -> None:
    recording = ece276a.load(write_set())
    assert (len(recording), recording.ranges.shape) == (11, (11, 3)) and recording.ranges.dtype == np.float32
    np.testing.assert_allclose(recording.ranges[2], [1.002, 2.002, 40.002], rtol=1e-6)
    np.testing.assert_allclose(recording.lidar.angles, [-0.5, 0.0, 0.5])
    assert (recording.lidar.range_min, recording.lidar.range_max) == (0.1, 30.0)
    np.testing.assert_allclose(recording.lidar.pose, [0.29833, 0, 0])
    assert recording.lidar.height == pytest.approx(0.51435 + 0.127)
    assert recording.notes == ()
    # Driving a circle: after t s the robot is at r (sin wt, 1 - cos wt), heading wt, with r = v / w.
    t, radius = recording.times, SPEED / TURN_RATE
    expected = np.stack([radius * np.sin(TURN_RATE * t), radius * (1 - np.cos(TURN_RATE * t)), TURN_RATE * t], axis=1)
    np.testing.assert_allclose(recording.dead_reckoning(), expected, atol=1e-9)
    assert recording.odometry[0].tolist() == [0, 0, 0]


def test_another_robot_has_other_wheels(write_set: WriteSet) -> None:
    robot = load_robot().model_copy(update={"wheel_diameter": 0.508})
    folder = write_set()
    assert geometry.path_length(ece276a.load(folder, robot=robot).dead_reckoning()) == pytest.approx(
        2 * geometry.path_length(ece276a.load(folder).dead_reckoning()), rel=1e-9
    )


@pytest.mark.parametrize("where", ["", "data"])
@pytest.mark.parametrize("images", ["beside", "above", "two above"])
def test_folder_layouts(write_set: WriteSet, tmp_path: Path, where: str, images: str) -> None:
    top = tmp_path / "a" / "b" / "c"
    stamps = 1000.5 + np.arange(4) / 30
    folder = write_set(top / where, Kinect={"rgb_time_stamps": stamps, "disparity_time_stamps": stamps[:3] + 0.01})
    place = {"beside": folder, "above": folder.parent, "two above": folder.parent.parent}[images]
    for path in ("RGB7/rgb7_1.png", "RGB7/rgb7_4.png", "RGB7/rgb7_5.png", "Disparity7/disparity7_2.png"):
        (place / "dataRGBD" / path).parent.mkdir(parents=True, exist_ok=True)
        (place / "dataRGBD" / path).touch()
    recording = ece276a.load(top)
    assert recording.frames is not None
    rgb = place / "dataRGBD" / "RGB7"
    assert recording.frames.color_paths == (rgb / "rgb7_1.png", None, None, rgb / "rgb7_4.png")
    assert recording.frames.disparity_paths == (None, place / "dataRGBD/Disparity7/disparity7_2.png", None)
    np.testing.assert_allclose(recording.frames.color_stamps, stamps)
    assert recording.frames.camera.position[2] == pytest.approx(0.38001 + 0.127)
    assert recording.frames.camera.pitch == pytest.approx(0.36)
    assert any("2 of 4 colour" in note for note in recording.notes)
    assert any("1 images in RGB7 have no time stamp" in note for note in recording.notes)


def test_stamps_without_images_are_noted(write_set: WriteSet) -> None:
    stamps = 1000.5 + np.arange(4) / 30
    recording = ece276a.load(write_set(Kinect={"rgb_time_stamps": stamps, "disparity_time_stamps": stamps}))
    assert recording.frames is None
    assert any("no images" in note for note in recording.notes)
    assert {s.name for s in recording.streams} == {"lidar", "encoders", "IMU", "colour frames", "disparity frames"}


def test_frames_run_backwards_with_their_images(write_set: WriteSet, tmp_path: Path) -> None:
    folder = write_set(Kinect={"rgb_time_stamps": [1000.9, 1000.6], "disparity_time_stamps": [1000.6]})
    for k in (1, 2):
        path = folder / f"dataRGBD/RGB7/rgb7_{k}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    frames = ece276a.load(folder).frames
    assert frames is not None
    assert frames.color_stamps.tolist() == [1000.6, 1000.9]
    assert [path.name for path in frames.color_paths if path] == ["rgb7_2.png", "rgb7_1.png"]


def test_several_sets_in_one_folder(write_set: WriteSet, tmp_path: Path) -> None:
    write_set(number=7)
    write_set(number=12, Imu=None)
    assert ece276a.sets_in(tmp_path) == {"7": {"Encoders", "Hokuyo", "Imu"}, "12": {"Encoders", "Hokuyo"}}
    assert ece276a.load(tmp_path, 7).name == "7"
    assert ece276a.load(tmp_path / "Hokuyo7.npz").name == "7"
    with pytest.raises(InputError, match=r"holds the sets 7, 12; choose one"):
        ece276a.load(tmp_path)
    with pytest.raises(InputError, match=r"set 12 lacks Imu12\.npz"):
        ece276a.load(tmp_path, 12)
    with pytest.raises(InputError, match="holds no file of set 8"):
        ece276a.load(tmp_path, 8)


def test_truth_beside(write_set: WriteSet) -> None:
    folder = write_set()
    poses = np.arange(12.0).reshape(4, 3) / 10
    np.savez(folder / "ground_truth.npz", time_stamps=1000 + np.arange(4.0), pose=poses, walls=np.zeros((1, 4)))
    truth = ece276a.load(folder).truth
    assert truth is not None
    np.testing.assert_allclose(truth.at(np.array([1001.5]))[0], [0.45, 0.55, 0.65])


def test_truth_of_another_time_or_damaged_is_left_out(write_set: WriteSet) -> None:
    folder = write_set()
    np.savez(folder / "ground_truth.npz", time_stamps=np.arange(4.0), pose=np.zeros((4, 3)))
    recording = ece276a.load(folder)
    assert recording.truth is None and "does not overlap" in recording.notes[-1]
    (folder / "ground_truth.npz").write_bytes(b"PK\3\4 nothing")
    recording = ece276a.load(folder)
    assert recording.truth is None and "truth: left out" in recording.notes[-1]


def _rewrite(folder: Path, kind: str, change: Callable[[dict[str, Any]], None]) -> None:
    path = folder / f"{kind}7.npz"
    with np.load(path) as archive:
        arrays = dict(archive)
    change(arrays)
    np.savez(path, **arrays)


def test_arrays_stored_the_other_way_round(write_set: WriteSet) -> None:
    folder = write_set()
    plain = ece276a.load(folder)

    def turn(arrays: dict[str, Any]) -> None:
        for key, value in arrays.items():
            arrays[key] = value.T if value.ndim == 2 else value[:, None] if value.ndim == 1 else value

    for kind in ece276a.REQUIRED:
        _rewrite(folder, kind, turn)
    turned = ece276a.load(folder)
    np.testing.assert_array_equal(turned.ranges, plain.ranges)
    np.testing.assert_array_equal(turned.odometry, plain.odometry)


def test_values_that_are_no_numbers(write_set: WriteSet) -> None:
    folder = write_set()

    def spoil_ranges(arrays: dict[str, Any]) -> None:
        arrays["ranges"][0, 1], arrays["ranges"][1, 2], arrays["ranges"][2, 3] = np.nan, np.inf, -np.inf

    def spoil_imu(arrays: dict[str, Any]) -> None:
        arrays["angular_velocity"][2, 100] = np.nan

    _rewrite(folder, "Hokuyo", spoil_ranges)
    _rewrite(folder, "Imu", spoil_imu)
    recording = ece276a.load(folder)
    assert np.isfinite(recording.ranges).all()
    assert [recording.ranges[1, 0], recording.ranges[2, 1], recording.ranges[3, 2]] == [0, 0, 0]
    assert any("3 ranges" in note for note in recording.notes)
    assert any("1 yaw rates" in note for note in recording.notes)
    assert recording.dead_reckoning()[-1, 2] == pytest.approx(TURN_RATE * recording.duration)


def test_stamps_that_run_backwards_change_nothing(write_set: WriteSet) -> None:
    ticks = np.tile(np.arange(81) % 7, (4, 1))
    folder = write_set(Encoders={"counts": ticks})
    plain = ece276a.load(folder)
    shuffle = np.random.default_rng(0).permutation

    def mix(arrays: dict[str, Any]) -> None:
        n = len(arrays["time_stamps"])
        new = shuffle(n)
        for key, value in arrays.items():
            if value.shape[-1:] == (n,):
                arrays[key] = value[..., new]

    for kind in ece276a.REQUIRED:
        _rewrite(folder, kind, mix)
    mixed = ece276a.load(folder)
    np.testing.assert_array_equal(mixed.stamps, plain.stamps)
    np.testing.assert_array_equal(mixed.ranges, plain.ranges)
    np.testing.assert_allclose(mixed.odometry, plain.odometry, atol=1e-12)
    assert sum("backwards" in note for note in mixed.notes) == 3


def test_repeated_stamps(write_set: WriteSet) -> None:
    folder = write_set()

    def repeat(arrays: dict[str, Any]) -> None:
        stamps, ranges = arrays["time_stamps"], arrays["ranges"]
        stamps[3] = stamps[2]  # another scan with the same stamp: kept, moved
        stamps[7] = stamps[6]  # the same scan twice: left out
        ranges[:, 7] = ranges[:, 6]

    _rewrite(folder, "Hokuyo", repeat)
    recording = ece276a.load(folder)
    assert len(recording) == 10
    assert (np.diff(recording.stamps) > 0).all()
    np.testing.assert_allclose(recording.times[:5], [0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)
    assert sum("logged twice" in note or "repeat the stamp" in note for note in recording.notes) == 2


def test_imu_that_ends_early_is_at_rest_then(write_set: WriteSet) -> None:
    folder = write_set()

    def cut(arrays: dict[str, Any]) -> None:
        kept = arrays["time_stamps"] < 1001.005
        arrays["time_stamps"] = arrays["time_stamps"][kept]
        arrays["angular_velocity"] = arrays["angular_velocity"][:, kept]

    _rewrite(folder, "Imu", cut)
    recording = ece276a.load(folder)
    heading = recording.dead_reckoning()[:, 2]
    assert heading[5] == pytest.approx(0.25) and heading[-1] == pytest.approx(0.25)
    assert any("last sample 0.50 s before the last scan" in note for note in recording.notes)
    assert any(f"another {0.5 * SPEED:.2f} m" in note for note in recording.notes)


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("Hokuyo", {"ranges": None}, r"Hokuyo7\.npz: lacks ranges"),
        ("Encoders", {"counts": None}, r"Encoders7\.npz: lacks counts"),
        ("Imu", {"time_stamps": None}, r"Imu7\.npz: lacks time_stamps"),
        ("Hokuyo", {"ranges": np.ones((3, 9))}, r"Hokuyo7\.npz: ranges is 3 x 9 .* 11 time stamps"),
        ("Encoders", {"counts": np.ones((4, 9))}, r"Encoders7\.npz: counts is 4 x 9"),
        ("Encoders", {"counts": np.ones((3, 81))}, r"Encoders7\.npz: counts is 3 x 81"),
        ("Imu", {"angular_velocity": np.ones(9)}, r"Imu7\.npz: angular_velocity is 9"),
        ("Hokuyo", {"angle_min": 0.5, "angle_increment": None}, r"Hokuyo7\.npz: angle or range limits"),
        ("Hokuyo", {"angle_min": np.array([0.0, 1.0])}, r"Hokuyo7\.npz: angle_min should be one finite number"),
        ("Hokuyo", {"range_max": 0.05}, r"Hokuyo7\.npz: angle or range limits"),
        ("Hokuyo", {"range_max": np.nan}, r"Hokuyo7\.npz: range_max should be one finite"),
        ("Hokuyo", {"ranges": np.ones((3, 0)), "time_stamps": np.ones(0)}, r"Hokuyo7\.npz: holds no scans"),
        ("Hokuyo", {"time_stamps": np.full(11, np.nan)}, r"Hokuyo7\.npz: no scan has a valid time stamp"),
        ("Imu", {"angular_velocity": np.ones((3, 0)), "time_stamps": np.ones(0)}, r"Imu7\.npz: holds no samples"),
        ("Hokuyo", {"ranges": np.array([["a"]])}, r"Hokuyo7\.npz: ranges holds <U1, not numbers"),
        ("Imu", {"angular_velocity": np.array([{}], dtype=object)}, r"Imu7\.npz: angular_velocity is a Python object"),
    ],
)
def test_files_that_cannot_be_used(write_set: WriteSet, kind: str, change: dict[str, Any], message: str) -> None:
    folder = write_set(**{kind: change})
    with pytest.raises(InputError, match=message) as caught:
        ece276a.load(folder)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.97])
@pytest.mark.parametrize("kind", ece276a.REQUIRED)
def test_half_downloaded(write_set: WriteSet, kind: str, share: float) -> None:
    path = write_set() / f"{kind}7.npz"
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(InputError, match=rf"{kind}7\.npz: .*get it again"):
        ece276a.load(path)


def test_flipped_bytes_inside_an_array(write_set: WriteSet) -> None:
    path = write_set() / "Hokuyo7.npz"
    with zipfile.ZipFile(path) as archive:
        start = archive.getinfo("ranges.npy").header_offset + 200
    content = bytearray(path.read_bytes())
    content[start : start + 8] = b"\xff" * 8
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"Hokuyo7\.npz: damaged"):
        ece276a.load(path)


@pytest.mark.parametrize("seed", range(3))
def test_random_damage_is_handled_or_named(write_set: WriteSet, seed: int) -> None:
    folder, rng = write_set(), np.random.default_rng(seed)
    for _ in range(40):
        path = folder / f"{rng.choice(ece276a.REQUIRED)}7.npz"
        content = path.read_bytes()
        spoiled = np.frombuffer(content, dtype=np.uint8).copy()
        spoiled[rng.integers(len(spoiled), size=rng.integers(1, 20))] = rng.integers(256)
        path.write_bytes(spoiled.tobytes())
        try:
            recording = ece276a.load(folder)
            assert np.isfinite(recording.ranges).all() and (np.diff(recording.stamps) > 0).all()
        except InputError as error:
            assert "7" in str(error) and "\n" not in str(error)
        path.write_bytes(content)


def test_not_an_npz(write_set: WriteSet) -> None:
    path = write_set() / "Imu7.npz"
    path.write_text("<html>404</html>")
    with pytest.raises(InputError, match=r"Imu7\.npz: not an \.npz file, or damaged"):
        ece276a.load(path)
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match=r"Imu7\.npz: holds one bare array"):
        ece276a.load(path)


def test_twin_of_set_21(shared_data: Path) -> None:
    recording = ece276a.load(shared_data / "twin21")
    assert recording.ranges.shape == (4785, 1081)
    assert recording.frames is not None and recording.truth is not None
    assert sum(path is not None for path in recording.frames.color_paths) == 183
    assert np.hypot(*recording.dead_reckoning()[-1, :2]) == pytest.approx(3.15, abs=0.05)
    assert len(recording.truth.stamps) == 4785


def test_beams_that_run_clockwise_are_turned_round(write_set: WriteSet) -> None:
    """Ranges 1, 2, 3 m at 0.6, 0.1, -0.4 rad: what is read has them from right to left."""
    ranges = np.tile([[1.0], [2.0], [3.0]], 11)
    folder = write_set(Hokuyo={"ranges": ranges, "angle_min": 0.6, "angle_max": -0.4, "angle_increment": -0.5})
    recording = ece276a.load(folder)
    np.testing.assert_allclose(recording.lidar.angles, [-0.4, 0.1, 0.6])
    np.testing.assert_array_equal(recording.ranges, np.tile([3.0, 2.0, 1.0], (11, 1)))
    assert recording.notes == ()


def test_a_lidar_upside_down_mirrors_its_beams(write_set: WriteSet) -> None:
    """Upside down and looking back at (0.3, 0.1): a range of 2 m at 0.5 rad to what it takes for its left.

    Its left is the robot's left, as it looks back: R_z(pi) R_x(pi) (cos 0.5, sin 0.5) = (-cos 0.5, sin 0.5).
    """
    robot = load_robot().model_copy(
        update={"lidar": LidarMount(position=(0.3, 0.1, 0.5), yaw=3.14159265, roll=3.14159265)}
    )
    recording = ece276a.load(write_set(Hokuyo={"ranges": np.tile([[1.0], [1.5], [2.0]], 11)}), robot=robot)
    assert (np.diff(recording.lidar.angles) > 0).all()
    points = ScanReader.of(recording.lidar, ScanConfig()).read(0, 0.0, recording.ranges[0]).points
    c, s = np.cos(0.5), np.sin(0.5)
    expected = np.array([[0.3 - 2 * c, 0.1 + 2 * s], [0.3 - 1.5, 0.1], [0.3 - c, 0.1 - s]])
    np.testing.assert_allclose(points, expected, atol=1e-6)
