"""The filter with a map per particle on drives with known truth: in a room, in a bare corridor, in an office."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import load_config
from pfslam_viz.evaluation.trajectory_error import trajectory_error
from pfslam_viz.recordings import ece276a
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result
from pfslam_viz.settings import MapConfig, ResamplingConfig
from pfslam_viz.simulation.recording import simulate
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.evidence import Verdict
from pfslam_viz.slam.graph.scan_store import Matches
from pfslam_viz.slam.graph.settings import SmoothingConfig
from pfslam_viz.slam.graph.smoothing import Smoother
from pfslam_viz.slam.protocol import Estimate, Kept, Scan
from pfslam_viz.slam.rbpf import rao_blackwellized
from pfslam_viz.slam.rbpf.rao_blackwellized import RaoBlackwellizedFilter
from pfslam_viz.slam.rbpf.settings import RaoBlackwellizedConfig, RbpfConfig
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings

Array = NDArray[np.float64]

ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 271)
SENSOR = np.array([0.15, 0.0])
# x0, y0, x1, y1: a room of 7 x 6 m with a niche, a pillar and a cupboard that stands askew
ROOM = np.array([
    (-3, -1.5, 4, -1.5), (4, -1.5, 4, 4.5), (4, 4.5, 1, 4.5), (1, 4.5, 1, 5), (1, 5, -0.5, 5), (-0.5, 5, -0.5, 4.5),
    (-0.5, 4.5, -3, 4.5), (-3, 4.5, -3, -1.5), (-0.2, 1.3, 0.3, 1.3), (0.3, 1.3, 0.3, 1.8), (0.3, 1.8, -0.2, 1.8),
    (-0.2, 1.8, -0.2, 1.3), (2.6, -1.4, 3.6, -0.6),
])  # fmt: skip
WRITTEN: list[bool] = []
CORRIDOR = np.array([(-80.0, -1.1, 80.0, -1.1), (-80.0, 1.1, 80.0, 1.1)])


@dataclass
class Drive:
    """True poses (n, 3), from the origin, what the wheels said (n, 3), and the scans."""

    truth: Array
    odometry: Array
    scans: list[Scan]


def drive(walls: Array, increments: Array, seed: int = 0, noise: float = 0.01, *, scale: float = 1.05,
          turn: float = 0.004) -> Drive:  # fmt: skip
    """A drive by ``increments`` (n, 3) with wheels ``scale`` too large, which turn ``turn`` rad too far a scan."""
    rng = np.random.default_rng(seed)
    truth = geometry.accumulate(increments)
    ranges = true_ranges(walls, geometry.compose(truth, [*SENSOR, 0.0]), ANGLES)[0]
    scans = []
    for k, exact in enumerate(ranges):
        seen = exact < 25.0
        distance = exact[seen] + noise * rng.standard_normal(seen.sum())
        points = SENSOR + np.stack([distance * np.cos(ANGLES[seen]), distance * np.sin(ANGLES[seen])], axis=-1)
        scans.append(Scan(k, 0.05 * k, points, SENSOR))
    moving = np.abs(increments).sum(axis=1)[:, None] > 0
    wrong = rng.normal([0.0, 0.0, turn], 1e-3, truth.shape)
    odometry = increments * [scale, scale, 1.0] + moving * wrong
    return Drive(truth, odometry, scans)


def circle(scans: int = 240) -> Array:
    """Once round the pillar on a circle of 1.5 m radius, in steps of 4 cm and 1.5 degrees; then 5 scans of rest."""
    increments = np.tile([2 * np.pi * 1.5 / 240, 0.0, 2 * np.pi / 240], (scans + 5, 1))
    increments[0] = increments[scans:] = 0.0
    return increments


def config(**settings: object) -> RbpfConfig:
    return load_config("default", ["particles=6"]).model_copy(update=settings)


def run(
    slam: RaoBlackwellizedFilter,
    recorded: Drive,
    look: Callable[[int, Estimate], None] | None = None,
    known: NDArray[np.bool_] | None = None,
) -> list[Estimate]:
    """As replay does it; ``look`` is called after every scan. ``WRITTEN`` is whether each was written into the maps.

    ``known`` (n,) is where the odometry says something.
    """
    WRITTEN.clear()
    out = []
    for k, scan in enumerate(recorded.scans):
        if k:
            slam.predict(recorded.odometry[k], 0.05, known is None or bool(known[k]))
        slam.update(scan)
        slam.update_map(scan)
        slam.resample()
        out.append(slam.estimate())
        WRITTEN.append(slam._keyed)
        if look:
            look(k, out[-1])
    return out


def known(log_odds: NDArray[np.float32], origin: tuple[int, int]) -> dict[tuple[int, int], float]:
    """The log-odds of the cells that are not 0, counted from the world's origin."""
    return {
        (row - origin[0], column - origin[1]): float(log_odds[row, column])
        for row, column in np.argwhere(log_odds).tolist()
    }


