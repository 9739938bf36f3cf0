"""The whole loop, on a short drive through a room whose truth is known."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import Config, load_config
from pfslam_viz.recordings.checking.check import check
from pfslam_viz.recordings.recording import Lidar, Recording, Trajectory
from pfslam_viz.replay import Replay

Array = NDArray[np.float64]
Map = NDArray[np.float32]

# A room of 8 x 6 m about the origin with a box in a corner: x0, y0, x1, y1 of every wall, m.
WALLS = np.array(
    [
        [-3, -3, 5, -3], [5, -3, 5, 3], [5, 3, -3, 3], [-3, 3, -3, -3],
        [3, 1, 4, 1], [4, 1, 4, 2], [4, 2, 3, 2], [3, 2, 3, 1],
    ],
    np.float64,
)  # fmt: skip
LIDAR = Lidar(np.radians(np.linspace(-135, 135, 541)), 0.1, 30.0, np.array([0.3, 0.0, 0.0]))


def cast(pose: Array) -> NDArray[np.float32]:
    """Ranges (B,) that the lidar on a robot at ``pose`` measures: the nearest crossing of each beam with a wall."""
    x, y, heading = geometry.compose(pose, LIDAR.pose)
    beams = np.stack([np.cos(heading + LIDAR.angles), np.sin(heading + LIDAR.angles)], axis=1)
    start, along = WALLS[:, :2] - [x, y], WALLS[:, 2:] - WALLS[:, :2]
    cross = beams[:, None, 0] * along[:, 1] - beams[:, None, 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start[:, 0] * along[:, 1] - start[:, 1] * along[:, 0]) / cross
        on_wall = (start[:, 0] * beams[:, None, 1] - start[:, 1] * beams[:, None, 0]) / cross
    distance[~((distance > 0) & (on_wall >= 0) & (on_wall <= 1))] = np.inf
    ranges: NDArray[np.float32] = distance.min(axis=1).astype(np.float32)
    return ranges


def drive(scans: int = 120, drift: float = 0.002) -> Recording:
    """A curve through the room; the odometry turns ``drift`` rad a scan too far."""
    rng = np.random.default_rng(11)
    increments = np.tile([0.02, 0.0, 0.012], (scans, 1))
    increments[0] = 0.0
    truth = geometry.accumulate(increments)
    ranges = np.array([cast(pose) for pose in truth]) + rng.normal(0, 0.01, (scans, 541))
    odometry = increments + rng.normal(0, [1e-3, 1e-3, 5e-4], (scans, 3)) + [0.0, 0.0, drift]
    odometry[0] = 0.0
    stamps = 100.0 + 0.025 * np.arange(float(scans))
    return Recording(
        name="room", format="ece276a", path=Path("room"), stamps=stamps, ranges=ranges.astype(np.float32), lidar=LIDAR,
        odometry=odometry, truth=Trajectory(stamps, truth),
    )  # fmt: skip


@pytest.fixture(scope="module")
def room() -> Recording:
    return drive()


@pytest.fixture(scope="module")
def paper() -> Config:
    return load_config("paper")


def position_error(poses: Array, truth: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((poses - truth)[:, :2] ** 2, axis=1))))


def test_the_filter_finds_its_way(room: Recording, paper: Config) -> None:
    """Dead reckoning ends 14° off; the filter stays within the paper's noise of the truth."""
    replay = Replay(room, paper)
    steps = list(replay)
    result = replay.result()
    assert result.truth is not None
    assert abs(math.degrees(geometry.wrap(result.dead_reckoning[-1, 2] - result.truth[-1, 2]))) > 10
    assert position_error(result.dead_reckoning, result.truth) > 0.1
    assert position_error(result.online, result.truth) < 0.07
    assert np.abs(np.degrees(geometry.wrap(result.online[:, 2] - result.truth[:, 2]))).max() < 4
    assert len(steps) == 120 and not result.interrupted
    assert result.uninformative == 1  # the first scan has no map to be compared with
    assert result.resamplings == 120


def test_the_walls_are_where_they_are(room: Recording, paper: Config) -> None:
    """Nine in ten occupied cells lie within two cells of a wall, and most of the walls seen are occupied."""
    replay = Replay(room, paper)
    for _ in replay:
        pass
    grid = replay.result().grid
    centers = grid.centers(np.argwhere(grid.occupied))
    distance = np.min([distance_to(wall, centers) for wall in WALLS], axis=0)
    assert len(centers) > 300
    assert np.mean(distance < 2 * grid.cell) > 0.9
    free = grid.centers(np.argwhere(grid.log_odds < -5))
    inside = (np.abs(free[:, 0] - 1) < 4.1) & (np.abs(free[:, 1]) < 3.1)
    assert len(free) > 5000 and inside.mean() > 0.99


def distance_to(wall: Array, points: Array) -> Array:
    start, along = wall[:2], wall[2:] - wall[:2]
    share = np.clip((points - start) @ along / (along @ along), 0, 1)
    distance: Array = np.hypot(*(points - start - share[:, None] * along).T)
    return distance


