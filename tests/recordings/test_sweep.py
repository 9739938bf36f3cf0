"""Scans whose beams are cast one by one from where the robot is at their time; when that was is to be found out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import load_config
from pfslam_viz.evaluation.scans import end_points
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.recordings.motion import moved, twists
from pfslam_viz.recordings.recording import Lidar, Recording, Trajectory
from pfslam_viz.recordings.sweep import find, with_beam_times
from pfslam_viz.replay import Replay
from pfslam_viz.simulation.sensors import true_ranges

Array = NDArray[np.float64]


def box(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


ROOM = np.array(box(-2, -3, 6, 3) + box(1, 1.2, 2, 2.2) + box(3.5, -2, 4.2, -1.5))
FINE = 0.005  # s between the poses of the drive


def path(turn: float) -> tuple[Array, Array]:
    """Times (s) and poses of a robot that goes ahead, stops, and turns at ``turn`` rad/s by turns to either side."""
    speeds = []
    for way in (1.0, -1.0, -1.0, 1.0, 1.0, -1.0):
        for seconds, speed in ((0.8, (0.4, 0.0, 0.0)), (0.7, (0.0, 0.0, way * turn)), (0.6, (0.0, 0.0, 0.0))):
            speeds += [speed] * round(seconds / FINE)
    poses = geometry.accumulate(geometry.steady_motion(FINE * np.array(speeds)))
    return np.linspace(0.0, FINE * (len(poses) - 1), len(poses)), poses


def swept(beam_times: Array | None, turn: float = 2.0, view: float = 360.0, period: float = 0.2) -> Recording:
    """The drive as a lidar sees it whose beams have such times; with odometry that errs by 5 % in the turns."""
    rng = np.random.default_rng(3)
    at, poses = path(turn)
    heading = np.unwrap(poses[:, 2])
    angles = np.radians(np.arange(-view / 2, view / 2, 3.0))
    lidar = Lidar(angles, 0.05, 20.0, np.array([0.2, 0.0, 0.3]))
    stamps = np.arange(2 * period, at[-1] - 2 * period, period)
    when = stamps[:, None] + (0.0 if beam_times is None else beam_times)
    when = np.broadcast_to(when, (len(stamps), len(angles)))
    ranges = np.zeros(when.shape)
    for b in range(len(angles)):
        t = when[:, b]
        pose = np.stack([np.interp(t, at, poses[:, 0]), np.interp(t, at, poses[:, 1]), np.interp(t, at, heading)], -1)
        ranges[:, b] = true_ranges(ROOM, geometry.compose(pose, lidar.pose), angles[b] + np.array([0.0, 0.01]))[0][:, 0]
    ranges += 0.01 * rng.standard_normal(ranges.shape)
    true = np.stack(
        [np.interp(stamps, at, poses[:, 0]), np.interp(stamps, at, poses[:, 1]), np.interp(stamps, at, heading)], -1
    )
    odometry = geometry.increments(true) * [1.0, 1.0, 1.05]
    return Recording(
        "swept", "test", None, stamps, ranges.astype(np.float32), lidar, odometry, truth=Trajectory(stamps, true)
    )


def times(way: int, stamped: float, view: float = 360.0, period: float = 0.2) -> Array:
    """Of beams every 3 degrees of a lidar that turns once in ``period``; the stamp is at that share of the sweep."""
    forwards: Array = period / 360.0 * np.arange(0.0, view, 3.0, dtype=np.float64)
    shifted: Array = (forwards if way > 0 else forwards[::-1]) - stamped * forwards[-1]
    return shifted


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("stamped", [0.0, 0.5, 1.0])
def test_the_way_round_and_the_beam_of_the_stamp(way: int, stamped: float) -> None:
    recording = swept(times(way, stamped))
    made = with_beam_times(recording)
    assert made.beam_times is not None
    np.testing.assert_allclose(made.beam_times, times(way, stamped), atol=1e-9)
    direction, which = (
        {1: "counter-clockwise", -1: "clockwise"}[way],
        {0.0: "first", 0.5: "middle", 1.0: "last"}[stamped],
    )
    assert len(made.notes) == 1
    assert f"spread over 0.198 s, {direction}, the stamp being that of the {which} one" in made.notes[0]
    assert with_beam_times(made) is made


@pytest.mark.parametrize("given", [None, times(1, 1.0), times(-1, 0.0), 0.05 * times(1, 0.0)])
def test_times_that_a_file_gives_are_checked(given: Array | None) -> None:
    """The scans are of one moment, or measured from the stamp on; a file may say so, or something else."""
    still = replace(swept(None), beam_times=given)
    assert with_beam_times(still).beam_times is None or (given is not None and given.max() < 0.02 and given.min() == 0)
    turning = with_beam_times(replace(swept(times(1, 0.0)), beam_times=given))
    assert turning.beam_times is not None
    np.testing.assert_allclose(turning.beam_times, times(1, 0.0), atol=1e-9)
    assert ("other than the file says" in turning.notes[0]) == (given is not None)
    right = replace(swept(times(1, 0.0)), beam_times=times(1, 0.0))
    assert with_beam_times(right) is right


def test_a_lidar_that_sees_three_quarters_ten_times_a_second() -> None:
    made = with_beam_times(swept(times(1, 1.0, 270.0, 0.1), view=270.0, period=0.1))
    assert made.beam_times is not None
    np.testing.assert_allclose(made.beam_times, times(1, 1.0, 270.0, 0.1), atol=1e-9)


@pytest.mark.parametrize("view", [180.0, 270.0, 360.0])
@pytest.mark.parametrize("turn", [0.1, 0.5, 2.0])
def test_scans_of_one_moment_stay_so(view: float, turn: float) -> None:
    recording = swept(None, turn, view)
    assert with_beam_times(recording) is recording


def test_what_cannot_be_told_is_left() -> None:
    recording = swept(times(1, 0.0))
    assert find(replace(recording, odometry=np.zeros_like(recording.odometry))) is None  # no turn is known
    assert find(replace(recording, stamps=10 * recording.stamps)) is None  # scans 2 s apart: no lidar turns so slowly
    assert find(recording.select(0, 4)) is None


def test_end_points_of_an_evaluation_are_corrected_as_well() -> None:
    """By the true times, the walls of a scan in the middle of a turn are straight: no point is off the room's walls."""
    recording = swept(times(1, 0.0))
    recording = replace(recording, beam_times=times(1, 0.0))
    scan = int(np.argmax(np.abs(recording.odometry[:-1, 2]) * np.abs(recording.odometry[1:, 2])))
    points = end_points(recording, np.array([scan])).points
    plain = end_points(replace(recording, beam_times=None), np.array([scan])).points
    speeds = twists(recording.odometry, recording.stamps)
    for other in (scan, int(np.argmax(np.diff(recording.odometry[:, 2]))), len(recording) - 1):
        one = np.array([other])
        uncorrected = end_points(replace(recording, beam_times=None), one).points
        expected = moved(uncorrected, times(1, 0.0), speeds[other : other + 2])
        np.testing.assert_allclose(end_points(recording, one).points, expected, atol=1e-12)
    at, poses = path(2.0)
    k = int(np.argmin(np.abs(at - recording.stamps[scan])))

    def off(points: Array) -> float:
        x, y = geometry.transform(poses[k], points).T
        outer = np.minimum.reduce([np.abs(x + 2), np.abs(x - 6), np.abs(y + 3), np.abs(y - 3)])
        inner = [
            np.maximum(np.abs(x - cx) - w, np.abs(y - cy) - h)
            for cx, cy, w, h in ((1.5, 1.7, 0.5, 0.5), (3.85, -1.75, 0.35, 0.25))
        ]
        return float(np.median(np.minimum.reduce([outer, *np.abs(inner)])))

    assert off(points) < 0.04 < 0.15 < off(plain)