def distance_to_walls(points: Array, walls: Array) -> Array:
    """Distance (m,) from every point to the nearest wall."""
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    share = ((points[:, None] - start) * along).sum(-1) / (along**2).sum(-1)
    away = points[:, None] - start - share.clip(0, 1)[..., None] * along
    nearest: Array = np.hypot(away[..., 0], away[..., 1]).min(axis=1)
    return nearest


def final_error(truth: Array, poses: Array) -> tuple[float, float]:
    """Root mean square of distances in m and of headings in degrees."""
    error = trajectory_error(truth, poses)
    return error.position_rmse, error.heading_rmse


@pytest.fixture(scope="module")
def in_the_room() -> Drive:
    return drive(ROOM, circle())


# The whole of it


@pytest.mark.parametrize("seed", [0, 1])
def test_round_the_room(in_the_room: Drive, seed: int) -> None:
    """Wheels 5 % off and 55 degrees too far round in the end: centimetres at once, half a centimetre in hindsight."""
    slam = RaoBlackwellizedFilter(config(seed=seed))
    estimates = run(slam, in_the_room)
    truth = in_the_room.truth
    reckoned, turned = final_error(truth, geometry.accumulate(in_the_room.odometry))
    assert reckoned > 0.4 and turned > 20
    online = final_error(truth, np.array([e.best for e in estimates]))
    assert online[0] < 0.03 and online[1] < 0.8
    assert final_error(truth, np.array([e.mean for e in estimates]))[0] < 0.03
    hindsight = final_error(truth, slam.trajectory())
    assert hindsight[0] < 0.025
    slam.finish()
    smoothed = final_error(truth, slam.trajectory())
    assert smoothed[0] < 0.01 and smoothed[1] < 0.2


def test_the_map_shows_the_walls_where_they_are(in_the_room: Drive) -> None:
    """Occupied cells lie within 7 cm of a wall, every stretch of wall that was in view is there, free is free."""
    slam = RaoBlackwellizedFilter(config())
    run(slam, in_the_room)
    for _ in range(2):
        grid = slam.grid
        cells = grid.centers(np.argwhere(grid.occupied))
        away = distance_to_walls(cells, ROOM)
        assert np.mean(away < 0.07) > 0.97 and away.max() < 0.2
        along = np.column_stack([np.linspace(-2.5, 3.5, 100), np.full(100, 4.5)])
        along = along[(along[:, 0] < -0.6) | (along[:, 0] > 1.1)]
        nearest = np.hypot(*(along[:, None] - cells).transpose(2, 0, 1)).min(axis=1)
        assert np.mean(nearest < 0.1) > 0.95
        free = grid.cells(in_the_room.truth[:, :2])
        assert (grid.log_odds[free[:, 0], free[:, 1]] < 0).all()
        np.testing.assert_array_equal(grid.occupied, grid.log_odds > 0)
        slam.finish()


def test_the_map_in_hindsight_is_drawn_from_the_trajectory_in_hindsight(in_the_room: Drive) -> None:
    slam = RaoBlackwellizedFilter(config())
    run(slam, in_the_room)
    before = known(slam.grid.log_odds, slam.grid.origin)
    slam.finish()
    drawn = TileMaps(1, TileSettings.of(slam.config))
    for key in slam._history.keys:
        points = in_the_room.scans[key].points.astype(np.float32).astype(np.float64)
        drawn.write(slam.trajectory()[key][None], points, SENSOR)
    after = known(slam.grid.log_odds, slam.grid.origin)
    assert after == known(*drawn.log_odds_of(0)) != before


@pytest.fixture(scope="module")
def office(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """15 s in a simulated office, with wheels 5 % off and a gyro that drifts by 1.1 degrees a second."""
    folder = tmp_path_factory.mktemp("office") / "simulated"
    return ece276a.load(simulate(folder, seed=5, duration=15.0, frames=False, wheel_scale=1.05, gyro_bias=0.02))


def replayed(recording: Recording, settings: RbpfConfig) -> Result:
    replay = Replay(recording, settings, texture=False)
    for _ in replay:
        pass
    return replay.result()


def test_in_a_simulated_office(office: Recording) -> None:
    """The shipped configuration, 600 scans of 1081 beams, 10 m: 1 cm and 0.15 degrees, dead reckoning far off."""
    result = replayed(office, load_config("default"))
    assert result.truth is not None and len(result.estimate) == len(office)
    smoothed, online, reckoned = (
        final_error(result.truth, poses) for poses in (result.estimate, result.online, result.dead_reckoning)
    )
    assert smoothed[0] < 0.015 and smoothed[1] < 0.15
    assert online[0] < 0.05 and online[1] < 0.6
    assert reckoned[0] > 10 * smoothed[0]


# The same, and not the same


def test_the_same_seed_gives_the_same_bit_for_bit(in_the_room: Drive) -> None:
    a, b, c = (RaoBlackwellizedFilter(config(seed=seed)) for seed in (3, 3, 4))
    short = Drive(in_the_room.truth[:90], in_the_room.odometry[:90], in_the_room.scans[:90])
    first, second, other = (run(slam, short) for slam in (a, b, c))
    for one, two in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.particles, two.particles)
        np.testing.assert_array_equal(one.weights, two.weights)
        np.testing.assert_array_equal(one.parents, two.parents)
    assert any(not np.array_equal(one.particles, two.particles) for one, two in zip(first, other, strict=True))
    for slam in (a, b):
        slam.finish()
    np.testing.assert_array_equal(a.trajectory(), b.trajectory())
    np.testing.assert_array_equal(a.grid.log_odds, b.grid.log_odds)


