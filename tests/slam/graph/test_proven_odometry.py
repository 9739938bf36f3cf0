"""Odometry that has proven right, with numbers worked out by hand."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph import proven_odometry, smoothing
from pfslam_viz.slam.graph.drift import joint_deviations
from pfslam_viz.slam.graph.evidence import Verdict
from pfslam_viz.slam.graph.odometry_errors import OdometryErrors
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.proven_odometry import contradicting, greatest_multiple, laid_out, prove, refuted
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import (
    EvidenceConfig,
    GraphConfig,
    OdometryConfig,
    ScanMatchingConfig,
    SmoothingConfig,
)
from pfslam_viz.slam.graph.smoothing import Smoother, odometry_constraints

Array = NDArray[np.float64]

NORMAL = 1.4826
DEVIATION = np.tile([0.1, 0.1, 0.05], (120, 1))
STEPS = np.tile([0.5, 0.0, 0.0], (120, 1))
KNOWN = np.ones(120, np.bool_)


def config(**settings: float) -> OdometryConfig:
    return OdometryConfig().model_copy(update={"proven_least": 1e-6, **settings})


def off_by(errors: Array) -> Array:
    """Poses (121, 3) that go by ``errors`` (120, 3) otherwise than STEPS."""
    return geometry.accumulate(np.vstack([np.zeros(3), STEPS + errors]))


def heading_errors(each: Array) -> Array:
    return np.column_stack([np.zeros((120, 2)), each])


def test_an_error_that_is_the_same_at_every_step_grows_with_the_span() -> None:
    """0.001 at every of 120 steps of deviation 0.05: over n of them n · 0.001 / (0.05 √n); the longest span is 16.

    32 would be more than a quarter of 120.
    """
    steady, deviation = np.full(120, 0.001), np.full(120, 0.05)
    assert greatest_multiple(steady, deviation, 64) == pytest.approx(NORMAL * 0.02 * math.sqrt(16))
    assert greatest_multiple(steady, deviation, 4) == pytest.approx(NORMAL * 0.02 * math.sqrt(4))


def test_errors_that_cancel_do_not_grow() -> None:
    """+- 0.001 in turns: one step is off by 0.02 of its deviation, any even span by nothing."""
    each: Array = np.tile([0.001, -0.001], 60)
    assert greatest_multiple(each, np.full(120, 0.05), 64) == pytest.approx(NORMAL * 0.02)


def test_a_few_great_errors_do_not_count() -> None:
    """Medians: one slip of 1 rad lies in 16 of the 105 spans of 16 steps."""
    each = np.zeros(120)
    each[60] = 1.0
    assert greatest_multiple(each, np.full(120, 0.05), 64) == pytest.approx(0.0, abs=1e-12)


def test_good_odometry_is_proven_in_heading_and_distance_on_their_own() -> None:
    """Headings off by 0.001 at every step: 0.119 times the noise; 5 mm further each time: 0.297 times it."""
    errors = np.column_stack([np.full(120, 0.005), np.zeros(120), np.full(120, 0.001)])
    distance, angle = prove(off_by(errors), STEPS, DEVIATION, KNOWN, config())
    assert distance == 1.0  # not proven
    assert angle == pytest.approx(NORMAL * 0.02 * 4)
    assert prove(off_by(errors), STEPS, DEVIATION, KNOWN, config(proven=0.3))[0] == pytest.approx(NORMAL * 0.05 * 4)
    assert prove(off_by(errors), STEPS, DEVIATION, KNOWN, config(proven=0.1)) == (1.0, 1.0)
    assert prove(off_by(errors), STEPS, DEVIATION, KNOWN, config(proven_least=0.2))[1] == 0.2
    assert prove(off_by(errors), STEPS, DEVIATION, KNOWN, config(proven_span=4))[1] == pytest.approx(NORMAL * 0.02 * 2)


def test_few_motions_prove_nothing() -> None:
    nothing = np.zeros((120, 3))
    assert prove(off_by(nothing), STEPS, DEVIATION, KNOWN, config(proven_motions=121)) == (1.0, 1.0)
    assert prove(off_by(nothing), STEPS, DEVIATION, KNOWN, config(proven_motions=120)) == (1e-6, 1e-6)
    corridor = KNOWN & (np.arange(120) < 59)  # the rest says nothing along it
    assert prove(off_by(nothing), STEPS, DEVIATION, corridor, config()) == (1.0, 1e-6)


def test_how_far_it_drove_is_asked_along_its_way() -> None:
    """A robot that drives sideways, off by 1 mm along: 0.01 of 0.1 m, times 4 over 16 steps."""
    steps = np.tile([0.0, 0.5, 0.0], (120, 1))
    poses = geometry.accumulate(np.vstack([np.zeros(3), 1.002 * steps]))
    assert prove(poses, steps, DEVIATION, KNOWN, config())[0] == pytest.approx(NORMAL * 0.01 * 4)


@pytest.mark.parametrize(
    ("turn", "settings", "expected"),
    [
        (0.06, {}, True),  # over 5 · 0.2 · 0.05 = 0.05 rad
        (0.04, {}, False),
        (0.04, {"doubt": 3.0}, True),
        (0.06, {"doubt_angle": 0.07}, False),
        (-0.06, {}, True),
    ],
)
def test_a_turn_is_doubted_if_proven_odometry_cannot_err_so(
    turn: float, settings: dict[str, float], expected: bool
) -> None:
    poses = off_by(heading_errors(np.where(np.arange(120) == 7, turn, 0.0)))
    found = contradicting(poses, STEPS, DEVIATION, (1.0, 0.2), config(**settings))
    assert np.flatnonzero(found).tolist() == ([7] if expected else [])
    unproven = (0.2, 1.0)
    assert not contradicting(poses, STEPS, DEVIATION, unproven, config(**settings)).any()


@pytest.mark.parametrize(
    ("far", "settings", "expected"),
    [(0.16, {}, True), (0.14, {}, False), (0.14, {"doubt_distance": 0.12}, True), (0.16, {"doubt": 9.0}, False)],
)
def test_a_step_is_doubted_if_proven_odometry_cannot_err_so(
    far: float, settings: dict[str, float], expected: bool
) -> None:
    """5 · 0.2 · 0.1 = 0.1 m, but at least 0.15."""
    errors = np.zeros((120, 3))
    errors[7, :2] = 0.6 * far, 0.8 * far
    found = contradicting(off_by(errors), STEPS, DEVIATION, (0.2, 1.0), config(**settings))
    assert np.flatnonzero(found).tolist() == ([7] if expected else [])
    assert not contradicting(off_by(errors), STEPS, DEVIATION, (1.0, 0.2), config(**settings)).any()


def test_poses_are_laid_out_as_the_odometry_says_but_where_it_slipped_or_is_not_proven() -> None:
    poses = geometry.accumulate(np.array([[1.0, 2.0, 0.0], [9.0, 9.0, math.pi / 2], [9.0, 0.0, 0.0]]))
    steps = np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    never = np.zeros(2, np.bool_)
    straight = [[1.0, 2.0, 0.0], [2.0, 2.0, 0.0], [4.0, 2.0, 0.0]]
    np.testing.assert_allclose(laid_out(poses, steps, (1.0, 0.1), never), straight, atol=1e-12)
    turned = [[1.0, 2.0, 0.0], [2.0, 2.0, math.pi / 2], [2.0, 4.0, math.pi / 2]]
    np.testing.assert_allclose(laid_out(poses, steps, (0.1, 1.0), never), turned, atol=1e-12)
    slipped = [[1.0, 2.0, 0.0], [2.0, 2.0, 0.0], [11.0, 2.0, 0.0]]
    np.testing.assert_allclose(laid_out(poses, steps, (1.0, 0.1), np.array([False, True])), slipped, atol=1e-12)


def test_scans_show_that_the_odometry_slipped_or_that_they_were_matched_wrongly() -> None:
    """Nine key scans in a room; 0.15 rad at the fifth step, once in the odometry and once in the poses."""
    room = np.array([(-3.0, -3, 9, -3), (9, -3, 9, 4), (9, 4, -3, 4), (-3, 4, -3, -3), (2, 1, 4, 1), (4, 1, 4, 4)])
    right = np.tile([0.2, 0.0, 0.0], (8, 1))
    bent = right + np.array([0.0, 0.0, 0.15]) * (np.arange(8) == 4)[:, None]
    truth, wrong = (geometry.accumulate(np.vstack([np.zeros(3), steps])) for steps in (right, bent))
    scans, angles = ScanStore(np.zeros(2), ScanMatchingConfig()), np.linspace(-2.3, 2.3, 361)
    for ranges in true_ranges(room, truth, angles)[0]:
        scans.add(np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=-1))
    joints, evidence = np.arange(8) == 4, EvidenceConfig()
    assert np.flatnonzero(refuted(scans, truth, bent, joints, config(), evidence)).tolist() == [4]
    assert not refuted(scans, wrong, right, joints, config(), evidence).any()
    assert not refuted(scans, truth, bent, ~joints, config(), evidence).any()  # it is not asked there
    assert not refuted(scans, truth, bent, joints, config(doubt_refuted=1.5), evidence).any()


@pytest.mark.parametrize(
    ("hops", "pairs"),
    [
        (1, [(4, 5)]),
        (2, [(3, 5), (4, 5), (4, 6)]),
        (4, [(1, 5), (2, 5), (2, 6), (3, 5), (3, 6), (3, 7), (4, 5), (4, 6), (4, 7), (4, 8)]),
    ],
)
def test_the_scans_about_a_doubted_step_are_asked(
    hops: int, pairs: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those from before it with those after it, no further apart, once for either answer."""
    asked: list[list[tuple[int, int]]] = []

    def agreement_of(scans: object, start: Array, end: Array, increments: Array, rules: object) -> Array:
        asked.append(sorted(zip(start.tolist(), end.tolist(), strict=True)))
        return np.zeros(len(start))

    monkeypatch.setattr(proven_odometry, "agreement_of", agreement_of)
    scans = ScanStore(np.zeros(2), ScanMatchingConfig())
    joints = np.arange(120) == 4
    refuted(scans, off_by(np.zeros((120, 3))), STEPS, joints, config(doubt_hops=hops), EvidenceConfig())
    assert asked == [pairs, pairs]


