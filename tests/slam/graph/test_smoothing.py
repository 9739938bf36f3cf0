"""Key scans of a drive round a block of rooms, cast with known truth, smoothed from a start that has drifted."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.odometry_errors import OdometryErrors
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import (
    FilterConstraintsConfig,
    GraphConfig,
    LoopClosingConfig,
    OdometryConfig,
    ScanMatchingConfig,
    SmoothingConfig,
)
from pfslam_viz.slam.graph.smoothing import Smoother, hold_together, match, neighbouring, odometry_constraints

Array = NDArray[np.float64]

ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 181)
NO_LOOPS = LoopClosingConfig(enabled=False)
CORRIDOR = np.array([(-100.0, -1.1, 100.0, -1.1), (-100.0, 1.1, 100.0, 1.1)])
# The poses these tests start from are the odometry's or wrong on purpose, no filter's, which matched them with its map:
# so many walls no scan has, and the graph takes nothing from them but where it starts.
NO_FILTER = FilterConstraintsConfig(fewest_walls=10**6, spans=())


def graph(
    smoothing: SmoothingConfig | None = None,
    loops: LoopClosingConfig = NO_LOOPS,
    given: FilterConstraintsConfig = NO_FILTER,
) -> GraphConfig:
    return GraphConfig(smoothing=smoothing or SmoothingConfig(), loop_closing=loops, filter_constraints=given)


def around(step: float = 0.2) -> Array:
    """Key poses once round the block and 2 m further, turning on the spot at its corners."""
    increments = [(0.0, 0.0, 0.0)]
    for side in (8.0, 6.0, 8.0, 6.0, 2.0):
        increments += [(step, 0.0, 0.0)] * round(side / step) + [(0.0, 0.0, math.pi / 20)] * 10
    return geometry.accumulate(increments[:-10])


def scans_from(walls: Array, poses: Array, rng: np.random.Generator, noise: float = 0.01) -> ScanStore:
    store = ScanStore(np.zeros(2), ScanMatchingConfig())
    for ranges in true_ranges(walls, poses, ANGLES)[0]:
        seen = ranges < 15.0
        noisy = ranges[seen] + noise * rng.standard_normal(seen.sum())
        store.add(np.stack([noisy * np.cos(ANGLES[seen]), noisy * np.sin(ANGLES[seen])], axis=-1))
    return store


def steps_of(poses: Array) -> Array:
    """Increments (k, 3) that lead to each pose; zero for the first."""
    return np.vstack([np.zeros(3), geometry.between(poses[:-1], poses[1:])])


def found(poses: Array) -> Array:
    """What the filter's increments (k - 1, 3) are if these are its poses (k, 3)."""
    return steps_of(poses)[1:]


def drifting(steps: Array, rng: np.random.Generator, scale: float = 1.02, turn: float = 0.002) -> Array:
    """Odometry whose wheels are ``scale`` too large and whose heading drifts by ``turn`` rad a step."""
    moved = np.hypot(steps[:, 0], steps[:, 1])[:, None] > 0
    drifted: Array = steps * [scale, scale, 1.0] + moved * [0.0, 0.0, turn]
    return drifted + moved * rng.normal(0, 0.002, steps.shape)


def rms(poses: Array, truth: Array) -> tuple[float, float]:
    """Root mean square of the distances in m and of the headings in rad."""
    error = poses - truth
    turn = geometry.wrap(error[:, 2])
    return float(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2))), float(np.sqrt(np.mean(turn**2)))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_drifted_round_is_smoothed_to_the_truth(seed: int, block: Array) -> None:
    """1 m or so of drift over 30 m, noise of 1 cm: a centimetre and a tenth of a degree remain."""
    rng = np.random.default_rng(seed)
    truth = around()
    scans = scans_from(block, truth, rng)
    odometry = drifting(steps_of(truth), rng)
    drifted = geometry.accumulate(odometry)
    smoothed = Smoother(scans, odometry, found(drifted), graph()).smooth(drifted)
    assert rms(drifted, truth)[0] > 0.5
    distance, turn = rms(smoothed.poses, truth)
    assert distance < 0.012 and turn < math.radians(0.15)
    np.testing.assert_array_equal(smoothed.poses[0], truth[0])
    assert smoothed.closed.shape == (0, 2)