def test_scans_prepared_before_give_the_same_bit_for_bit(in_the_room: Drive) -> None:
    """Prepared by another filter even, of all scans before the first is used: nothing of the filter is in it."""
    a, b, other = (RaoBlackwellizedFilter(config(seed=3)) for _ in range(3))
    plain = Drive(in_the_room.truth[:90], in_the_room.odometry[:90], in_the_room.scans[:90])
    prepared = Drive(plain.truth, plain.odometry, [other.prepare(scan) for scan in plain.scans])
    assert all(scan.prepared is not None for scan in prepared.scans)
    for one, two in zip(run(a, plain), run(b, prepared), strict=True):
        np.testing.assert_array_equal(one.particles, two.particles)
        np.testing.assert_array_equal(one.weights, two.weights)
    np.testing.assert_array_equal(a.grid.log_odds, b.grid.log_odds)


# Weights, parents, maps


def test_weights_particles_and_maps_belong_together(in_the_room: Drive) -> None:
    """At every scan, with much resampling.

    Weights sum to 1, N_eff is theirs. Between key scans every particle has moved as all have, from its parent. The
    grid is the map of the best particle, or of who descends from it, and that is what drawing all the key scans from
    that particle's own trajectory gives.
    """
    settings = config(particles=8, resampling=ResamplingConfig(policy="n_eff", threshold=0.9))
    slam = RaoBlackwellizedFilter(settings)
    seen: list[Estimate] = []
    counts = {"key": 0, "resampled": 0, "carried": 0}

    def look(k: int, e: Estimate) -> None:
        assert e.weights.sum() == pytest.approx(1.0) and (e.weights >= 0).all() and np.isfinite(e.particles).all()
        assert e.n_eff == pytest.approx(1 / (e.weights**2).sum())
        np.testing.assert_array_equal(e.best, e.particles[np.argmax(e.weights)])
        np.testing.assert_allclose(e.mean, geometry.mean_pose(e.particles, e.weights), atol=1e-9)
        assert e.parents.shape == (8,) and e.parents.min() >= 0 and e.parents.max() < 8
        if seen and not seen[-1].resampled:
            np.testing.assert_array_equal(e.parents, np.arange(8))
        assert e.resampled == (WRITTEN[k] and e.n_eff < 0.9 * 8)
        counts["key"] += WRITTEN[k]
        counts["resampled"] += e.resampled
        if seen and WRITTEN[k - 1] and not WRITTEN[k]:
            moved = geometry.between(seen[-1].particles[e.parents], e.particles)
            np.testing.assert_allclose(moved, np.tile(moved[0], (8, 1)), atol=1e-9)
            counts["carried"] += seen[-1].resampled
        if WRITTEN[k]:
            best = int(np.argmax(e.weights))
            index = int(np.argmax(slam._ancestors == best)) if e.resampled else best
            log_odds, origin = slam._maps.log_odds_of(index)
            np.testing.assert_array_equal(slam.grid.log_odds, log_odds)
            assert slam.grid.origin == origin
            key_poses = slam._history.key_poses(index)
            np.testing.assert_array_equal(key_poses[-1], e.best)
            if counts["key"] % 5 == 1:
                drawn = TileMaps(1, TileSettings.of(settings))
                for pose, key in zip(key_poses, slam._history.keys, strict=True):
                    drawn.write(pose[None], in_the_room.scans[key].points.astype(np.float32).astype(np.float64), SENSOR)
                assert known(*drawn.log_odds_of(0)) == known(log_odds, origin)
        seen.append(e)

    run(slam, in_the_room, look)
    assert counts["key"] > 40 and counts["resampled"] > 5 and counts["carried"] > 2


