"""The improved proposal in a room whose walls run through the centres of the map's cells."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.rbpf import proposal, tile_kernels
from pfslam_viz.slam.rbpf.proposal import propose, spread_points, window
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings
from tests.kernels import from_python

Array = NDArray[np.float64]

best_start, agreement = from_python(proposal.best_start), from_python(tile_kernels.agreement)

TEMPER = 0.2
ALONE, APART = np.zeros(3, np.int64), np.array([0.1, 0.03])  # no other start than the guess
STEPS, HALVINGS, MOVES = np.array([0.04, 0.02]), 6, 120
SPREAD = np.array([0.01, 0.005])
LOOSE = np.diag([1.0, 1.0, 1.0])


def room(width: float = 5.0, height: float = 4.0, step: float = 0.02) -> Array:
    """Points (m, 2) along the walls of a room round the origin, and of a pillar in it, in the order of a scan."""

    def side(ax: float, ay: float, bx: float, by: float) -> Array:
        n = round(math.hypot(bx - ax, by - ay) / step)
        return np.stack([np.linspace(ax, bx, n), np.linspace(ay, by, n)], axis=-1)

    x0, y0 = -0.4 * width + 0.025, -0.5 * height + 0.025
    x1, y1 = x0 + width, y0 + height
    return np.vstack([
        side(x0, y0, x1, y0), side(x1, y0, x1, y1), side(x1, y1, x0, y1), side(x0, y1, x0, y0),
        side(1.525, 0.625, 1.525, 1.225), side(1.525, 0.625, 2.125, 0.625),
    ])  # fmt: skip


WALLS = room()


def map_of(*rooms: Array) -> TileMaps:
    """One map for each of the rooms, each drawn twice."""
    maps = TileMaps(len(rooms), TileSettings(floor=0.1))
    for k, points in enumerate(rooms):
        for _ in range(2):
            poses = np.full((len(rooms), 3), [100.0, 0.0, 0.0]) + np.arange(len(rooms))[:, None] * [0.0, 30.0, 0.0]
            poses[k] = 0.0
            maps.write(poses, points, np.zeros(2))
    return maps


def seen_from(pose: Array, points: Array = WALLS, most: int = 300) -> Array:
    inside = geometry.transform(geometry.inverse(pose), points)
    return inside[:: max(1, len(inside) // most)]


def proposed(
    maps: TileMaps, points: Array, guesses: Array, prior: Array = LOOSE, normals: Array | None = None
) -> tuple[Array, Array]:
    guesses = np.atleast_2d(guesses)  # without normals: one sample, on the optimum itself
    normals = np.zeros((len(guesses), 1, 3)) if normals is None else normals
    return propose(
        maps.table,
        maps.field,
        maps.origin,
        maps.cell,
        points,
        TEMPER,
        guesses,
        prior,
        ALONE,
        APART,
        STEPS,
        HALVINGS,
        MOVES,
        normals,
        SPREAD,
    )


def log_posterior(maps: TileMaps, index: int, points: Array, guess: Array, prior: Array, pose: Array) -> float:
    """Tempered likelihood and a Gaussian round the guess, in the guess's frame."""
    moved = geometry.between(guess, pose)
    likelihood = agreement(maps.table[index], maps.field, maps.origin, maps.cell, points, *pose)
    return TEMPER * likelihood - 0.5 * float(moved @ prior @ moved)


@pytest.fixture(scope="module")
def maps() -> TileMaps:
    return map_of(WALLS)


def test_search_matches_the_plain_twin(maps: TileMaps) -> None:
    """Round after round of all six moves with every step, until a whole round finds nothing better."""
    truth = np.array([0.2, -0.1, 0.4])
    points = seen_from(truth)
    aside = [*np.diag([0.12, -0.12, 0.06]), *np.random.default_rng(5).uniform(-1, 1, (5, 3)) * [0.12, 0.12, 0.05]]
    for guess in truth + aside:  # some along one axis only, where the same move helps again and again
        pose, best = guess, log_posterior(maps, 0, points, guess, LOOSE, guess)
        for halving in range(HALVINGS + 1):
            steps = np.diag(STEPS[[0, 0, 1]] / 2.0**halving)
            improved = True
            while improved:
                improved = False
                for step in np.stack([steps, -steps], axis=1).reshape(6, 3):
                    value = log_posterior(maps, 0, points, guess, LOOSE, pose + step)
                    if value > best:
                        pose, best, improved = pose + step, value, True
        mean, _ = proposed(maps, points, guess)
        np.testing.assert_allclose(mean[0], pose, atol=1e-9)


