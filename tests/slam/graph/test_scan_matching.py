"""Scan against scan: in rooms of straight walls whose scans are cast with known truth, and against plain twins."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.scan_matching import (
    MatchingRules,
    approximate_bearing,
    first_from,
    match_pairs,
    open_direction,
)
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import ScanMatchingConfig
from tests.kernels import from_python

Array = NDArray[np.float64]

CONFIG = ScanMatchingConfig()
LOOSE = np.full(3, 1e-6)
GATES = np.array([0.5, 0.3, 0.2, 0.1])
ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 361)
SENSOR = np.array([0.15, 0.0])

# x0, y0, x1, y1: a room of 7 x 5 m with an alcove and a slanted cupboard
ROOM = np.array([
    (-3, -2, 4, -2), (4, -2, 4, 3), (4, 3, 1.5, 3), (1.5, 3, 1.5, 4.2), (1.5, 4.2, -0.5, 4.2), (-0.5, 4.2, -0.5, 3),
    (-0.5, 3, -3, 3), (-3, 3, -3, -2), (2.2, -1.9, 3.4, -1.0),
])  # fmt: skip
CORRIDOR = np.array([(-60.0, -1.1, 60.0, -1.1), (-60.0, 1.1, 60.0, 1.1)])


def see(walls: Array, pose: Array, *, noise: float = 0.0, rng: np.random.Generator | None = None,
        mount: Array | None = None, angles: Array = ANGLES) -> Array:  # fmt: skip
    """End points (m, 2) in the robot's frame of a scan within 20 m from ``pose``."""
    lidar = np.array([*SENSOR, 0.0]) if mount is None else mount
    ranges = true_ranges(walls, geometry.compose(pose, lidar)[None], angles)[0][0]
    hit = ranges < 20.0
    if rng is not None:
        ranges = ranges + noise * rng.standard_normal(len(ranges))
    points = np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=-1)[hit]
    return geometry.transform(lidar, points)


def store_of(*scans: Array, sensor: Array = SENSOR) -> ScanStore:
    store = ScanStore(sensor, CONFIG)
    for scan in scans:
        store.add(scan)
    return store


def matched(store: ScanStore, guess: Array, prior: Array = LOOSE) -> tuple[Array, Array, float, float]:
    """Scan 1 of the store against scan 0."""
    found = store.match(np.array([0]), np.array([1]), np.asarray(guess)[None], prior, GATES, iterations=30)
    return found.poses[0], found.information[0], float(found.overlap[0]), float(found.distance[0])


# Correspondences and information at a given pose


def plain_match(
    store: ScanStore, reference: int, other: int, pose: Array, gate: float, stride: int = 1
) -> tuple[Array, float, float]:
    """Information, overlap and distance at ``pose``, each point's partner found among all the reference's points."""
    a, b = (slice(store.first[k], store.first[k + 1]) for k in (reference, other))
    points, normals = store.points[a].astype(np.float64), store.normals[a].astype(np.float64)
    seen = geometry.transform(pose, store.points[b].astype(np.float64))[::stride]
    facing = geometry.transform([0, 0, pose[2]], store.normals[b].astype(np.float64))[::stride]
    arms = seen - pose[:2]
    h, distances = np.zeros((3, 3)), []
    for point, normal, arm in zip(seen, facing, arms, strict=True):
        away = np.hypot(*(points - point).T)
        at = int(np.argmin(away))
        if away[at] >= gate or not normals[at].any() or (normal.any() and normals[at] @ normal < 0.7):
            continue
        e = normals[at] @ (point - points[at])
        j = np.array([*normals[at], normals[at] @ [-arm[1], arm[0]]])
        width = max(2 * CONFIG.noise, gate / 3)
        h += np.outer(j, j) / CONFIG.noise**2 / (1 + (e / width) ** 2)
        distances.append(abs(e))
    marginal = h[:2, :2] - np.outer(h[:2, 2], h[:2, 2]) / h[2, 2] if h[2, 2] > 0 else np.zeros((2, 2))
    low, high = np.linalg.eigvalsh(marginal) if distances else (0.0, 0.0)
    assert not distances or low > CONFIG.open_share * high  # no direction is open: the information stays as it is
    return h, len(distances) / len(seen), float(np.mean(distances)) if distances else 0.0