def test_parents_are_the_ancestors_that_history_knows(in_the_room: Drive) -> None:
    """Following the estimates' parents from the last scan back gives the key poses of the history."""
    slam = RaoBlackwellizedFilter(config(particles=8, resampling=ResamplingConfig(policy="n_eff", threshold=0.9)))
    estimates = run(slam, in_the_room)
    for particle in range(8):
        at, poses = int(slam._ancestors[particle]), []
        for k, e in reversed(list(enumerate(estimates))):
            if WRITTEN[k]:
                poses.append(e.particles[at])
            at = int(e.parents[at])
        np.testing.assert_array_equal(slam._history.key_poses(particle), poses[::-1])
    assert len({tuple(pose) for pose in (slam._history.key_poses(p)[2] for p in range(8))}) < 8


def test_a_scan_is_used_after_so_much_driving_or_turning(in_the_room: Drive) -> None:
    """4 cm and 1.5 degrees a scan, and the wheels' errors: every 5th scan reaches 0.2 m, every 4th 0.1 rad."""
    short = Drive(in_the_room.truth[:61], in_the_room.odometry[:61], in_the_room.scans[:61])
    for distance, angle in ((0.2, 9.0), (9.0, 0.1)):
        settings = RaoBlackwellizedConfig(update_distance=distance, update_angle=angle)
        slam = RaoBlackwellizedFilter(config(rao_blackwellized=settings))
        estimates = run(slam, short)
        expected, driven, turned = [0], 0.0, 0.0
        for k in range(1, 61):
            driven += math.hypot(*short.odometry[k, :2])
            turned += abs(short.odometry[k, 2])
            if driven >= distance or turned >= angle:
                expected.append(k)
                driven = turned = 0.0
        assert [k for k in range(61) if WRITTEN[k]] == expected == slam._history.keys
        assert 10 < len(expected) < 20
        assert all((e.match is not None) == written for e, written in zip(estimates[1:], WRITTEN[1:], strict=True))


def test_far_points_are_neither_matched_nor_drawn(in_the_room: Drive) -> None:
    """With a reach of 2 m from the lidar nothing farther is in the map."""
    near = RaoBlackwellizedConfig(max_range=2.0)
    slam = RaoBlackwellizedFilter(config(rao_blackwellized=near))
    scan = in_the_room.scans[0]
    slam.update(scan)
    slam.update_map(scan)
    cells = slam.grid.centers(np.argwhere(slam.grid.occupied))
    away = np.hypot(*(cells - SENSOR).T)
    assert 1.9 < away.max() < 2.05
    assert np.hypot(*(scan.points - SENSOR).T).max() > 3.5
    assert (slam.grid.log_odds < 0).sum() > 100


# What the scans leave open, and what they do not say at all


def test_the_match_says_what_it_changed(in_the_room: Drive) -> None:
    """The correction leads from the odometry's pose to the best particle; it is about the odometry's known error."""
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, in_the_room)
    keys = np.flatnonzero(WRITTEN).tolist()
    corrections = []
    for last, key in pairwise(keys):
        match = estimates[key].match
        assert match is not None and match.degenerate is None and 0.5 < match.score <= 1.0
        said = geometry.accumulate(in_the_room.odometry[last + 1 : key + 1])[-1]
        true = geometry.between(in_the_room.truth[last], in_the_room.truth[key])
        corrections.append(np.array([match.correction, geometry.between(said, true)]))
    found, expected = np.mean(corrections, axis=0)
    assert expected[2] < -0.01 and expected[0] < -0.005
    np.testing.assert_allclose(found, expected, atol=1.5e-3)


def test_a_bare_corridor_is_left_to_the_odometry() -> None:
    """Weaving down a corridor along x: that axis is told; in hindsight the length is the wheels', 5 % too much."""
    heading = 0.3 * np.sin(np.linspace(0, 2 * np.pi, 81))
    increments = np.column_stack([np.full(81, 0.05), np.zeros(81), np.diff(heading, prepend=0.0)])
    increments[0] = 0.0
    seen = drive(CORRIDOR, increments, turn=0.002)
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, seen)
    axes = [e.match.degenerate for e in estimates if e.match is not None]
    assert len(axes) > 15
    for axis in axes:
        assert axis is not None and np.hypot(*axis) == pytest.approx(1.0) and abs(axis[0]) > 0.999
    wheels = geometry.accumulate(seen.odometry)
    assert np.abs(wheels[-1, 1] - seen.truth[-1, 1]) > 0.15  # the wheels turned away
    for poses in (np.array([e.mean for e in estimates]), slam.trajectory()):
        assert np.abs(poses[:, 1] - seen.truth[:, 1]).max() < 0.035
        assert np.abs(poses[:, 2] - seen.truth[:, 2]).max() < 0.015
    slam.finish()
    assert slam.trajectory()[-1, 0] == pytest.approx(wheels[-1, 0], abs=0.05)
    assert wheels[-1, 0] > seen.truth[-1, 0] + 0.18


# Wheels that are wrong, and no wheels at all