def test_from_a_wrong_guess_the_pose_comes_back(maps: TileMaps) -> None:
    """Up to 8 cm and 3 degrees off in any direction: back to within 4 mm and 0.1 degrees, on average much less."""
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(20):
        truth = np.array([*rng.uniform(-0.8, 0.8, 2), rng.uniform(-3, 3)])
        guess = truth + rng.choice([-1.0, 1.0], 3) * rng.uniform(0.5, 1.0, 3) * [0.08, 0.08, 0.05]
        normals = rng.standard_normal((1, 30, 3))
        mean, _ = proposed(maps, seen_from(truth), guess, normals=normals)
        errors.append(np.abs(mean[0] - truth))
    assert np.max(errors, axis=0)[:2].max() < 0.004 and np.max(errors, axis=0)[2] < math.radians(0.1)
    assert np.sqrt(np.mean(np.square(errors), axis=0))[:2].max() < 0.002


def test_the_optimum_is_a_peak_of_the_posterior(maps: TileMaps) -> None:
    """No step of the last size (0.6 mm, 0.3 mrad) along an axis improves on it, and the evidence is its height."""
    rng = np.random.default_rng(1)
    prior = np.array([[400.0, 30.0, 10.0], [30.0, 900.0, -20.0], [10.0, -20.0, 2500.0]])
    for _ in range(8):
        truth = np.array([*rng.uniform(-0.8, 0.8, 2), rng.uniform(-3, 3)])
        guess = truth + rng.normal(0, [0.03, 0.03, 0.02])
        points = seen_from(truth)
        mean, evidence = proposed(maps, points, guess, prior)
        height = log_posterior(maps, 0, points, guess, prior, mean[0])
        assert evidence[0] == pytest.approx(height, abs=1e-5)
        assert height > log_posterior(maps, 0, points, guess, prior, guess) + 1.0
        for step in np.diag(STEPS[[0, 0, 1]] / np.float64(2**HALVINGS)):
            for sign in (-1, 1):
                assert log_posterior(maps, 0, points, guess, prior, mean[0] + sign * step) <= height + 1e-5


def test_mean_and_evidence_are_those_of_the_samples(maps: TileMaps) -> None:
    """The optimum and 40 poses round it, weighed by their posterior, which is worked out by its own formula."""
    rng = np.random.default_rng(2)
    truth = np.array([0.3, -0.2, 0.7])
    guesses = truth + rng.normal(0, [0.03, 0.03, 0.02], (3, 3))
    points, prior, normals = seen_from(truth), np.diag([400.0, 900.0, 2500.0]), rng.standard_normal((3, 40, 3))
    three = TileMaps(3, maps.settings)
    three._table, three._field, three._origin = np.repeat(maps.table, 3, axis=0), maps.field, maps.origin
    optima, _ = proposed(three, points, guesses, prior)
    means, evidence = proposed(three, points, guesses, prior, normals)
    for k in range(3):
        poses = np.vstack([optima[k] + normals[k] * [SPREAD[0], SPREAD[0], SPREAD[1]], optima[k]])
        heights = np.array([log_posterior(maps, 0, points, guesses[k], prior, pose) for pose in poses])
        w = np.exp(heights - heights.max())
        np.testing.assert_allclose(means[k], w @ poses / w.sum(), atol=1e-6)
        assert evidence[k] == pytest.approx(heights.max() + math.log(w.mean()), abs=1e-4)
        assert np.abs(means[k] - optima[k]).max() > 1e-4  # the samples had a say


def test_a_tight_prior_holds_the_guess(maps: TileMaps) -> None:
    guess = np.array([0.35, -0.16, 0.74])
    mean, _ = proposed(maps, seen_from(np.array([0.3, -0.2, 0.7])), guess, np.diag([1e9, 1e9, 1e9]))
    np.testing.assert_allclose(mean[0], guess, atol=1e-3)


