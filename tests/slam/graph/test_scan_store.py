"""Key scans as they are kept, what matches nothing, and which matches are believed."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.scan_store import Described, Matches, ScanStore, trusted
from pfslam_viz.slam.graph.settings import LoopClosingConfig, ScanMatchingConfig, SmoothingConfig
from pfslam_viz.slam.graph.walls import wall_normals
from tests.kernels import from_python

Array = NDArray[np.float64]

CONFIG = ScanMatchingConfig()
ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 361)
SENSOR = np.array([0.15, 0.0])
ROOM = np.array([(-3, -2, 4, -2), (4, -2, 4, 3), (4, 3, -3, 3), (-3, 3, -3, -2)])  # x0, y0, x1, y1


def seen(pose: Array) -> Array:
    """End points (m, 2) in the robot's frame of a scan of the room from ``pose``."""
    ranges = true_ranges(ROOM, geometry.compose(pose, [*SENSOR, 0.0])[None], ANGLES)[0][0]
    points: Array = SENSOR + np.stack([ranges * np.cos(ANGLES), ranges * np.sin(ANGLES)], axis=-1)
    return points


def store_of(*scans: Array) -> ScanStore:
    store = ScanStore(SENSOR, CONFIG)
    for scan in scans:
        store.add(scan)
    return store


def test_scans_are_kept_one_after_the_other() -> None:
    """More scans and points than the store's first arrays hold; each comes back as it was, bearings increasing."""
    rng = np.random.default_rng(1)
    scans = [seen(np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)]))[: 20 + k] for k in range(90)]
    store = store_of(*scans)
    assert len(store) == 90
    np.testing.assert_array_equal(np.diff(store.first), [len(scan) for scan in scans])
    for k, scan in enumerate(scans):
        assert store.size_of(k) == len(scan)
        np.testing.assert_allclose(store.points_of(k), scan, atol=1e-6)
        own = slice(store.first[k], store.first[k + 1])
        normals, _ = from_python(wall_normals)(scan, SENSOR, CONFIG.wall_reach, CONFIG.wall_spacings, 20, 0.1)
        np.testing.assert_allclose(store.normals[own], normals, atol=1e-6)
        np.testing.assert_allclose(store.bearings[own], ANGLES[: len(scan)], atol=1e-5)


def test_a_scan_described_before_is_kept_alike() -> None:
    """Thinned too: 721 end points are too many."""
    pose = np.array([0.4, -0.3, 0.8])
    dense = np.repeat(seen(pose), 2, axis=0)[:-1] + np.array([0.0, 1e-4]) * (np.arange(721) % 2)[:, None]
    plain, before = store_of(seen(pose)[:50], dense), ScanStore(SENSOR, CONFIG)
    for scan in (seen(pose)[:50], dense):
        before.add(Described.of(scan, SENSOR, CONFIG))
    assert plain.size_of(1) <= CONFIG.most_points and len(before) == 2
    for name in ("first", "points", "normals", "own_normals", "bearings", "_open_shares"):
        np.testing.assert_array_equal(getattr(before, name), getattr(plain, name))


def test_the_last_scan_can_be_dropped() -> None:
    a, b, c = (seen(np.array([x, 0.0, 0.0])) for x in (0.0, 0.5, 1.0))
    store = store_of(a, b[:100])
    store.drop_last()
    assert len(store) == 1 and len(store.first) == 2
    store.add(c)
    assert len(store) == 2
    np.testing.assert_allclose(store.points_of(0), a, atol=1e-6)
    np.testing.assert_allclose(store.points_of(1), c, atol=1e-6)


def test_a_long_scan_is_thinned_evenly() -> None:
    """Of 1081 points every third is kept, 361; of 400 all. They are 1.4 cm apart."""
    x = 0.01 * np.arange(1081.0)
    store = store_of(np.column_stack([1 + x, x]), np.column_stack([1 + x, x])[: CONFIG.most_points])
    np.testing.assert_allclose(store.points_of(0)[:, 1], x[::3], atol=1e-6)
    assert store.size_of(1) == CONFIG.most_points


def test_an_empty_scan_is_kept_and_matches_nothing() -> None:
    store = store_of(seen(np.zeros(3)), np.zeros((0, 2)), seen(np.zeros(3)))
    assert store.size_of(1) == 0 and len(store.points_of(1)) == 0
    guess = np.array([0.1, 0.2, 0.3])
    prior, gates = np.full(3, 1e-6), np.array([0.5, 0.3, 0.2, 0.1])
    found = store.match(np.array([0]), np.array([1]), guess[None], prior, gates, iterations=30)
    np.testing.assert_array_equal(found.poses[0], guess)
    assert found.overlap[0] == 0 and found.distance[0] == 0 and not found.information[0].any()
    found = store.match(np.array([1]), np.array([2]), guess[None], prior, gates, iterations=15)
    np.testing.assert_array_equal(found.poses[0], guess)
    assert found.overlap[0] == 0


@pytest.mark.parametrize("kind", [SmoothingConfig, LoopClosingConfig])
def test_a_match_is_trusted_if_everything_about_it_is_good(
    kind: type[SmoothingConfig] | type[LoopClosingConfig],
) -> None:
    config = kind(overlap=0.3, distance=0.05, longest_shift=0.4, largest_turn=0.2)
    guesses = np.tile([1.0, 2.0, 3.0], (7, 1))
    moved = np.zeros((7, 3))
    moved[3, 1], moved[4, 0], moved[5, 2], moved[6] = 0.41, 0.35, 0.21, [0.3, 0.3, 0]
    overlap = np.array([0.9, 0.29, 0.9, 0.9, 0.9, 0.9, 0.9])
    distance = np.array([0.01, 0.01, 0.06, 0.01, 0.01, 0.01, 0.01])
    found = Matches(geometry.compose(guesses, moved), np.zeros((7, 3, 3)), overlap, distance)
    assert trusted(found, guesses, config).tolist() == [True, False, False, False, True, False, False]
