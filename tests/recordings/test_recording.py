"""What a recording takes, converts and refuses."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.recording import Frames, Lidar, Recording, Relations, Trajectory
from pfslam_viz.robot import CameraGeometry

CAMERA = CameraGeometry(position=(0, 0, 0))


def lidar(**changes: Any) -> Lidar:
    fields = {"angles": [-1.0, 0.0, 1.0], "range_min": 0.1, "range_max": 30.0, "pose": np.zeros(3)}
    return Lidar(**{**fields, **changes})


def recording(**changes: Any) -> Recording:
    """Four scans of three beams."""
    fields = {
        "name": "four", "format": "test", "path": None, "stamps": [10, 11, 12, 13],
        "ranges": np.arange(12.0).reshape(4, 3), "lidar": lidar(), "odometry": np.ones((4, 3)),
    }  # fmt: skip
    return Recording(**{**fields, **changes})


def test_what_is_safe_is_converted() -> None:
    ranges = np.arange(12).reshape(3, 4).T  # integers, by columns
    made = recording(ranges=ranges)
    assert made.stamps.dtype == np.float64 and made.stamps.tolist() == [10.0, 11.0, 12.0, 13.0]
    assert made.ranges.dtype == np.float32 and made.ranges.flags.c_contiguous
    assert made.ranges.tolist() == ranges.tolist()
    assert made.lidar.angles.dtype == np.float64 and type(made.lidar.range_max) is float
    assert made.odometry.tolist() == [[0, 0, 0], [1, 1, 1], [1, 1, 1], [1, 1, 1]]
    assert made.notes == ()


def test_arrays_that_fit_are_not_copied_and_never_changed() -> None:
    ranges, odometry = np.ones((4, 3), np.float32), np.ones((4, 3))
    ranges[1, 2] = np.nan
    made = recording(ranges=ranges, odometry=odometry)
    assert np.isnan(ranges[1, 2]) and odometry[0, 0] == 1.0
    assert replace(made, name="other").ranges is made.ranges


def test_ranges_that_are_no_numbers_are_no_return() -> None:
    ranges = np.full((4, 3), 2.0)
    ranges[0, 1], ranges[2, 0], ranges[3, 2], ranges[3, 0] = np.nan, np.inf, -np.inf, 1e300  # float32 ends at 3e38
    made = recording(ranges=ranges, notes=("one",))
    assert made.ranges.tolist() == [[2, 0, 2], [2, 2, 2], [0, 2, 2], [0, 2, 0]]
    assert made.notes == ("one", "lidar: 4 ranges that are NaN or infinite taken as no return")
    huge = recording(ranges=np.full((4, 3), 3e38))  # their sum is infinite, they are not
    assert np.isfinite(huge.ranges).all() and huge.ranges.min() > 2.9e38 and huge.notes == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ranges": np.ones((3, 4))}, ["ranges has shape (3, 4); (4, 3) is expected", "transposed", "ranges.T"]),
        ({"ranges": np.ones((4, 5))}, ["(4, 5)", "5 ranges a scan, but lidar.angles has 3"]),
        ({"ranges": np.ones((7, 3))}, ["(7, 3)", "7 scans, but there are 4 stamps"]),
        ({"ranges": np.ones(12)}, ["ranges has shape (12,)"]),
        ({"ranges": np.ones((4, 3), complex)}, ["ranges holds complex128; real numbers are expected"]),
        ({"ranges": np.ones((4, 3), bool)}, ["ranges holds bool"]),
        ({"ranges": [[1.0], [1.0, 2.0]]}, ["ranges is no array"]),
        ({"stamps": [10, 11, 11, 13]}, ["stamps does not strictly increase: 11.000000 s at 1 is followed by 11.0"]),
        ({"stamps": [10, 12, 11, 13]}, ["12.000000 s at 1 is followed by 11.000000 s"]),
        ({"stamps": [10, math.nan, 12, 13]}, ["stamps is nan at [1]; finite numbers are expected"]),
        ({"stamps": ["a", "b", "c", "d"]}, ["stamps holds <U1"]),
        ({"stamps": np.zeros((4, 1))}, ["stamps has shape (4, 1); (n,) is expected"]),
        ({"odometry": np.ones((3, 3))}, ["odometry has shape (3, 3); (4, 3) is expected, a row for every scan"]),
        ({"odometry": np.ones((3, 4))}, ["odometry has shape (3, 4)", "transposed"]),
        ({"odometry": [[0, 0, 0], [1, 0, 0], [1, math.inf, 0], [0, 0, 0]]}, ["odometry is inf at [2, 1]"]),
    ],
)
def test_a_recording_refuses(changes: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        recording(**changes)
    message = str(caught.value)
    assert message.startswith("four: ") and "\n" not in message
    for word in words:
        assert word in message
    with pytest.raises(InputError, match=r"^drive\.log: "):
        recording(path=Path("drive.log"), **changes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"angles": []}, "lidar.angles is empty"),
        ({"angles": np.zeros((3, 1))}, "lidar.angles has shape (3, 1); (n,) is expected"),
        ({"angles": [0.0, math.nan]}, "lidar.angles is nan at [1]"),
        ({"range_min": 30.0}, "lidar.range_min is 30 m and lidar.range_max 30 m; 0 <= range_min < range_max"),
        ({"range_min": -1.0}, "lidar.range_min is -1 m"),
        ({"range_max": math.inf}, "lidar.range_max is inf"),
        ({"range_max": [1.0, 2.0]}, "lidar.range_max has shape (2,); one number is expected"),
        ({"pose": [0.0, 0.0]}, "lidar.pose has shape (2,); (3,) is expected"),
        ({"height": math.nan}, "lidar.height is nan"),
    ],
)
def test_a_lidar_refuses(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError) as caught:
        lidar(**changes)
    assert words in str(caught.value)


def test_a_range_of_zero_is_no_return_whatever_the_limits() -> None:
    assert lidar(range_min=0).range_min == 0.001
    assert 0 < lidar(range_min=0, range_max=0.0005).range_min < 0.0005


def test_trajectories_and_relations_refuse() -> None:
    kept = Trajectory([0, 1, 1], np.zeros((3, 3), int))  # type: ignore[arg-type]  # sensors repeat stamps
    assert kept.stamps.dtype == kept.poses.dtype == np.float64
    with pytest.raises(InputError, match=r"trajectory.stamps does not increase: 1\.0+ s at 1 is followed by 0\.5"):
        Trajectory(np.array([0, 1, 0.5]), np.zeros((3, 3)))
    with pytest.raises(InputError, match=r"trajectory.poses has shape \(2, 3\); \(3, 3\) is expected"):
        Trajectory(np.arange(3.0), np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"relations.end has shape \(1,\); \(2,\) is expected"):
        Relations(np.zeros(2), np.zeros(1), np.zeros((2, 3)))
    with pytest.raises(InputError, match=r"relations.poses is nan at \[1, 2\]"):
        Relations(np.zeros(2), np.zeros(2), np.array([[0, 0, 0], [0, 0, math.nan]]))


def test_frames_refuse() -> None:
    image = Path("a.png")
    kept = Frames([1, 1, 2], [image, None, image], [], (), CAMERA)  # type: ignore[arg-type]
    assert kept.color_paths == (image, None, image) and kept.color_stamps.dtype == np.float64
    with pytest.raises(InputError, match=r"frames.color_paths has 1 files; 2 are expected"):
        Frames(np.arange(2.0), (image,), np.zeros(0), (), CAMERA)
    with pytest.raises(InputError, match=r"frames.disparity_stamps does not increase"):
        Frames(np.zeros(0), (), np.array([2.0, 1.0]), (None, None), CAMERA)


def test_select_composes_the_odometry() -> None:
    quarter = recording(odometry=np.tile([1.0, 0.0, math.pi / 2], (4, 1)))
    chosen = quarter.select(1, None, 2)
    assert chosen.stamps.tolist() == [11.0, 13.0] and chosen.ranges.tolist() == [[3, 4, 5], [9, 10, 11]]
    np.testing.assert_allclose(chosen.odometry[0], 0)
    # Ahead 1 m, turn left, 1 m, turn left: one ahead and one to the left, turned round.
    np.testing.assert_allclose(np.abs(chosen.odometry[1]), [1.0, 1.0, math.pi], atol=1e-12)
    assert len(quarter.select(4)) == 0


SCANS = np.arange(12.0).reshape(4, 3)
QUARTERS = np.array([[9.0, 9.0, 9.0], [1, 0, math.pi / 2], [1, 0, math.pi / 2], [1, 0, math.pi / 2]])
CORNERS = np.array([[0.0, 0, 0], [1, 0, math.pi / 2], [1, 1, math.pi], [0, 1, -math.pi / 2]])


def test_from_arrays_with_either_kind_of_odometry() -> None:
    by_steps = Recording.from_arrays([0, 1, 2, 3], SCANS, [-1, 0, 1], QUARTERS, range_max=20, lidar_pose=(0.3, 0, 0))
    np.testing.assert_allclose(by_steps.dead_reckoning()[:, :2], CORNERS[:, :2], atol=1e-12)
    assert (by_steps.name, by_steps.format, by_steps.path, by_steps.notes) == ("arrays", "arrays", None, ())
    assert by_steps.lidar.pose.tolist() == [0.3, 0, 0] and by_steps.lidar.range_max == 20
    moved = CORNERS + np.array([5.0, 7.0, 0.0])
    by_poses = Recording.from_arrays([0, 1, 2, 3], SCANS, [-1, 0, 1], odometry_poses=moved, truth=moved)
    np.testing.assert_allclose(by_poses.odometry, by_steps.odometry, atol=1e-12)
    assert by_poses.truth is not None and by_poses.truth.poses[2].tolist() == moved[2].tolist()
    assert by_poses.lidar.range_max == 11.0  # the longest range


def test_from_arrays_without_odometry() -> None:
    made = Recording.from_arrays([0, 1, 2, 3], SCANS, [-1, 0, 1])
    assert not made.odometry.any()
    assert made.notes == ("odometry: none is given; the robot is taken to rest, and the filter has the scans alone",)


def test_from_arrays_sorts_and_spreads_stamps() -> None:
    """Scans 0 to 3 are logged as 0, 2, 1, 1 again, 3 with the stamp of 2, and one without a stamp."""
    stamps = [0.0, 2.0, 1.0, 1.0, 2.0, math.nan]
    scans = SCANS[[0, 2, 1, 1, 3, 3]]
    poses = CORNERS[[0, 2, 1, 1, 3, 3]]
    made = Recording.from_arrays(stamps, scans, [-1, 0, 1], odometry_poses=poses, truth=poses)
    assert made.stamps.tolist() == [0.0, 1.0, 2.0, 2.5]  # half the median spacing after the last stamp
    assert made.ranges.tolist() == SCANS.tolist()
    np.testing.assert_allclose(made.dead_reckoning()[:, :2], CORNERS[:, :2], atol=1e-12)
    assert made.truth is not None
    np.testing.assert_allclose(made.truth.poses, CORNERS)
    assert [note.partition(":")[2] for note in made.notes] == [
        " 1 samples without a valid time stamp left out",
        " time stamps run backwards 1 times; sorted by time stamp",
        " 1 scans logged twice left out",
        " 1 scans repeat the stamp before; spread up to the next stamp",
    ]


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"ranges": SCANS.T}, "ranges has shape (3, 4); (4, 3) is expected; it looks transposed"),
        ({"odometry": QUARTERS, "odometry_poses": CORNERS}, "both given"),
        ({"odometry": QUARTERS[:, :2]}, "odometry has shape (4, 2)"),
        ({"odometry_poses": CORNERS[1:]}, "odometry_poses has shape (3, 3)"),
        ({"truth": CORNERS[1:]}, "truth has shape (3, 3); (4, 3) is expected, a row for every scan"),
        ({"stamps": [math.nan] * 4}, "no scan with a finite stamp"),
        ({"stamps": [], "ranges": np.zeros((0, 3))}, "no scan with a finite stamp"),
        ({"range_max": 0.0}, "range_min < range_max is expected"),
    ],
)
def test_from_arrays_refuses(arrays: dict[str, Any], words: str) -> None:
    given = {"stamps": [0, 1, 2, 3], "ranges": SCANS, "angles": [-1, 0, 1], "name": "mine", **arrays}
    with pytest.raises(InputError) as caught:
        Recording.from_arrays(**given)
    assert words in str(caught.value)


def test_more_ranges_than_angles_are_an_error_and_no_crash() -> None:
    """Kernels index ranges by angle unchecked: this once ended in a segmentation fault, in the replay."""
    with pytest.raises(InputError, match=r"1081 ranges a scan, but lidar.angles has 100"):
        Recording.from_arrays(np.arange(50), np.ones((50, 1081)), np.linspace(-2, 2, 100))
    with pytest.raises(InputError, match=r"looks transposed"):
        Recording.from_arrays(np.arange(50), np.ones((1081, 50)), np.linspace(-2, 2, 1081))


def test_beam_times() -> None:
    def made(times: list[float] | None) -> Recording:
        return Recording.from_arrays([0.0, 1.0], np.ones((2, 3)), [-1.0, 0.0, 1.0], beam_times=times)

    times = made([0, 1, 2]).beam_times
    assert times is not None and times.dtype == np.float64
    np.testing.assert_array_equal(made([0, 1, 2]).select(1).beam_times, times)
    assert made(None).beam_times is None
    with pytest.raises(InputError, match=r"beam_times has shape \(2,\); \(3,\) is expected, a time for every beam"):
        made([0.0, 1.0])
    with pytest.raises(InputError, match=r"beam_times is inf at \[2\]"):
        made([0.0, 0.0, math.inf])
