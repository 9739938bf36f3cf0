"""The filter's headings over long spans: by hand, and held where the scans prefer that."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph import smoothing
from pfslam_viz.slam.graph.filter_constraints import heading_spans
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import (
    FilterConstraintsConfig,
    GraphConfig,
    LoopClosingConfig,
    ScanMatchingConfig,
    SmoothingConfig,
)
from pfslam_viz.slam.graph.smoothing import Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

QUARTER = math.pi / 2


# By hand


def test_spans_of_a_drawn_trajectory() -> None:
    """1 m on and a quarter turn left, three times; then 2 m straight on, twice; and a quarter turn right on the spot.

    The key poses, drawn: (0, 0, 0°), (1, 0, 90°), (1, 1, 180°), (0, 1, 270°), (0, -1, 270°), (0, -3, 270°),
    (0, -3, 180°). Over 4 from the first: (0, -1) facing -y; from the third, at (1, 1) facing -x: (0, -3) is 1 m ahead
    and 4 m to the left, and no turn.
    """
    increments = np.array([(1.0, 0.0, QUARTER)] * 3 + [(2.0, 0.0, 0.0)] * 2 + [(0.0, 0.0, -QUARTER)])
    (spans,) = heading_spans(increments, FilterConstraintsConfig(spans=(4,), span_angle=0.1))
    assert (spans.start.tolist(), spans.end.tolist()) == ([0, 2], [4, 6])
    np.testing.assert_allclose(spans.measured, [(0.0, -1.0, -QUARTER), (1.0, 4.0, 0.0)], atol=1e-12)
    np.testing.assert_allclose(spans.information, [np.diag([0.0, 0.0, 50.0])] * 2)  # half of 1 / 0.1²
    assert spans.robust.tolist() == [True, True]


def test_each_kind_of_span_starts_every_half_of_it() -> None:
    """Of 101 key scans: 16 long from every 8th that has 16 after it, 64 long from 0 and 32, and 1 long from each."""
    increments = np.tile([0.2, 0.0, 0.01], (100, 1))
    short, long, single = heading_spans(increments, FilterConstraintsConfig(spans=(16, 64, 1), span_angle=0.002))
    assert short.start.tolist() == [0, 8, 16, 24, 32, 40, 48, 56, 64, 72, 80] and (short.end == short.start + 16).all()
    assert (long.start.tolist(), long.end.tolist()) == ([0, 32], [64, 96])
    assert (single.start.tolist(), single.end.tolist()) == (list(range(100)), list(range(1, 101)))
    np.testing.assert_allclose(short.measured[:, 2], 0.16)
    np.testing.assert_allclose(long.measured[:, 2], 0.64)
    np.testing.assert_allclose(long.information[:, 2, 2], 125000.0)  # half of 1 / 0.002²


def test_a_trajectory_that_is_too_short_has_none() -> None:
    config = FilterConstraintsConfig(spans=(16, 64))
    for count, spans in ((0, 0), (15, 0), (16, 1), (23, 1), (24, 2)):
        short, long = heading_spans(np.tile([0.2, 0.0, 0.0], (count, 1)), config)
        assert (len(short), len(long)) == (spans, 0)
        assert short.measured.shape == (spans, 3) and short.information.shape == (spans, 3, 3)


# Chosen


ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 181)
DRIFT = 0.0005  # rad a key scan: 0.1 rad and most of a metre in the end
INFORMATION = np.diag([100.0**2, 100.0**2, 200.0**2])  # of a match: 1 cm, 5 mrad
FILTER = FilterConstraintsConfig(spans=(16, 64), span_angle=0.0015, fewest_walls=10**6)  # spans alone, no increments


@pytest.fixture(scope="module")
def truth() -> Array:
    """Once round the block, and 2 m of it again: a key scan every 0.2 m, or 9 degrees."""
    increments = [(0.0, 0.0, 0.0)]
    for side in (8.0, 6.0, 8.0, 6.0, 2.0):
        increments += [(0.2, 0.0, 0.0)] * round(side / 0.2) + [(0.0, 0.0, math.pi / 20)] * 10
    return geometry.accumulate(increments[:-10])


@pytest.fixture(scope="module")
def scans(truth: Array, block: Array) -> ScanStore:
    rng = np.random.default_rng(0)
    store = ScanStore(np.zeros(2), ScanMatchingConfig())
    for ranges in true_ranges(block, truth, ANGLES)[0]:
        noisy = ranges + 0.01 * rng.standard_normal(len(ranges))
        store.add(np.stack([noisy * np.cos(ANGLES), noisy * np.sin(ANGLES)], axis=-1))
    return store


def bent(truth: Array) -> Array:
    """The same way, but turning too far to the left all the time."""
    steps = geometry.between(truth[:-1], truth[1:])
    return geometry.accumulate(np.vstack([truth[:1], steps + np.array([0.0, 0.0, DRIFT])]))


def matching(poses: Array, monkeypatch: pytest.MonkeyPatch) -> None:
    """Key scans up to 8 apart are measured to stand to each other as ``poses`` do; no others match."""

    def match(scans: ScanStore, at: Array, pairs: Indices, gates: Array, config: SmoothingConfig) -> Constraints:
        start, end = pairs[pairs[:, 1] - pairs[:, 0] <= 8].T
        measured = geometry.between(poses[start], poses[end])
        information = np.tile(INFORMATION, (len(start), 1, 1))
        return Constraints(start, end, measured, information, np.ones(len(start), np.bool_))

    monkeypatch.setattr(smoothing, "match", match)


def smoother_of(scans: ScanStore, found: Array, truth: Array) -> Smoother:
    """``found`` are the filter's key poses; the odometry, which matches reach over, says the truth."""
    config = GraphConfig(
        filter_constraints=FILTER,
        loop_closing=LoopClosingConfig(enabled=False),
    )
    odometry = np.vstack([np.zeros(3), geometry.between(truth[:-1], truth[1:])])
    return Smoother(scans, odometry, geometry.between(found[:-1], found[1:]), config)