def test_the_second_visit_is_laid_on_the_first(block: Array) -> None:
    """Where the robot drives the first 2 m again, its poses relative to the first visit are right to a centimetre."""
    rng = np.random.default_rng(3)
    truth = around()
    scans = scans_from(block, truth, rng)
    odometry = drifting(steps_of(truth), rng)
    drifted = geometry.accumulate(odometry)
    smoothed = Smoother(scans, odometry, found(drifted), graph()).smooth(drifted).poses
    missed = geometry.between(geometry.between(smoothed[1], smoothed[-9]), geometry.between(truth[1], truth[-9]))
    assert np.abs(missed[:2]).max() < 0.01 and abs(missed[2]) < 0.004
    alone = Smoother(scans, odometry, found(drifted), graph(SmoothingConfig(neighbours=0)))
    without = alone.smooth(drifted).poses
    assert rms(smoothed, truth)[0] < rms(without, truth)[0]


def test_a_round_that_missed_its_start_is_closed(block: Array) -> None:
    """The odometry errs by metres where the lidar was blind: the start is out of reach, and yet recognised."""
    rng = np.random.default_rng(4)
    truth = around()
    scans = scans_from(block, truth, rng)
    blinded = ScanStore(
        np.zeros(2), ScanMatchingConfig()
    )  # scans 85 to 99 see nothing: only the odometry leads on, and it is wrong there
    for k in range(len(truth)):
        blinded.add(scans.points_of(k)[: 0 if 85 <= k < 100 else None])
    odometry = steps_of(truth)
    odometry[85:100] += [0.12, 0.06, 0.01]
    drifted = geometry.accumulate(odometry)
    assert rms(drifted[-10:], truth[-10:])[0] > 1.5
    config = SmoothingConfig(radius=1.0)
    left = Smoother(blinded, odometry, found(drifted), graph(config)).smooth(drifted)
    loops = LoopClosingConfig(least_reach=3.0)
    closed = Smoother(blinded, odometry, found(drifted), graph(config, loops)).smooth(drifted)
    assert rms(left.poses[-10:], truth[-10:])[0] > 0.5 and len(left.closed) == 0
    assert rms(closed.poses[-10:], truth[-10:])[0] < 0.03
    assert len(closed.closed) > 0
    for earlier, later in closed.closed:
        assert later - earlier > 100 and np.hypot(*(truth[earlier] - truth[later])[:2]) < 3.5


def test_where_the_scans_are_open_odometry_rules() -> None:
    """A bare corridor: the particles were 10 % too far along it and off across it; only the latter is corrected.

    Along it the odometry, 3 % short, is followed; across it and in heading the walls.
    """
    rng = np.random.default_rng(5)
    truth = np.column_stack([0.15 * np.arange(40), 0.1 * np.sin(np.arange(40) / 8), 0.05 * np.cos(np.arange(40) / 8)])
    truth = geometry.between(truth[0], truth)
    walls = geometry.transform(geometry.inverse(np.array([0.0, 0.0, 0.05])), CORRIDOR.reshape(-1, 2)).reshape(-1, 4)
    scans = scans_from(walls, truth, rng)
    odometry = steps_of(truth) * [0.97, 1.0, 1.0]
    start = truth * [1.1, 1.0, 1.0]
    start[1:] += rng.normal(0, [0.0, 0.02, 0.01], (39, 3))
    smoothed = Smoother(scans, odometry, found(start), graph()).smooth(start).poses
    frame = np.array([0.0, 0.0, -0.05])  # the corridor's axis, seen from the first pose
    along, across = geometry.transform(geometry.inverse(frame), smoothed[:, :2] - truth[:, :2]).T
    reckoned = geometry.transform(geometry.inverse(frame), geometry.accumulate(odometry)[:, :2] - truth[:, :2])[:, 0]
    np.testing.assert_allclose(along, reckoned, atol=0.01)
    assert reckoned[-1] < -0.15 and np.abs(across).max() < 0.01
    assert np.abs(geometry.wrap(smoothed[:, 2] - truth[:, 2])).max() < 0.006


def test_scans_that_see_nothing_leave_the_odometry() -> None:
    odometry = np.tile([0.2, 0.01, 0.02], (12, 1))
    scans = ScanStore(np.zeros(2), ScanMatchingConfig())
    for _ in range(12):
        scans.add(np.zeros((0, 2)))
    poses = geometry.accumulate(odometry)
    start = poses + np.linspace(0, 0.1, 12)[:, None]
    smoothed = Smoother(scans, odometry, found(start), graph(loops=LoopClosingConfig())).smooth(start).poses
    np.testing.assert_allclose(geometry.between(start[0], smoothed), geometry.between(poses[0], poses), atol=2e-3)