def test_where_it_slipped_good_odometry_neither_leads_nor_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two steps of the trajectory contradict it; scans show that the first of them was right."""
    smoother = smoother_with(monkeypatch, 0.0)
    at = np.arange(120)
    monkeypatch.setattr(smoothing, "refuted", lambda scans, poses, steps, joints, *_: joints & (at == 7))
    bent = off_by(heading_errors(np.where(at == 7, 0.3, np.where(at == 20, 0.2, 0.0))))
    assert np.flatnonzero(smoother.doubted(bent)).tolist() == [20]
    led: list[Array] = []

    def relax(poses: Array, gates: Array) -> tuple[Array, float]:
        led.append(poses)
        return poses, 1.0

    monkeypatch.setattr(smoother, "relax", relax)
    smoother.straighten(bent)
    np.testing.assert_allclose(led[0], off_by(heading_errors(np.where(at == 7, 0.3, 0.0))), atol=1e-9)
    motion = smoother._motion(led[0], np.ones(120, np.bool_))
    assert np.flatnonzero(motion.robust[120:]).tolist() == [7]  # the headings
    deviation = motion.information[120:, 2, 2] ** -0.5
    assert deviation[7] == pytest.approx(10.0 * deviation[6])


def test_a_proven_heading_is_held_where_scans_match_and_the_position_is_not() -> None:
    """0.06 rad · 0.2 in heading, not robust; the settings' own noise in position, robust; unknown steps as ever."""
    settings = SmoothingConfig(least=0.01, noise_distance=0.1, noise_angle=0.2, noise_drift=0.05)
    errors = OdometryErrors(OdometryConfig())
    errors.held = 0.2
    odometry = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    unknown = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, 0.5, 1.5]])
    c = odometry_constraints(odometry, settings, errors, np.ones(2, np.bool_), unknown)
    assert c.start.tolist() == [0, 1, 0, 1]
    assert c.robust.tolist() == [True, True, False, True]
    np.testing.assert_allclose(c.information[0], np.diag([0.11**-2, 0.11**-2, 0.0]))
    np.testing.assert_allclose(c.information[2], np.diag([0.0, 0.0, 0.012**-2]))
    np.testing.assert_allclose(c.information[3], np.diag([0.0, 0.0, 1.56**-2]))