def turned_too_far(poses: Array, truth: Array) -> float:
    """rad at the end."""
    return float(geometry.wrap(poses[-1, 2] - truth[-1, 2]))


@pytest.mark.parametrize("before", [False, True])
def test_headings_are_held_where_matches_are_all_bent_alike(
    before: bool, scans: ScanStore, truth: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The filter is right, the matches of neighbours are not: held, most of their drift is gone."""
    wrong = bent(truth)
    matching(wrong, monkeypatch)
    smoother = smoother_of(scans, truth, truth)
    smoother.held = before
    poses, support = smoother.choose_held(truth, 1.0)
    assert smoother.held
    left = turned_too_far(poses, truth)
    smoother.held = False
    free, _ = smoother.relax(truth, np.array([0.1]))
    drifted = turned_too_far(free, truth)
    assert drifted > 0.8 * DRIFT * len(truth) and abs(left) < 0.3 * drifted
    assert np.hypot(*(poses - truth)[:, :2].T).max() < 0.5 * np.hypot(*(free - truth)[:, :2].T).max()
    assert support > 0.0


@pytest.mark.parametrize("before", [False, True])
def test_headings_are_let_go_where_the_filter_is_wrong(
    before: bool, scans: ScanStore, truth: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    matching(truth, monkeypatch)
    smoother = smoother_of(scans, bent(truth), truth)
    smoother.held = before
    poses, _ = smoother.choose_held(truth, 1.0)
    assert not smoother.held
    np.testing.assert_allclose(poses, truth, atol=2e-3)
    smoother.held = True
    held, _ = smoother.relax(truth, np.array([0.1]))
    assert abs(turned_too_far(held, truth)) > 0.3 * DRIFT * len(truth)  # holding them makes a difference


@pytest.mark.parametrize("before", [False, True])
def test_it_stays_as_it_is_unless_the_scans_are_sure(
    before: bool, scans: ScanStore, truth: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A billion standard errors are asked for to change it, though the scans speak for the other one."""
    wrong = bent(truth)
    matching(truth if before else wrong, monkeypatch)
    smoother = smoother_of(scans, wrong if before else truth, truth)
    smoother.held = before
    poses, support = smoother.choose_held(truth, 1e9)
    assert smoother.held == before
    again, same = smoother.relax(truth, np.array([0.1]))  # what is returned is the graph of what was chosen
    np.testing.assert_allclose(poses, again, atol=1e-9)
    assert support == pytest.approx(same)