def test_one_or_two_key_scans_stay_as_they_are(block: Array) -> None:
    poses = np.array([[0.0, 0, 0], [0.3, 0.1, 0.2]])
    scans = scans_from(block, poses, np.random.default_rng(6))
    for k in (1, 2):
        smoother = Smoother(scans, steps_of(poses)[:k], found(poses[:k]), GraphConfig())
        np.testing.assert_array_equal(smoother.smooth(poses[:k]).poses, poses[:k])


# What is matched with what


def test_neighbours_are_some_hops_on_and_the_earlier_visits() -> None:
    poses = np.column_stack([np.arange(12.0) * 10, np.zeros(12), np.zeros(12)])
    pairs = neighbouring(poses, SmoothingConfig())
    expected = [(k, k + hop) for hop in (1, 2, 4, 8) for k in range(12 - hop)]
    assert [tuple(pair) for pair in pairs.tolist()] == expected
    poses[11] = poses[0]
    pairs = neighbouring(poses, SmoothingConfig(apart=5))
    assert [tuple(pair) for pair in pairs.tolist()] == [*expected, (0, 11)]
    assert [tuple(pair) for pair in neighbouring(poses[:2], SmoothingConfig()).tolist()] == [(0, 1)]
    late = [(k, k + hop) for hop in (1, 2, 4, 8) for k in range(12 - hop) if k + hop >= 10]
    pairs = neighbouring(poses, SmoothingConfig(apart=5), since=10)
    assert [tuple(pair) for pair in pairs.tolist()] == [*late, (0, 11)]


# What is believed


def test_matches_become_constraints_and_bad_ones_are_left_out(block: Array) -> None:
    """Scan 2 sees another building. The constraint's information is in the end pose's axes, times the temper."""
    rng = np.random.default_rng(8)
    truth = np.array([[0.0, 0, 0], [0.3, 0.1, math.pi / 2]])
    scans = scans_from(block, truth, rng, noise=0.0)
    scans.add(np.stack([3 * np.cos(ANGLES), 3 * np.sin(ANGLES)], axis=-1))
    wrong = np.vstack([truth[0], truth[1] + np.array([0.04, -0.03, 0.02]), np.zeros(3)])
    config = SmoothingConfig(temper=0.1, distance=0.02)
    pairs = np.array([[0, 1], [0, 2], [1, 2]])
    matched = match(scans, wrong, pairs, np.array([0.3, 0.1]), config)
    assert (matched.start.tolist(), matched.end.tolist(), matched.robust.tolist()) == ([0], [1], [True])
    np.testing.assert_allclose(matched.measured[0], truth[1], atol=2e-3)
    raw = scans.match(
        np.array([0]), np.array([1]), truth[1:], np.full(3, 1e-6), np.array([0.1]), iterations=15
    ).information[0]
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(
        matched.information[0], 0.1 * quarter.T @ raw @ quarter, rtol=0.05, atol=0.02 * raw.max()
    )


def test_the_odometry_is_as_good_as_configured() -> None:
    """0.5 m and 0.2 rad: 1 cm + 0.1 · 0.5 m, and 0.01 + 0.2 · 0.2 + 0.05 · 0.5 rad."""
    config = SmoothingConfig(least=0.01, noise_distance=0.1, noise_angle=0.2, noise_drift=0.05)
    odometry = np.array([[9.0, 9.0, 9.0], [0.3, 0.4, -0.2], [0.0, 0.0, 0.0]])
    c = odometry_constraints(odometry, config, OdometryErrors(OdometryConfig()), np.ones(2, np.bool_))
    assert (c.start.tolist(), c.end.tolist()) == ([0, 1], [1, 2])
    np.testing.assert_array_equal(c.measured, odometry[1:])
    np.testing.assert_allclose(c.information[0], np.diag([0.06**-2, 0.06**-2, 0.075**-2]))
    np.testing.assert_allclose(c.information[1], np.diag([1e4, 1e4, 1e4]))
    assert c.robust.all()


def test_where_no_match_bridges_them_odometry_is_as_good_as_it_has_proven() -> None:
    """Twice as good in position, four times in heading, and 2 % short; the second step is bridged by a match."""
    config = SmoothingConfig(least=0.01, noise_distance=0.1, noise_angle=0.2, noise_drift=0.05)
    errors = OdometryErrors(OdometryConfig())
    errors.scale, errors.distance, errors.angle = 1.02, 0.5, 0.25
    odometry = np.array([[0.0, 0.0, 0.0], [0.3, 0.4, -0.2], [0.3, 0.4, -0.2]])
    c = odometry_constraints(odometry, config, errors, np.array([False, True]))
    np.testing.assert_allclose(c.measured, [[0.306, 0.408, -0.2]] * 2)
    np.testing.assert_allclose(c.information[0], np.diag([0.03**-2, 0.03**-2, 0.01875**-2]))
    np.testing.assert_allclose(c.information[1], np.diag([0.06**-2, 0.06**-2, 0.075**-2]))
    assert c.robust.tolist() == [False, True]