def test_drift_counts_position_and_heading_that_are_constraints_of_their_own() -> None:
    nothing = np.zeros(0, np.int64)
    matched = Constraints(nothing, nothing, np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, np.bool_))
    information = np.stack([np.diag([4.0, 4.0, 0.0]), np.diag([0.0, 0.0, 100.0])])
    motion = Constraints(np.zeros(2, np.int64), np.ones(2, np.int64), np.zeros((2, 3)), information, np.zeros(2) > 0)
    np.testing.assert_allclose(joint_deviations(matched, motion, 2, 8, np.zeros(2)), [[0.5, 0.1]])


def smoother_with(monkeypatch: pytest.MonkeyPatch, sigmas: float) -> Smoother:
    """121 key scans of which nothing matches; odometry that has proven right; scans that say ``sigmas``."""
    scans = ScanStore(np.zeros(2), ScanMatchingConfig())
    for _ in range(121):
        scans.add(np.zeros((0, 2)))
    odometry = np.vstack([np.zeros(3), STEPS])
    smoother = Smoother(scans, odometry, STEPS, GraphConfig())
    smoother.errors.proven = 0.1, 0.1
    monkeypatch.setattr(smoothing, "compare", lambda *_: Verdict(0.0, sigmas, 9))
    monkeypatch.setattr(smoother, "learn_errors", lambda poses: None)
    return smoother