def test_the_prior_is_in_the_frame_of_the_guess(maps: TileMaps) -> None:
    """The robot faces +y. Sure of the way ahead and of its heading, it is put right to the side, along x, alone."""
    truth = np.array([0.3, -0.2, math.pi / 2])
    guess = truth + np.array([0.04, 0.05, 0.0])
    mean, _ = proposed(maps, seen_from(truth), guess, np.diag([1e8, 1.0, 1e8]))
    np.testing.assert_allclose(mean[0], [truth[0], guess[1], truth[2]], atol=4e-3)
    mean, _ = proposed(maps, seen_from(truth), guess, np.diag([1.0, 1e8, 1e8]))
    np.testing.assert_allclose(mean[0], [guess[0], truth[1], truth[2]], atol=4e-3)


def test_what_the_scan_leaves_open_stays_with_the_guess() -> None:
    """Between two walls along x, 20 m long: across and heading come back, along stays within the prior's 1 cm."""
    x = np.arange(-10.0, 10.0, 0.02)
    corridor = np.vstack([np.column_stack([x, 0 * x - 1.025]), np.column_stack([x, 0 * x + 1.025])])
    maps = map_of(corridor)
    near = corridor[np.abs(corridor[:, 0]) < 5.0]
    truth, guess = np.array([0.2, 0.1, 0.3]), np.array([0.25, 0.15, 0.33])
    mean, _ = proposed(maps, seen_from(truth, near), guess, np.diag([100.0**2, 100.0, 100.0]))
    assert mean[0, 1] == pytest.approx(0.1, abs=0.004) and mean[0, 2] == pytest.approx(0.3, abs=0.002)
    along = geometry.between(guess, mean[0])[0]
    assert abs(along) < 0.02 and mean[0, 0] == pytest.approx(0.25, abs=0.025)


def test_the_evidence_tells_the_right_map_from_wrong_ones() -> None:
    """Particles with the room, one that is 30 cm wider, and no map at all: by far, by some, not at all."""
    maps = map_of(WALLS, room(5.3, 4.0), np.zeros((0, 2)))
    truth = np.array([0.3, -0.2, 0.7])
    guesses = np.tile(truth + np.array([0.02, -0.03, 0.02]), (3, 1))
    normals = np.random.default_rng(3).standard_normal((1, 30, 3)).repeat(3, axis=0)
    means, evidence = proposed(maps, seen_from(truth), guesses, np.diag([1e3, 1e3, 1e4]), normals)
    np.testing.assert_allclose(means[0], truth, atol=0.004)
    assert evidence[0] > evidence[1] + 10 > evidence[2] + 20
    assert -3.0 < evidence[2] <= 0.0  # the prior alone
    # 300 points or so on walls have log(10) each, of which TEMPER is counted.
    assert evidence[0] == pytest.approx(TEMPER * math.log(10) * len(seen_from(truth)), rel=0.15)


def test_every_particle_is_proposed_by_itself(maps: TileMaps) -> None:
    """Together or one at a time, the same to the last bit."""
    rng = np.random.default_rng(4)
    two = map_of(WALLS, room(5.3, 4.0))
    points = seen_from(np.array([0.1, 0.2, 0.3]))
    guesses = np.array([0.1, 0.2, 0.3]) + rng.normal(0, 0.02, (2, 3))
    normals = rng.standard_normal((2, 10, 3))
    means, evidence = proposed(two, points, guesses, LOOSE, normals)
    for k in range(2):
        alone = propose(
            two.table[k : k + 1], two.field, two.origin, two.cell, points, TEMPER, guesses[k : k + 1], LOOSE, ALONE,
            APART, STEPS, HALVINGS, MOVES, normals[k : k + 1], SPREAD,
        )  # fmt: skip
        np.testing.assert_array_equal(alone[0][0], means[k])
        assert alone[1][0] == evidence[k]


def test_an_empty_scan_leaves_the_guess(maps: TileMaps) -> None:
    mean, evidence = proposed(maps, np.zeros((0, 2)), np.array([1.0, 2.0, 0.5]))
    np.testing.assert_array_equal(mean, [[1.0, 2.0, 0.5]])
    assert evidence[0] == 0.0


# Where the search starts