def test_turning_that_the_wheels_do_not_see_makes_key_scans() -> None:
    """Carried round on the spot by 25 degrees, half a degree a scan, while the wheels rest; then driving on for 1 m.

    A key scan comes every 1.3 times 0.15 rad, 11.2 degrees, so two of them; the heading is kept to half a degree there.
    """
    turn = np.tile([0.0, 0.0, math.radians(0.5)], (51, 1))
    turn[0] = 0.0
    straight = np.tile([0.04, 0.0, 0.0], (26, 1))
    recorded = drive(ROOM, np.vstack([turn, straight]), scale=1.0, turn=0.0)
    recorded.odometry[:51] = 0.0
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, recorded)
    keys = [k for k in range(1, 51) if WRITTEN[k]]
    assert keys and keys[0] <= math.ceil(math.degrees(1.3 * 0.15) / 0.5) + 1 and len(keys) == 2
    assert np.diff(keys).min() >= 15
    for k in keys:
        assert estimates[k].mean[2] == pytest.approx(recorded.truth[k, 2], abs=math.radians(0.5))
    best = np.array([e.best for e in estimates])
    missed = best[51:] - recorded.truth[51:]
    assert np.hypot(missed[:, 0], missed[:, 1]).max() < 0.05 and np.abs(missed[:, 2]).max() < math.radians(0.8)
    slam.finish()
    missed = slam.trajectory()[51:] - recorded.truth[51:]
    assert np.hypot(missed[:, 0], missed[:, 1]).max() < 0.03 and np.abs(missed[:, 2]).max() < math.radians(0.35)


def without_odometry(recorded: Drive) -> tuple[RaoBlackwellizedFilter, list[Estimate]]:
    """Nothing known, and nonsense said."""
    wild = Drive(recorded.truth, np.full_like(recorded.odometry, 7.0), recorded.scans)
    slam = RaoBlackwellizedFilter(config())
    return slam, run(slam, wild, known=np.zeros(len(recorded.scans), np.bool_))


def test_the_room_without_odometry(in_the_room: Drive) -> None:
    """Once round by the scans alone: centimetres at once, and in hindsight as good as with odometry."""
    slam, estimates = without_odometry(in_the_room)
    online = final_error(in_the_room.truth, np.array([e.best for e in estimates]))
    assert online[0] < 0.04 and online[1] < 1.0
    assert 20 < sum(WRITTEN) < 80
    slam.finish()
    smoothed = final_error(in_the_room.truth, slam.trajectory())
    assert smoothed[0] < 0.012 and smoothed[1] < 0.25


def test_a_corridor_with_an_end_without_odometry() -> None:
    """4 m towards the end wall, of which the lidar sees what is within 25 m: the position is the scans' to centimetres.

    Until the robot has moved it is taken to stand; it starts gently, as robots do.
    """
    speed = np.minimum(0.05, 0.002 * np.arange(110.0))
    walls = np.vstack([CORRIDOR, [(9.0, -1.1, 9.0, 1.1), (6.0, 0.9, 6.6, 0.9), (6.0, 0.9, 6.0, 1.1)]])
    recorded = drive(walls, np.column_stack([speed, np.zeros(110), np.zeros(110)]))
    assert recorded.truth[-1, 0] > 4.0
    slam, estimates = without_odometry(recorded)
    missed = np.array([e.mean for e in estimates]) - recorded.truth
    assert np.abs(missed[:, 0]).max() < 0.08 and np.abs(missed[:, 1]).max() < 0.04
    assert np.abs(missed[:, 2]).max() < math.radians(0.8)
    slam.finish()
    missed = slam.trajectory() - recorded.truth
    assert np.abs(missed[:, :2]).max() < 0.03 and np.abs(missed[:, 2]).max() < math.radians(0.3)


def test_odometry_that_comes_and_goes(in_the_room: Drive) -> None:
    """Unknown for scans 60 to 119: history says for how long before each key scan, and no more than that."""
    known = np.ones(len(in_the_room.scans), np.bool_)
    known[60:120] = False
    wild = in_the_room.odometry.copy()
    wild[60:120] = 7.0
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, Drive(in_the_room.truth, wild, in_the_room.scans), known=known)
    assert final_error(in_the_room.truth, np.array([e.best for e in estimates]))[0] < 0.04
    keys = np.array(slam._history.keys)
    before = [np.count_nonzero(~known[first + 1 : key + 1]) for first, key in pairwise([0, *keys.tolist()[1:]])]
    np.testing.assert_allclose(slam._history.unknown()[1:, 0], 0.05 * np.array(before), atol=1e-9)
    assert sum(before) == 60
    assert np.abs(slam._history.odometry()).max() < 1.0  # not one of the 7 m
    slam.finish()
    assert final_error(in_the_room.truth, slam.trajectory())[0] < 0.012