@pytest.mark.parametrize(("sigmas", "taken"), [(1.0, True), (-1.9, True), (-2.1, False)])
def test_proven_odometry_leads_the_trajectory_unless_scans_are_sure(
    sigmas: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A turn of 0.3 rad that the odometry does not know, and one of 0.01 that would not be doubted by itself.

    No match holds either; the odometry's heading is held, as firmly as it has proven, while all is matched anew.
    """
    smoother = smoother_with(monkeypatch, sigmas)
    at = np.arange(120)
    bent = off_by(heading_errors(np.where(at == 7, 0.3, np.where(at == 20, 0.01, 0.0))))
    straight = off_by(np.zeros((120, 3)))
    relax, held = smoother.relax, list[float]()

    def watched(poses: Array, gates: Array) -> tuple[Array, float]:
        held.append(smoother.errors.held)
        return relax(poses, gates)

    monkeypatch.setattr(smoother, "relax", watched)
    np.testing.assert_allclose(smoother.straighten(bent), straight if taken else bent, atol=1e-6)
    assert held == [0.1, 0.1]
    assert smoother.errors.held == (0.1 if taken else 1.0)
    assert smoother.misled == taken
    assert smoother.straighten(straight) is straight


def test_a_trajectory_that_contradicts_proven_odometry_less_only_must_not_be_clearly_worse(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    smoother = smoother_with(monkeypatch, 0.0)
    bent = off_by(heading_errors(np.where(np.arange(120) == 7, 0.3, 0.0)))
    straight = off_by(np.zeros((120, 3)))
    assert smoother.asked_of(straight, bent, 0.25) == -2.0
    assert smoother.asked_of(bent, straight, 0.25) == 0.25
    assert smoother.asked_of(straight, straight, 0.25) == 0.25
    smoother.errors.proven = 1.0, 1.0
    assert smoother.asked_of(straight, bent, 0.25) == 0.25


def test_where_the_odometry_knew_nothing_nothing_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    smoother = smoother_with(monkeypatch, 0.0)
    smoother._unknown[8] = [0.5, 0.5, 1.5]
    bent = off_by(heading_errors(np.where(np.isin(np.arange(120), [7, 20]), 0.3, 0.0)))
    assert np.flatnonzero(smoother.doubted(bent)).tolist() == [20]
    assert not smoother.doubted(bent, OdometryErrors(OdometryConfig())).any()  # by other errors, unproven