@pytest.mark.parametrize("gate", [0.1, 0.5])
@pytest.mark.parametrize("stride", [1, 3])
def test_partners_equal_a_search_among_all_points(gate: float, stride: int) -> None:
    """At random poses in the room: information, overlap and distance as from the nearest of all points."""
    rng = np.random.default_rng(2)
    poses = np.column_stack([rng.uniform(-0.8, 0.8, (12, 2)), rng.uniform(-0.6, 0.6, 12)])
    store = store_of(*(see(ROOM, pose, noise=0.01, rng=rng) for pose in poses))
    overlaps = []
    for other in range(1, 12):
        guess = geometry.between(poses[0], poses[other]) + rng.normal(0, [0.05, 0.05, 0.03])
        _, information, overlap, distance = match_pairs(
            store.points, store.normals, store.bearings, store.first, SENSOR, np.zeros(12), np.array([0]),
            np.array([other]),
            guess[None], np.array([gate]), 0, stride, LOOSE, MatchingRules.of(CONFIG),
        )  # fmt: skip
        h, share, mean = plain_match(store, 0, other, guess, gate, stride)
        overlaps.append(share)
        assert overlap[0] == pytest.approx(share, abs=1e-9)
        assert distance[0] == pytest.approx(mean, rel=1e-4)
        np.testing.assert_allclose(information[0], h, rtol=1e-3, atol=1e-4 * np.abs(h).max())
    assert max(overlaps) > 0.6 and min(overlaps) < 0.95


def test_the_other_side_of_a_wall_is_no_partner() -> None:
    """Two robots look at one wall from both sides: its points lie on each other, its normals are opposed."""
    wall = np.array([(-5.0, 2.0, 5.0, 2.0)])
    store = store_of(see(wall, np.array([0.0, 0.0, math.pi / 2])), see(wall, np.array([0.0, 4.0, -math.pi / 2])))
    guess = geometry.between([0.0, 0.0, math.pi / 2], [0.0, 4.0, -math.pi / 2])
    pose, information, overlap, _ = matched(store, guess)
    assert overlap == 0 and not information.any()
    np.testing.assert_array_equal(pose, guess)


def test_the_information_is_the_curvature_of_the_squared_distances() -> None:
    """Where scans fit, half the second differences of the sum of (distance / noise)² over the pose."""
    store = store_of(see(ROOM, np.zeros(3)), see(ROOM, np.zeros(3)))
    _, information, overlap, distance = matched(store, np.zeros(3))
    assert overlap > 0.9 and distance < 1e-4

    def cost(pose: Array) -> float:
        """Every point keeps its partner: itself."""
        points, normals = store.points_of(0), store.normals[: store.first[1]].astype(np.float64)
        e = ((geometry.transform(pose, points) - points) * normals).sum(axis=1)
        return float((e**2).sum()) / CONFIG.noise**2

    step = np.diag([1e-3, 1e-3, 1e-3])
    numeric = np.array([
        [(cost(a + b) - cost(a - b) - cost(b - a) + cost(-a - b)) / 8e-6 for a in step] for b in step
    ])  # fmt: skip
    np.testing.assert_allclose(information, numeric, rtol=2e-3, atol=2e-3 * np.abs(numeric).max())


# Matching


def test_matching_recovers_the_increment_exactly_without_noise() -> None:
    """From 0.2 m and 6 degrees off, to what the chords of the walls allow: a few tenths of a millimetre."""
    rng = np.random.default_rng(3)
    for _ in range(12):
        start = np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)])
        increment = np.array([*rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.3, 0.3)])
        store = store_of(see(ROOM, start), see(ROOM, geometry.compose(start, increment)))
        guess = increment + rng.choice([-1, 1], 3) * [0.15, 0.12, 0.1]
        pose, _, overlap, distance = matched(store, guess)
        np.testing.assert_allclose(pose, increment, atol=1e-3)
        assert overlap > 0.75 and distance < 2e-3


def test_with_noise_the_error_is_about_what_the_information_says() -> None:
    """Ranges of 1 cm noise, two scans: errors of √2 · 1 cm where the information reckons with 2 cm a point.

    So the squared Mahalanobis error, 3 on average if the noise were as reckoned, is 1.5 or so; at most 3 here, as the
    normals are noisy too. A millimetre or two in all.
    """
    rng = np.random.default_rng(4)
    errors, squares = [], []
    for _ in range(40):
        start = np.array([*rng.uniform(-1, 1, 2), rng.uniform(-3, 3)])
        increment = np.array([*rng.uniform(-0.1, 0.1, 2), rng.uniform(-0.1, 0.1)])
        store = store_of(
            see(ROOM, start, noise=0.01, rng=rng),
            see(ROOM, geometry.compose(start, increment), noise=0.01, rng=rng),
        )
        pose, information, _, distance = matched(store, increment + rng.normal(0, [0.05, 0.05, 0.03]))
        error = pose - increment
        errors.append(error)
        squares.append(error @ information @ error)
        assert 0.005 < distance < 0.02  # the mean of |N(0, 1.4 cm)| is 1.1 cm
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[0] < 0.003 and rms[1] < 0.003 and rms[2] < 0.0015
    assert 0.5 < np.mean(squares) < 4.0


