"""Which of two trajectories scans with known truth speak for."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.evidence import agreement, compare, witnesses
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import EvidenceConfig, ScanMatchingConfig, SmoothingConfig
from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]
CONFIG = EvidenceConfig()

ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 361)
ROOM = np.array(
    [(-3.0, -3, 9, -3), (9, -3, 9, 4), (9, 4, -3, 4), (-3, 4, -3, -3), (2, 1, 4, 1), (4, 1, 4, 4), (2, 1, 2, 4)]
)


def drive() -> Array:
    """Up and down the room twice, a key scan every 0.2 m."""
    there = [(0.2, 0.0, 0.0)] * 25 + [(0.0, 0.0, np.pi / 8)] * 8
    return geometry.accumulate([(0.0, 0.0, 0.0), *there * 4])


def scans_from(poses: Array, walls: Array = ROOM, worker: Worker | None = None) -> ScanStore:
    rng = np.random.default_rng(0)
    store = ScanStore(np.zeros(2), ScanMatchingConfig(), worker)
    for ranges in true_ranges(walls, poses, ANGLES)[0]:
        noisy = ranges + 0.01 * rng.standard_normal(len(ranges))
        store.add(np.stack([noisy * np.cos(ANGLES), noisy * np.sin(ANGLES)], axis=-1))
    return store


def test_scans_agree_with_their_true_poses_and_not_with_others() -> None:
    """More than a metre off, end points lie in the open; far from each other, two scans say nothing."""
    truth = np.array([[0.0, 0, 0], [0.5, 0.3, 0.3]])
    scans = scans_from(truth)
    pair = np.array([[0, 1]])
    assert agreement(scans, truth, pair, CONFIG)[0] > 0.8
    off = truth + np.array([[0.0, 0, 0], [-1.0, -1.0, 0.0]])
    assert -CONFIG.crossed <= agreement(scans, off, pair, CONFIG)[0] < -0.2
    far = truth + np.array([[0.0, 0, 0], [100.0, 0.0, 0.0]])
    assert agreement(scans, far, pair, CONFIG)[0] == 0.0


def test_pairs_are_judged_one_by_one_on_either_thread() -> None:
    """Many at once, which two threads share, as each alone."""
    poses = drive() + np.random.default_rng(2).normal(0.0, [0.05, 0.05, 0.01], (len(drive()), 3))
    pairs = witnesses(poses, poses, CONFIG)
    alone = scans_from(drive())
    expected = [agreement(alone, poses, pair[None], CONFIG)[0] for pair in pairs]
    assert len(pairs) > 200 and len(set(expected)) > 200
    for threads in (1, 2):
        worker = Worker(threads)
        try:
            found = agreement(scans_from(drive(), worker=worker), poses, pairs, CONFIG)
        finally:
            worker.close()
        np.testing.assert_array_equal(found, expected)


def test_the_truth_is_preferred_to_drift_and_to_a_tear() -> None:
    truth = drive()
    scans = scans_from(truth)
    steps = geometry.between(truth[:-1], truth[1:])
    drifted = geometry.accumulate(np.vstack([np.zeros(3), steps + np.array([0.0, 0.0, 0.002])]))
    torn = truth.copy()
    torn[len(truth) // 2 :, :2] += [0.8, 0.5]
    for wrong in (drifted, torn):
        verdict = compare(scans, truth, wrong, CONFIG)
        assert verdict.gain > 0.0 and verdict.sigmas > 3.0 and verdict.pairs > 100
        back = compare(scans, wrong, truth, CONFIG)
        assert (back.gain, back.pairs) == (-verdict.gain, verdict.pairs)


def test_between_equals_nothing_can_be_told() -> None:
    """Two estimates that are equally good: as far off by chance, a millimetre or so."""
    truth = drive()
    scans = scans_from(truth)
    rng = np.random.default_rng(1)
    one, other = (truth + rng.normal(0.0, [0.001, 0.001, 0.0002], truth.shape) for _ in range(2))
    assert abs(compare(scans, one, other, CONFIG).sigmas) < 3.0 * CONFIG.sure
    same = compare(scans, truth, truth, CONFIG)
    assert (same.gain, same.sigmas) == (0.0, 0.0)


def test_witnesses_are_none_of_the_matched_pairs() -> None:
    poses = drive()
    pairs = witnesses(poses, poses + 0.001, CONFIG)
    hops = pairs[:, 1] - pairs[:, 0]
    assert not np.isin(hops, SmoothingConfig().hops).any() and (hops > 0).all()
    assert len(np.unique(pairs, axis=0)) == len(pairs) and SmoothingConfig().apart >= 30


def test_visits_count_as_much_as_neighbours_though_they_are_fewer() -> None:
    """The gain is the mean of two means, over the pairs of one visit and over those of two."""
    truth = drive()
    scans = scans_from(truth)
    bent = truth + np.linspace(0.0, 0.2, len(truth))[:, None] * [1.0, 0.0, 0.0]
    pairs = witnesses(truth, bent, CONFIG)
    mine, theirs = agreement(scans, truth, pairs, CONFIG), agreement(scans, bent, pairs, CONFIG)
    told = (mine != 0) | (theirs != 0)
    near = pairs[:, 1] - pairs[:, 0] <= 24
    means = [(mine - theirs)[told & one].mean() for one in (near, ~near)]
    assert means[1] > 2 * means[0] > 0  # drift shows when the robot comes back
    assert abs(compare(scans, truth, bent, CONFIG).gain - (mine - theirs)[told].mean()) < 0.01 * means[0]
    verdict = compare(scans, truth, bent, CONFIG, visits_alike=True)
    assert abs(verdict.gain - np.mean(means)) < 0.01 * verdict.gain  # pairs that both put alike are left out