@pytest.mark.parametrize("slip", [(0.4, 0.0, 0.0), (0.0, 0.0, 0.35), (-0.2, 0.15, -0.2)])
def test_scans_overrule_a_wild_step_of_the_wheels(in_the_room: Drive, slip: tuple[float, float, float]) -> None:
    """Half a metre or 20 degrees in one scan that did not happen: it leaves no trace of more than centimetres."""
    recorded = Drive(in_the_room.truth[:120], in_the_room.odometry[:120].copy(), in_the_room.scans[:120])
    recorded.odometry[60] += slip
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, recorded)
    missed = np.array([e.best for e in estimates]) - recorded.truth
    assert np.hypot(missed[:, 0], missed[:, 1]).max() < 0.06
    assert np.abs(geometry.wrap(missed[:, 2])).max() < math.radians(1.5)
    slam.finish()
    smoothed = final_error(recorded.truth, slam.trajectory())
    assert smoothed[0] < 0.012 and smoothed[1] < 0.25


def test_a_match_that_explains_nothing_does_not_overrule_good_odometry(in_the_room: Drive) -> None:
    """Two scans at the same place, and odometry that says so: a match 30 cm away is believed only if more fits there.

    0.3 m are 30 standard deviations of 1 cm, the noise of such a match and more than the 0.5 cm of wheels at rest:
    Student's t says ln p falls by 2.5 ln(1 + 720 / 2), 14.7 of it. An end point that is explained gives 0.1 ln 10, so
    64 of them are asked for, of 271.
    """
    slam = RaoBlackwellizedFilter(config(rao_blackwellized=RaoBlackwellizedConfig(temper=0.1, floor=0.1)))
    for scan in (in_the_room.scans[0], in_the_room.scans[0]):
        slam._remember(scan)
    size = slam._scans.size_of(1)
    there = slam._scans.match(
        np.array([0]), np.array([1]), np.zeros((1, 3)), np.ones(3), np.array([0.1]), iterations=0
    ).overlap[0]
    assert there > 0.9
    known = np.array([0.005, 0.005, 0.002])

    def believed(away: float, explained: float) -> bool:
        pose = np.array([[away, 0.0, 0.0]])
        found = Matches(pose, np.zeros((1, 3, 3)), np.array([there + explained / size]), np.zeros(1))
        return slam._believable(found, known)

    asked = 2.5 * math.log1p(0.3**2 / (0.01**2 + 0.005**2) / 2) / (0.1 * math.log(10.0))
    assert asked == pytest.approx(64, abs=1)
    assert believed(0.3, asked + 1) and not believed(0.3, asked - 1) and not believed(0.3, 0.0)
    assert believed(0.03, 0.0) and not believed(0.035, 0.0)  # 3 standard deviations are 3.35 cm


def test_a_crowd_round_the_robot_does_not_carry_it_away(in_the_room: Drive) -> None:
    """For 20 scans people stand round the robot, each time elsewhere, and hide the room.

    A third of one scan's end points or so match the other's from some heading. The wheels have shown by then how good
    they are, and so little does not overrule them.
    """
    n, rng = 220, np.random.default_rng(0)
    scans = list(in_the_room.scans[:n])
    for k in range(180, 200):
        bearings = np.linspace(-2.3, 2.3, 100)
        legs = np.repeat(rng.uniform(0.5, 1.5, 20), 5)  # five beams each
        points = SENSOR + legs[:, None] * np.column_stack([np.cos(bearings), np.sin(bearings)])
        scans[k] = Scan(k, scans[k].stamp, points, SENSOR)
    increments = circle()[:n]
    good = increments + (np.abs(increments).sum(axis=1) > 0)[:, None] * rng.normal(0, 5e-4, increments.shape)
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, Drive(in_the_room.truth[:n], good, scans))
    missed = np.array([e.best for e in estimates]) - in_the_room.truth[:n]
    assert np.hypot(missed[:, 0], missed[:, 1]).max() < 0.1 and np.abs(geometry.wrap(missed[:, 2])).max() < 0.05


@pytest.mark.parametrize("blind", ["all", "first", "middle"])
def test_scans_without_any_point_run_through(in_the_room: Drive, blind: str) -> None:
    """Nothing seen: the odometry leads on, the weights stay equal, and what is seen later counts as ever."""
    n = 60
    empty = {"all": range(n), "first": range(3), "middle": range(20, 35)}[blind]
    scans = [
        Scan(k, scan.stamp, np.zeros((0, 2)), SENSOR) if k in empty else scan
        for k, scan in enumerate(in_the_room.scans[:n])
    ]
    slam = RaoBlackwellizedFilter(config())
    recorded = Drive(in_the_room.truth[:n], in_the_room.odometry[:n], scans)
    estimates = run(slam, recorded)
    assert all(np.isfinite(e.particles).all() and e.weights.sum() == pytest.approx(1.0) for e in estimates)
    slam.finish()
    assert slam.trajectory().shape == (n, 3) and np.isfinite(slam.trajectory()).all()
    if blind == "all":
        assert not slam.grid.log_odds.any()
        reckoned = geometry.accumulate(recorded.odometry)
        assert np.hypot(*(slam.trajectory() - reckoned)[:, :2].T).max() < 0.5
    else:
        moved = geometry.between(slam.trajectory()[40], slam.trajectory()[-1])
        true = geometry.between(recorded.truth[40], recorded.truth[-1])
        np.testing.assert_allclose(moved, true, atol=0.03)


