"""Pairs of scans that two trajectories put alike say nothing, and one place is no evidence."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.evidence import agreement, compare
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import EvidenceConfig, ScanMatchingConfig

Array = NDArray[np.float64]

HOPS = (3, 6, 12, 24)
CONFIG = EvidenceConfig(hops=HOPS, visits=0, block=20, fewest_blocks=4, alike_distance=0.002, alike_angle=0.0005)
ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 181)
ROOM = np.array(
    [(-3.0, -3, 12, -3), (12, -3, 12, 4), (12, 4, -3, 4), (-3, 4, -3, -3), (3, 2, 5, 2), (5, 2, 5, 4), (3, 2, 3, 4)]
)
COUNT, TEAR = 80, 50  # key scans, and the first of those that stand elsewhere


@pytest.fixture(scope="module")
def truth() -> Array:
    """Along the room, 0.1 m a key scan."""
    return geometry.accumulate(np.tile([0.1, 0.0, 0.0], (COUNT, 1)))


@pytest.fixture(scope="module")
def scans(truth: Array) -> ScanStore:
    rng = np.random.default_rng(0)
    store = ScanStore(np.zeros(2), ScanMatchingConfig())
    for ranges in true_ranges(ROOM, truth, ANGLES)[0]:
        noisy = ranges + 0.01 * rng.standard_normal(len(ranges))
        store.add(np.stack([noisy * np.cos(ANGLES), noisy * np.sin(ANGLES)], axis=-1))
    return store


def torn(poses: Array, by: tuple[float, float, float]) -> Array:
    """All from ``TEAR`` on are moved by the same motion, as a whole."""
    out = poses.copy()
    pivot = poses[TEAR]
    out[TEAR:] = geometry.compose(geometry.compose(pivot, by), geometry.between(pivot, poses[TEAR:]))
    return out


def test_the_whole_moved_is_the_same_trajectory(scans: ScanStore, truth: Array) -> None:
    verdict = compare(scans, truth, geometry.compose([5.0, -2.0, 1.0], truth), CONFIG)
    assert (verdict.gain, verdict.sigmas, verdict.pairs) == (0.0, 0.0, 0)


def test_only_pairs_across_a_tear_have_something_to_say(scans: ScanStore, truth: Array) -> None:
    """Of each hop so many as it is long: 3 + 6 + 12 + 24; all in all there are 3 * 80 + 80 - 45 pairs."""
    verdict = compare(scans, truth, torn(truth, (0.0, 0.3, 0.1)), CONFIG)
    assert verdict.pairs == sum(HOPS) == 45
    assert verdict.gain > 0.2


@pytest.mark.parametrize(
    ("by", "alike"),
    [
        ((0.0019, 0.0, 0.0), True),
        ((0.0, 0.0021, 0.0), False),
        ((0.0, 0.0, 0.0004), True),
        ((0.0, 0.0, -0.0006), False),
    ],
)
def test_alike_is_what_differs_by_no_more_than_is_set(
    by: tuple[float, float, float], alike: bool, scans: ScanStore, truth: Array
) -> None:
    """2 mm and 0.5 mrad. The turn is about the first pose beyond the tear: from 24 before it 2.3 m on, 1 mm at most."""
    assert compare(scans, truth, torn(truth, by), CONFIG).pairs == (0 if alike else 45)


def test_pairs_that_say_nothing_do_not_water_down_the_gain(scans: ScanStore, truth: Array) -> None:
    """Were all pairs counted, the mean would be the less, by 45 of 275."""
    wrong = torn(truth, (0.0, 0.3, 0.1))
    one = compare(scans, truth, wrong, CONFIG)
    everything = CONFIG.model_copy(update={"alike_distance": -1.0})
    every = compare(scans, truth, wrong, everything)
    assert every.pairs == sum(COUNT - hop for hop in HOPS) == 275
    assert every.gain == pytest.approx(one.gain * 45 / 275, rel=1e-3)  # what is alike differs by rounding


@pytest.mark.parametrize(("block", "fewest", "size"), [(20, 4, 20), (20, 8, 10), (5, 4, 5), (20, 1000, 1)])
def test_a_short_way_is_judged_by_shorter_blocks(
    block: int, fewest: int, size: int, scans: ScanStore, truth: Array
) -> None:
    """80 key scans are 4 blocks of 20, 8 of 10; the standard error of a mean over blocks of different weight, by hand.

    The later scans of the pairs across the tear are 50 to 73.
    """
    wrong = torn(truth, (0.0, 0.3, 0.1))
    verdict = compare(scans, truth, wrong, CONFIG.model_copy(update={"block": block, "fewest_blocks": fewest}))
    pairs = np.array([(k, k + hop) for hop in HOPS for k in range(TEAR - hop, TEAR)])
    values = agreement(scans, truth, pairs, CONFIG) - agreement(scans, wrong, pairs, CONFIG)
    mean = values.mean()
    square = 0.0
    for first in range(0, COUNT, size):
        inside = (pairs[:, 1] >= first) & (pairs[:, 1] < first + size)
        square += float((values[inside] - mean).sum()) ** 2
    assert verdict.gain == pytest.approx(mean) and verdict.pairs == 45
    assert verdict.sigmas == pytest.approx(mean * 45 / math.sqrt(square))
    back = compare(scans, wrong, truth, CONFIG.model_copy(update={"block": block, "fewest_blocks": fewest}))
    assert back.sigmas == pytest.approx(-verdict.sigmas)


def test_one_block_alone_is_no_evidence(scans: ScanStore, truth: Array) -> None:
    """It has no spread: how sure it is cannot be told. Its later scans are 70 to 75, of the block from 60 to 80."""
    wrong = truth.copy()
    wrong[70:] = geometry.compose(wrong[70:], [0.0, 0.3, 0.1])
    verdict = compare(scans, truth, wrong, CONFIG.model_copy(update={"hops": (3, 6), "fewest_blocks": 4}))
    assert verdict.gain > 0.2 and verdict.pairs > 9
    assert verdict.sigmas == 0.0