def started(maps: TileMaps, guess: Array, deviation: Array, pose: Array) -> Array:
    prior = np.diag(np.maximum(deviation, 1e-3) ** -2)
    starts = window(np.diag(deviation**2), APART, 2.0, 12)
    points = seen_from(pose)
    table = maps.table[0]
    return best_start(table, maps.field, maps.origin, maps.cell, points, TEMPER, guess, prior, starts, APART)


def test_a_wide_motion_starts_near_the_truth(maps: TileMaps) -> None:
    """0.4 m and 0.25 rad off, with deviations of 0.25 m and 0.15 rad: the nearest of the grid's poses is found."""
    pose = np.array([0.3, -0.2, 0.4])
    guess = pose + np.array([0.3, -0.25, 0.25])
    start = started(maps, guess, np.array([0.25, 0.25, 0.15]), pose)
    assert np.hypot(*(start - pose)[:2]) < 0.1 and abs(start[2] - pose[2]) < 0.03
    steps = geometry.between(guess, start) / APART[[0, 0, 1]]
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)


def test_the_window_of_starts_follows_the_motions_uncertainty(maps: TileMaps) -> None:
    """What is known to less than half a step is not searched; nor is more than so many steps."""
    pose = np.array([0.3, -0.2, 0.4])
    guess = pose + np.array([0.0, 0.0, 0.25])
    np.testing.assert_array_equal(started(maps, guess, np.array([0.04, 0.04, 0.01]), pose), guess)
    turned = started(maps, guess, np.array([0.04, 0.04, 0.15]), pose)
    assert (turned[:2] == guess[:2]).all() and abs(turned[2] - pose[2]) < 0.03
    covariance = np.diag(np.array([0.26, 0.04, 2.0]) ** 2)
    assert window(covariance, APART, 2.0, 12).tolist() == [5, 0, 12]


# Which points are matched


def test_near_walls_do_not_outvote_far_ones() -> None:
    """A wall seen every cm keeps every fifth point, one seen every 8 cm all of them."""
    near = np.column_stack([np.full(101, 1.0), np.arange(101) * 0.01])
    far = np.column_stack([np.full(20, 9.0), np.arange(20) * 0.08])
    kept = spread_points(np.vstack([near, far]), np.zeros(2), 20.0, 0.045, 1000)
    np.testing.assert_allclose(kept, np.vstack([near[::5], far]))


def test_far_points_are_left_out_as_seen_from_the_lidar() -> None:
    """The lidar is 2 m ahead: a point 21 m from the robot is 19 m from it, one behind at -19 m is 21 m from it."""
    points = np.array([[21.0, 0.0], [-19.0, 0.0], [0.0, 5.0]])
    np.testing.assert_array_equal(spread_points(points, np.array([2.0, 0.0]), 20.0, 0.05, 10), points[[0, 2]])


def test_a_point_left_out_is_not_measured_from() -> None:
    """Of 0, 3, 6 and 9 cm with 5 cm spacing the first and third stay; a far point between them does not matter."""
    points = np.array([[1.0, 0.0], [1.0, 0.03], [50.0, 0.0], [1.0, 0.06], [1.0, 0.09]])
    np.testing.assert_array_equal(spread_points(points, np.zeros(2), 20.0, 0.05, 10), points[[0, 3]])


@pytest.mark.parametrize(
    ("count", "most", "kept"), [(7, 10, 7), (10, 10, 10), (11, 10, 10), (100, 10, 10), (25, 10, 10)]
)
def test_too_many_are_thinned_evenly(count: int, most: int, kept: int) -> None:
    points = np.column_stack([np.full(count, 1.0), np.arange(count, dtype=np.float64)])
    out = spread_points(points, np.zeros(2), 1e3, 0.05, most)
    assert len(out) == kept and out[0, 1] == 0
    gaps = np.diff(out[:, 1])
    assert set(gaps) <= {math.floor(count / kept), math.ceil(count / kept)}
    assert count - out[-1, 1] <= math.ceil(count / kept)


def test_no_points_at_all() -> None:
    assert spread_points(np.zeros((0, 2)), np.zeros(2), 20.0, 0.05, 10).shape == (0, 2)
    assert spread_points(np.array([[30.0, 0.0]]), np.zeros(2), 20.0, 0.05, 10).shape == (0, 2)