def test_a_robot_that_stands_still(in_the_room: Drive) -> None:
    """One key scan, no motion, the map drawn once; and nothing to smooth."""
    still = Drive(np.zeros((30, 3)), np.zeros((30, 3)), in_the_room.scans[:1] * 30)
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, still)
    assert WRITTEN == [True] + [False] * 29
    slam.finish()
    for poses in (np.array([e.best for e in estimates]), slam.trajectory()):
        np.testing.assert_array_equal(poses, np.zeros((30, 3)))
    once = TileMaps(1, TileSettings.of(slam.config))
    once.write(np.zeros((1, 3)), in_the_room.scans[0].points, SENSOR)
    np.testing.assert_array_equal(slam.grid.log_odds > 0, once.log_odds_of(0)[0] > 0)


def test_at_rest_after_a_drive_nothing_moves(in_the_room: Drive) -> None:
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, in_the_room)
    assert not any(WRITTEN[-4:])
    for e in estimates[-4:]:
        assert e.match is None and not e.resampled
        np.testing.assert_allclose(e.mean, estimates[-5].mean, atol=1e-9)
    np.testing.assert_allclose(slam.trajectory()[-5:], np.tile(slam.trajectory()[-1], (5, 1)), atol=1e-9)


def test_before_the_first_scan_nothing_is_known() -> None:
    slam = RaoBlackwellizedFilter(config())
    assert not slam.grid.log_odds.any()
    np.testing.assert_array_equal(slam.best, np.zeros(3))
    assert slam.trajectory().shape == (0, 3)
    slam.finish()
    assert slam.trajectory().shape == (0, 3) and slam.closures == ()


def test_one_particle_is_enough(in_the_room: Drive) -> None:
    slam = RaoBlackwellizedFilter(config(particles=1))
    estimates = run(slam, in_the_room)
    assert all(e.weights.tolist() == [1.0] and not e.resampled for e in estimates)
    assert final_error(in_the_room.truth, np.array([e.best for e in estimates]))[0] < 0.05


def test_without_smoothing_the_trajectory_stays_the_best_particles(in_the_room: Drive) -> None:
    """A pose a scan, which ends where the best particle is; finishing changes neither it nor the map."""
    slam = RaoBlackwellizedFilter(
        config(smoothing=SmoothingConfig(enabled=False), resampling=ResamplingConfig(policy="n_eff", threshold=1e-9))
    )
    estimates = run(slam, in_the_room)
    trajectory, log_odds = slam.trajectory(), slam.grid.log_odds.copy()
    assert len(trajectory) == len(in_the_room.truth) and not any(e.resampled for e in estimates)
    best = int(np.argmax(estimates[-1].weights))
    np.testing.assert_allclose(trajectory[-1], estimates[-1].best, atol=1e-9)
    for k, e in enumerate(estimates):
        if WRITTEN[k]:
            np.testing.assert_allclose(trajectory[k], e.particles[best], atol=1e-12)
    slam.finish()
    np.testing.assert_array_equal(slam.trajectory(), trajectory)
    np.testing.assert_array_equal(slam.grid.log_odds, log_odds)


def test_the_maps_numbers_are_the_configurations(in_the_room: Drive) -> None:
    slam = RaoBlackwellizedFilter(
        config(map=MapConfig(cell=0.1, log_odds_hit=0.5, log_odds_miss=0.25, log_odds_bound=1.5))
    )
    scan = in_the_room.scans[0]
    slam.update(scan)
    slam.update_map(scan)
    assert slam.grid.cell == 0.1
    assert slam.grid.log_odds.max() <= 1.5 and slam.grid.log_odds.min() == -1.5
    assert set(np.unique(slam.grid.log_odds[slam.grid.log_odds < 0] / 0.25 % 1)) == {0.0}