def test_a_bare_corridor_leaves_its_axis_to_the_guess() -> None:
    """The robot stands askew; the guess is wrong by 12 cm along the corridor, by 8 cm across and by 3 degrees."""
    rng = np.random.default_rng(5)
    start = np.array([0.0, 0.1, 0.4])
    end = np.array([0.3, 0.05, 0.45])
    store = store_of(see(CORRIDOR, start, noise=0.01, rng=rng), see(CORRIDOR, end, noise=0.01, rng=rng))
    wrong = end + np.array([0.12, 0.08, 0.05])
    pose, information, overlap, _ = matched(store, geometry.between(start, wrong), np.array([100.0, 100.0, 400.0]))
    found = geometry.compose(start, pose)
    assert found[0] == pytest.approx(wrong[0], abs=0.01)
    assert found[1] == pytest.approx(end[1], abs=0.005)
    assert found[2] == pytest.approx(end[2], abs=0.003)
    axis = np.array([math.cos(-0.4), math.sin(-0.4)])  # the corridor's, in the first robot's frame
    across = np.array([-axis[1], axis[0]])
    assert overlap > 0.6
    low, high = np.linalg.eigvalsh(information[:2, :2])
    assert low == pytest.approx(0.0, abs=1e-9 * high)
    free = open_direction(information)
    assert free is not None and abs(free @ axis) > 0.999 and np.hypot(*free) == pytest.approx(1.0)
    assert across @ information[:2, :2] @ across > 0.99 * high > 1e4
    assert abs(np.linalg.eigh(information[:2, :2])[1][:, 0] @ axis) > 0.999
    assert np.linalg.eigvalsh(information)[1] > 1e3  # across and heading are known


def test_a_corridor_with_an_end_is_not_open() -> None:
    """The same corridor with a wall across it: now the axis is corrected as well."""
    rng = np.random.default_rng(6)
    walls = np.vstack([CORRIDOR, [(4.0, -1.1, 4.0, 1.1)]])
    start, end = np.array([0.0, 0.1, 0.4]), np.array([0.3, 0.05, 0.45])
    store = store_of(see(walls, start, noise=0.01, rng=rng), see(walls, end, noise=0.01, rng=rng))
    guess = geometry.between(start, end + np.array([0.12, 0.08, 0.05]))
    pose, information, _, _ = matched(store, guess)
    np.testing.assert_allclose(geometry.compose(start, pose), end, atol=0.01)
    assert np.linalg.eigvalsh(information[:2, :2])[0] > 1e3
    assert open_direction(information) is None
    assert open_direction(np.zeros((3, 3))) is None  # nothing matched: that is another matter


@pytest.mark.parametrize(("roughness", "is_open"), [(0.005, False), (0.05, True)])
def test_a_far_end_counts_unless_the_walls_are_rough(roughness: float, is_open: bool) -> None:
    """A wall across the corridor, 19 m ahead, tells a fiftieth of what the others do; rough ones seem to, anyway."""
    rng = np.random.default_rng(9)
    walls = np.vstack([CORRIDOR, [(19.0, -1.1, 19.0, 1.1)]])
    start, end = np.array([0.0, 0.1, 0.0]), np.array([0.3, 0.05, 0.02])
    store = store_of(see(walls, start, noise=roughness, rng=rng), see(walls, end, noise=roughness, rng=rng))
    pose, information, _, _ = matched(store, geometry.between(start, end + np.array([0.12, 0.0, 0.0])))
    assert (open_direction(information) is not None) == is_open
    assert pose[0] == pytest.approx(0.42 if is_open else 0.3, abs=0.03)
    marginal = np.linalg.inv(np.linalg.inv(information + 1e-3 * np.eye(3))[:2, :2])
    low, high = np.linalg.eigvalsh(marginal)
    assert low < CONFIG.open_share * high