def test_a_firm_step_pulls_less_as_it_is_missed_by_more_but_never_lets_go() -> None:
    """10 sigmas off: with Huber's weights 5 sigmas wide it counts half; a robust one and one that fits, wholly."""
    one = np.eye(3)[None] * 100.0
    poses = np.array([[0.0, 0, 0], [2.0, 0, 0], [3.0, 0, 0], [5.0, 0, 0]])
    motion = Constraints(
        np.arange(3), np.arange(1, 4), np.tile([1.0, 0, 0], (3, 1)), np.repeat(one, 3, axis=0), np.array([0, 0, 1]) > 0
    )
    held = hold_together(poses, motion, 5.0)
    np.testing.assert_allclose(held.information, one * np.array([0.5, 1.0, 1.0])[:, None, None])


@pytest.mark.parametrize("scale", [1.03, 0.97, 1.0])
def test_the_wheels_scale_is_found_where_scans_can_tell(scale: float, block: Array) -> None:
    rng = np.random.default_rng(5)
    truth = around()
    odometry = drifting(steps_of(truth), rng, scale=scale, turn=0.0)
    smoother = Smoother(scans_from(block, truth, rng), odometry, found(truth), GraphConfig())
    assert smoother.learn_errors(truth).scale == pytest.approx(1.0 / scale, abs=0.008)


def test_a_bare_corridor_says_nothing_of_the_wheels() -> None:
    rng = np.random.default_rng(6)
    truth = geometry.accumulate([(0.0, 0.0, 0.0)] + [(0.2, 0.0, 0.0)] * 60)
    odometry = steps_of(truth) * np.array([1.1, 1.1, 1.0])
    smoother = Smoother(scans_from(CORRIDOR, truth, rng), odometry, found(truth), GraphConfig())
    assert smoother.learn_errors(truth).scale == 1.0


def test_the_scale_leaves_out_where_the_odometry_knew_nothing(block: Array) -> None:
    """Half of the steps are nonsense, and known to be."""
    rng = np.random.default_rng(5)
    truth = around()
    odometry = drifting(steps_of(truth), rng, scale=1.03, turn=0.0)
    unknown = np.zeros_like(odometry)
    unknown[::2] = [0.5, 0.5, 1.5]
    odometry[::2] *= 0.85
    scans = scans_from(block, truth, rng)
    errors = Smoother(scans, odometry, found(truth), GraphConfig(), unknown).learn_errors(truth)
    assert errors.scale == pytest.approx(1.0 / 1.03, abs=0.008)
    trusting = Smoother(scans, odometry, found(truth), GraphConfig()).learn_errors(truth)
    assert abs(trusting.scale - 1.0 / 1.03) > 0.02


def test_the_scale_is_the_same_from_matches_that_the_graph_has_as_from_its_own(block: Array) -> None:
    """Without a hop of 1, successive key scans are matched for the purpose; with it they are among the neighbours."""
    rng = np.random.default_rng(5)
    truth = around()
    odometry = drifting(steps_of(truth), rng, scale=1.03, turn=0.0)
    scans = scans_from(block, truth, rng)
    told = []
    for hops in ((1, 2), (2,), (1, 1)):
        config = GraphConfig(smoothing=SmoothingConfig(hops=hops))
        told.append(Smoother(scans, odometry, found(truth), config).learn_errors(truth))
    assert (told[0].scale, told[0].distance, told[0].angle) == (told[1].scale, told[1].distance, told[1].angle)
    assert told[0].scale == told[2].scale != 1.0


def test_good_odometry_proves_right_and_is_held_once_matches_were_wrong(block: Array) -> None:
    """Exact odometry: all there is is the scans' noise, less in heading; that is held only once it has to be."""
    truth = around()
    scans = scans_from(block, truth, np.random.default_rng(5))
    smoother = Smoother(scans, steps_of(truth), found(truth), GraphConfig())
    errors = smoother.learn_errors(truth)
    assert 0.02 < errors.proven[0] < 0.05 and (errors.proven[1], errors.held) == (0.02, 1.0)
    smoother.misled = True
    assert smoother.learn_errors(truth).held == 0.02
    rough = steps_of(truth) + np.random.default_rng(6).normal(0, 0.02, (len(truth), 3))
    assert Smoother(scans, rough, found(truth), GraphConfig()).learn_errors(truth).proven == (1.0, 1.0)