def test_wheels_that_read_zero_are_overruled() -> None:
    """For four scans of a turn of 7 degrees a scan the wheels say nothing, three times over: 86 degrees lost."""
    increments = circle()[:180].copy()
    increments[1:, 2] *= 2.0
    for at in (40, 90, 130):
        increments[at : at + 4] = [0.0, 0.0, math.radians(7.2)]
    seen = drive(ROOM, increments, scale=1.0, turn=0.0)
    for at in (40, 90, 130):
        seen.odometry[at : at + 4] = 0.0
    assert final_error(seen.truth, geometry.accumulate(seen.odometry))[1] > 30.0
    slam = RaoBlackwellizedFilter(config())
    estimates = run(slam, seen)
    online = final_error(seen.truth, np.array([e.best for e in estimates]))
    assert online[0] < 0.05 and online[1] < 2.0
    assert any(WRITTEN[40:44])  # a key scan, though the odometry saw no motion


@pytest.mark.parametrize("sigmas", [0.2, 0.3, -3.0])
def test_the_settled_trajectory_is_kept_if_the_scans_prefer_it(
    in_the_room: Drive, sigmas: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a quarter of a standard error on; else the trajectory and the map stay as they were."""
    monkeypatch.setattr(rao_blackwellized, "compare", lambda *_, **__: Verdict(0.01, sigmas, 100))
    slam = RaoBlackwellizedFilter(config())
    run(slam, Drive(in_the_room.truth[:90], in_the_room.odometry[:90], in_the_room.scans[:90]))
    assert slam.kept is None
    before, log_odds = slam.trajectory(), slam.grid.log_odds.copy()
    slam.finish()
    settled = sigmas > 0.25
    assert slam.kept == Kept("settled" if settled else "online", 0.01, sigmas)
    assert bool((slam.trajectory() == before).all()) != settled
    assert (slam.grid.log_odds.shape == log_odds.shape and bool((slam.grid.log_odds == log_odds).all())) != settled


@pytest.mark.parametrize(("asked", "settled"), [(-2.0, True), (-1.0, False)])
def test_the_settled_trajectory_is_kept_for_the_odometrys_sake_if_the_scans_are_not_sure(
    in_the_room: Drive, asked: float, settled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """1.5 standard errors against it, where as many as ``asked`` are enough."""
    monkeypatch.setattr(rao_blackwellized, "compare", lambda *_, **__: Verdict(-0.01, -1.5, 100))
    monkeypatch.setattr(Smoother, "asked_of", lambda *_: asked)
    slam = RaoBlackwellizedFilter(config())
    run(slam, Drive(in_the_room.truth[:90], in_the_room.odometry[:90], in_the_room.scans[:90]))
    slam.finish()
    assert slam.kept == Kept("settled" if settled else "online", -0.01, -1.5)


def test_the_scans_where_good_odometry_contradicts_what_was_kept_are_named(
    in_the_room: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The steps to the fourth and to the last key scan, of the poses that are kept."""
    asked: list[NDArray[np.float64]] = []

    def doubted(self: Smoother, poses: NDArray[np.float64], errors: object = None) -> NDArray[np.bool_]:
        asked.append(poses)
        return np.isin(np.arange(len(poses) - 1), [2, len(poses) - 2])

    slam = RaoBlackwellizedFilter(config())
    run(slam, Drive(in_the_room.truth[:90], in_the_room.odometry[:90], in_the_room.scans[:90]))
    monkeypatch.setattr(Smoother, "doubted", doubted)
    slam.finish()
    keys = slam._history.keys
    assert slam.kept is not None and slam.kept.doubted == (keys[3], keys[-1]) and keys[3] > 3
    np.testing.assert_array_equal(asked[-1], slam._key_poses())


def test_what_revisions_found_of_the_matches_is_known_at_the_end() -> None:
    slam = RaoBlackwellizedFilter(config())
    for misled in (False, True):
        slam._reviser.misled = misled
        assert slam._smoother(slam.config).misled == misled


@pytest.mark.parametrize(("learned", "held", "turn"), [(0.8, 1.0, 0.8), (1.2, 1.0, 1.2), (0.8, 0.3, 0.3)])
def test_a_heading_that_is_held_is_trusted_by_the_filter_too(
    in_the_room: Drive, learned: float, held: float, turn: float
) -> None:
    """0.1 rad turned at 0.3 rad of noise each, so many times that as learned, or less where it is held: and 2 mrad."""
    slam = RaoBlackwellizedFilter(config(rao_blackwellized=RaoBlackwellizedConfig(noise_angle=0.3)))
    for scan in (in_the_room.scans[0], in_the_room.scans[0]):
        slam._remember(scan)
    slam._errors.angle, slam._turned = learned, 0.1
    slam._reviser.errors.held = held
    assert slam._match_last().odometry[2, 2] == pytest.approx((0.002 + 0.03 * turn) ** -2)


def test_the_settled_trajectory_of_a_round_is_preferred(in_the_room: Drive) -> None:
    slam = RaoBlackwellizedFilter(config())
    run(slam, in_the_room)
    slam.finish()
    assert slam.kept is not None and slam.kept.trajectory == "settled" and slam.kept.sigmas > 3.0