def test_a_tight_prior_holds_the_guess_and_a_loose_one_does_not() -> None:
    """Information of 1e9 against the scans' 1e6 or so leaves a thousandth of the correction."""
    store = store_of(see(ROOM, np.zeros(3)), see(ROOM, np.zeros(3)))
    guess = np.array([0.08, -0.06, 0.05])
    held, *_ = matched(store, guess, np.full(3, 1e9))
    np.testing.assert_allclose(held, guess, atol=1e-3)
    free, *_ = matched(store, guess)
    np.testing.assert_allclose(free, 0, atol=1e-3)
    one, *_ = matched(store, guess, np.array([1e10, 1e-6, 1e-6]))  # x alone
    assert one[0] == pytest.approx(0.08, abs=1e-3)
    assert abs(one[1]) < 0.02 and abs(one[2]) < 0.03


@pytest.mark.parametrize("yaw", [0.0, math.pi / 2, math.pi, -2.0])
def test_the_lidar_may_look_in_any_direction(yaw: float) -> None:
    """Bearings pass through ±π when it looks backwards; every point still finds its partner."""
    mount = np.array([-0.1, 0.05, yaw])
    increment = np.array([0.15, -0.1, 0.1])
    scans = [see(ROOM, pose, mount=mount) for pose in (np.zeros(3), increment)]
    store = store_of(*scans, sensor=mount[:2])
    assert (np.diff(store.bearings[: store.first[1]]) > 0).all()
    pose, _, overlap, _ = matched(store, np.array([0.1, -0.05, 0.05]))
    np.testing.assert_allclose(pose, increment, atol=1e-3)
    assert overlap > 0.75


def test_two_walls_may_lie_half_a_turn_apart() -> None:
    """Nothing comes back over 210 degrees ahead: the bearings go on increasing over the gap."""
    walls = np.array([(-6.0, -1.1, -0.3, -1.1), (-6.0, 1.1, -0.3, 1.1), (-6.0, -1.1, -6.0, 1.1)])
    mount = np.array([0.0, 0.0, 0.0])
    angles = np.linspace(-0.95 * np.pi, 0.95 * np.pi, 700)
    increment = np.array([0.05, 0.04, 0.03])
    store = store_of(
        *(see(walls, pose, mount=mount, angles=angles) for pose in (np.zeros(3), increment)), sensor=np.zeros(2)
    )
    bearings = store.bearings[: store.first[1]]
    assert np.diff(bearings).max() > 1.15 * np.pi and np.diff(bearings).min() > 0
    pose, _, overlap, _ = matched(store, np.zeros(3))
    np.testing.assert_allclose(pose[1:], increment[1:], atol=1e-3)
    assert overlap > 0.7


def test_many_pairs_are_matched_as_each_alone() -> None:
    """200 pairs, worked on by two threads."""
    rng = np.random.default_rng(7)
    poses = np.column_stack([rng.uniform(-1, 1, (20, 2)), rng.uniform(-3, 3, 20)])
    store = store_of(*(see(ROOM, pose, noise=0.01, rng=rng)[::4] for pose in poses))
    references, others = rng.integers(0, 20, 200), rng.integers(0, 20, 200)
    guesses = geometry.between(poses[references], poses[others]) + rng.normal(0, 0.03, (200, 3))
    together = store.match(references, others, guesses, LOOSE, GATES, iterations=15)
    for k in (0, 1, 99, 100, 101, 199):
        alone = store.match(references[[k]], others[[k]], guesses[[k]], LOOSE, GATES, iterations=15)
        np.testing.assert_array_equal(together.poses[k], alone.poses[0])
        np.testing.assert_array_equal(together.information[k], alone.information[0])
        assert together.overlap[k] == alone.overlap[0] and together.distance[k] == alone.distance[0]


def test_a_bearing_is_found_from_wherever_the_search_begins() -> None:
    bearings = np.repeat(np.sort(np.random.default_rng(2).uniform(-3, 3, 40)), 2).astype(np.float32)
    find = from_python(first_from)
    for value in (*bearings[::7], -4.0, 0.0, 4.0):
        expected = 10 + np.searchsorted(bearings[10:70], np.float32(value))
        for start in (10, 30, 69, 70):
            assert find(bearings, 10, 70, float(value), start) == expected


@pytest.mark.parametrize("ahead", [0.0, 2.5, -3.0, 4.0])
def test_bearings_are_as_exact_as_the_table_they_are_looked_up_in(ahead: float) -> None:
    near = from_python(approximate_bearing)
    angles = np.concatenate([ahead + np.linspace(-3.14, 3.14, 500), np.pi / 4 * np.arange(-3, 4)])
    for angle in angles:
        found = near(3.0 * np.cos(angle), 3.0 * np.sin(angle), ahead)
        assert abs(math.remainder(found - angle, 2 * np.pi)) < 3e-8 and abs(found - ahead) <= np.pi + 3e-8
    assert np.isfinite(near(0.0, 0.0, ahead))