def test_speeds_between_scans() -> None:
    """1 m in half a second, then a quarter turn on the spot in one."""
    odometry = np.array([[0, 0, 0], [1.0, 0, 0], [0, 0, np.pi / 2]])
    expected = np.array([[2, 0, 0], [2, 0, 0], [0, 0, np.pi / 2], [0, 0, np.pi / 2]])
    np.testing.assert_allclose(twists(odometry, np.array([0.0, 0.5, 1.5])), expected, atol=1e-12)
    assert not twists(odometry[:1], np.zeros(1)).any()


def test_a_log_that_says_nothing_of_it(tmp_path: Path) -> None:
    """Read from a file, the beams have their times: the catalog looks for them, for every format."""
    recording = swept(times(1, 1.0))
    lines = []
    for stamp, ranges, pose in zip(recording.stamps, recording.ranges, recording.dead_reckoning(), strict=True):
        laser = geometry.compose(pose, recording.lidar.pose)
        numbers = [-np.pi, 2 * np.pi, np.radians(3.0), 20.0, 0.01, 0, len(ranges), *ranges, 0, *laser, *pose]
        told = " ".join(f"{number:.6f}" if isinstance(number, float) else f"{number}" for number in numbers)
        lines.append(f"ROBOTLASER1 0 {told} 0 0 0 0 0 {stamp:.6f} robot {stamp:.6f}\n")
    path = tmp_path / "swept.log"
    path.write_text("".join(lines))
    loaded = load_recording(path)
    assert loaded.beam_times is not None
    np.testing.assert_allclose(loaded.beam_times, times(1, 1.0), atol=1e-6)
    assert any("the stamp being that of the last one" in note for note in loaded.notes)


def test_replay_of_a_lidar_that_turns_slowly() -> None:
    """2 rad/s at 5 scans a second: what is settled is no worse than what was known at once, and both are right."""

    def errors(recording: Recording) -> tuple[float, float]:
        replay = Replay(recording, load_config("default", ["particles=10"]), threads=1)
        for _ in replay:
            pass
        result = replay.result()
        assert result.truth is not None
        online, settled = (
            float(np.hypot(*(poses - result.truth)[:, :2].T).max()) for poses in (result.online, result.estimate)
        )
        return online, settled

    online, settled = errors(with_beam_times(swept(times(1, 1.0))))
    assert settled <= online < 0.1
    assert max(errors(replace(swept(times(1, 1.0)), checked=True))) > 0.15  # the check would tell the times
    online, settled = errors(swept(times(1, 1.0)))
    assert settled <= online < 0.1