def test_steps_tell_what_happened(room: Recording, paper: Config) -> None:
    replay = Replay(room, paper)
    for k, step in enumerate(replay):
        assert step.index == k
        assert step.stamp == pytest.approx(100 + 0.025 * k) and step.time == pytest.approx(0.025 * k)
        assert step.grid is replay.slam.grid and step.dead_reckoning_grid is replay.dead_reckoning_grid
        assert step.end_points.shape == (541, 2) and step.hits.shape == (541,)
        assert step.hits.any() == (k > 0)  # the map of the first scan was empty
        assert step.estimate.weights.sum() == pytest.approx(1)
        assert step.truth is not None and step.texture is None
        assert set(step.seconds) == {"predict", "update", "map", "resample", "revise", "dead_reckoning", "texture"}
        np.testing.assert_allclose(step.dead_reckoning, replay.result().dead_reckoning[k])
        middle = geometry.compose(step.estimate.best, LIDAR.pose)
        ahead = step.end_points[270] - middle[:2]
        assert np.hypot(*ahead) == pytest.approx(room.ranges[k, 270], rel=1e-6)
        assert math.atan2(ahead[1], ahead[0]) == pytest.approx(middle[2], abs=1e-6)
    first = drive(1)
    only = next(iter(Replay(first, paper)))
    np.testing.assert_array_equal(only.estimate.best, [0, 0, 0])
    np.testing.assert_array_equal(only.grid.log_odds, only.dead_reckoning_grid.log_odds)


def run(recording: Recording, config: Config, threads: int | None = None) -> tuple[Array, Map, Map]:
    replay = Replay(recording, config, threads=threads)
    for _ in replay:
        pass
    result = replay.result()
    return result.online, result.grid.log_odds, result.dead_reckoning_grid.log_odds


def test_same_seed_same_trajectory_whatever_the_threads(room: Recording, paper: Config) -> None:
    one, two, again = run(room, paper, 1), run(room, paper, 2), run(room, paper, 2)
    for a, b, c in zip(one, two, again, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(b, c)
    other = run(room, paper.model_copy(update={"seed": 1}))
    assert not np.array_equal(one[0], other[0])
    np.testing.assert_array_equal(one[2], other[2])


@pytest.mark.parametrize("blind", [slice(None), slice(0, 1), slice(1, None), slice(40, 60)])
def test_scans_without_returns_run_through(room: Recording, paper: Config, blind: slice) -> None:
    ranges = room.ranges.copy()
    ranges[blind] = 0.0
    forced = check(replace(room, ranges=ranges))  # without any return it would be refused
    replay = Replay(forced, paper.model_copy(update={"particles": 50}))
    empty = [len(step.end_points) == 0 for step in replay]
    assert empty == (ranges[:, 0] == 0).tolist()
    result = replay.result()
    assert len(result.online) == 120 and np.isfinite(result.online).all()
    assert result.uninformative >= sum(empty)


def test_one_beam_is_enough_to_run(paper: Config) -> None:
    room = drive(20)
    ranges = np.zeros_like(room.ranges)
    ranges[:, 270] = room.ranges[:, 270]
    assert len(list(Replay(replace(room, ranges=ranges), paper))) == 20


def test_leaving_early_keeps_what_was_done_and_may_go_on(room: Recording, paper: Config) -> None:
    replay = Replay(room, paper, threads=2)
    assert len(replay.result().online) == 0
    for step in replay:
        if step.index == 29:
            break
    result = replay.result()
    assert result.interrupted
    for poses in (result.online, result.estimate, result.dead_reckoning, result.truth):
        assert poses is not None and poses.shape == (30, 3)
    assert all(len(values) == 30 for values in result.seconds.values()) and len(result.stamps) == 30
    assert [step.index for step in replay] == list(range(30, 120))
    np.testing.assert_array_equal(replay.result().online, run(room, paper)[0])
    assert list(replay) == [] and not replay.result().interrupted


def test_no_thread_outlives_the_loop(room: Recording, paper: Config) -> None:
    import threading

    before = threading.active_count()
    replay = Replay(room, paper, threads=2)
    steps = iter(replay)
    next(steps)
    assert threading.active_count() == before + 1
    del steps
    assert threading.active_count() == before


@pytest.mark.slow
@pytest.mark.parametrize(("name", "position", "heading"), [("paper", 0.8, 4.0), ("default", 0.005, 0.1)])
def test_twin_of_a_real_drive(shared_data: Path, name: str, position: float, heading: float) -> None:
    """Real wheels and gyro against simulated walls: 92 m, on which dead reckoning goes metres astray."""
    from pfslam_viz.recordings import ece276a

    replay = Replay(ece276a.load(shared_data / "twin21"), load_config(name), texture=False)
    for _ in replay:
        pass
    result = replay.result()
    assert result.truth is not None
    assert position_error(result.dead_reckoning, result.truth) > 1.0
    assert position_error(result.estimate, result.truth) < position
    turned = np.degrees(geometry.wrap(result.estimate[:, 2] - result.truth[:, 2]))
    assert np.sqrt(np.mean(turned**2)) < heading


def test_the_floor_is_painted_anew_where_hindsight_moved_the_trajectory(tmp_path: Path) -> None:
    from pfslam_viz.recordings import ece276a
    from pfslam_viz.simulation.recording import simulate

    recording = ece276a.load(simulate(tmp_path / "drive", seed=3, duration=6.0)).select(0, 200)
    replay = Replay(recording, load_config("paper", ["particles=5"]))
    assert replay.painter is not None
    online = list(replay) and replay.result().texture
    assert online is replay.painter.texture  # one map has no hindsight

    again = Replay(recording, load_config("paper", ["particles=5"]))
    shifted = replay.slam.trajectory() + np.array([3.0, 0.0, 0.0])
    again.slam.trajectory = lambda: shifted  # type: ignore[method-assign]
    list(again)
    settled = again.result().texture
    assert settled is not None and online is not None
    cells = round(3.0 / online.cell)
    left, moved = (np.flatnonzero((t.weight > 0).any(axis=0)).min() - t.origin[1] for t in (online, settled))
    assert abs(moved - left - cells) <= 2