def test_what_was_matched_is_not_matched_again_until_poses_or_gates_change(block: Array) -> None:
    truth = around()
    scans = scans_from(block, truth, np.random.default_rng(5))
    smoother = Smoother(scans, steps_of(truth), found(truth), GraphConfig())
    gates = np.array([0.2, 0.1])
    asked = truth.copy()
    first, _ = smoother._match(asked, gates)
    assert smoother._match(truth.copy(), gates)[0] is first
    assert smoother._match(truth, np.array([0.5, 0.1]))[0] is not first
    again, _ = smoother._match(asked, gates)
    asked[5, 0] += 0.03  # the caller's array, in place
    assert smoother._match(asked, gates)[0] is not again


# What the odometry does not know, and what the filter found out


def test_unknown_odometry_is_less_firm_by_what_may_have_happened() -> None:
    """0.05 + 0.5 m and 0.01 + 0.1 + 1.5 rad on the second step; the first is as ever."""
    config = SmoothingConfig(least=0.01, noise_distance=0.1, noise_angle=0.2, noise_drift=0.05)
    odometry = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.4, 0.0, 0.35]])
    unknown = np.array([[9.0, 9.0, 9.0], [0.0, 0.0, 0.0], [0.5, 0.5, 1.5]])
    errors = OdometryErrors(OdometryConfig())
    errors.distance = errors.angle = 0.5  # what the steps that are known have proven says nothing of this one
    errors.scale = 1.1
    for bridged in (True, False):
        c = odometry_constraints(odometry, config, errors, np.array([True, bridged]), unknown)
        np.testing.assert_allclose(c.measured[1], odometry[2])
        np.testing.assert_allclose(c.information[0], np.diag([0.05**-2, 0.05**-2, 0.03**-2]))
        np.testing.assert_allclose(c.information[1], np.diag([0.55**-2, 0.55**-2, 1.6**-2]))
        assert c.robust.all()


@pytest.mark.parametrize("told", [True, False])
def test_odometry_that_knows_nothing_has_no_say(told: bool) -> None:
    """Ten steps of 0.2 m down a corridor whose end the first and the last two scans see; 60 cm too many are said.

    Those at the end know how far they are from the start. Who knows that steps 4 and 5 are unknown puts it down to
    them; who does not spreads it over all.
    """
    rng = np.random.default_rng(9)
    truth = geometry.accumulate([(0.0, 0.0, 0.0)] + [(0.2, 0.0, 0.0)] * 10)
    scans = ScanStore(np.zeros(2), ScanMatchingConfig())
    seen = scans_from(np.vstack([CORRIDOR, [(4.0, -1.1, 4.0, 1.1)]]), truth, rng)
    for k in range(11):
        points = seen.points_of(k)
        ahead = np.abs(points[:, 1]) < 1.0  # on the wall at the end
        scans.add(points[~ahead if 2 <= k < 9 else slice(None)])
    odometry = steps_of(truth)
    odometry[4:6] = [0.5, 0.0, 0.0]
    unknown = np.zeros_like(odometry)
    unknown[4:6] = [0.25, 0.25, 0.75] if told else 0.0
    smoother = Smoother(scans, odometry, found(truth), graph(SmoothingConfig(scale=1000.0)), unknown)
    missed = (smoother.smooth(truth).poses - truth)[:, 0]
    assert abs(missed[-1]) < 0.02
    if told:
        assert np.abs(missed[[1, 2, 3, 5, 6, 7, 8]]).max() < 0.03
    else:
        assert missed[3] < -0.06 and missed[5] > 0.06


def test_the_filters_increments_hold_where_matches_are_refused(block: Array) -> None:
    """Scans 60 to 63 match no other: there the odometry, 20° amiss, would lead on, did the filter not know better."""
    rng = np.random.default_rng(10)
    truth = around()
    odometry = drifting(steps_of(truth), rng)
    odometry[61] += [0.05, 0.05, 0.35]
    scans = scans_from(block, truth, rng)
    refused = SmoothingConfig(neighbours=0, overlap=1.0)  # not one match is good enough
    without = Smoother(scans, odometry, found(truth), graph(refused)).smooth(truth).poses
    told = graph(refused, given=FilterConstraintsConfig())
    given = Smoother(scans, odometry, found(truth), told).smooth(truth).poses
    assert rms(without, truth)[1] > 0.2
    assert rms(given, truth)[0] < 0.15 and rms(given, truth)[1] < 0.02
