"""The walls in a scan: by hand, and against a plain twin; and which of its points are near."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.slam.graph import walls
from pfslam_viz.slam.graph.walls import describe, thinned, within
from tests.kernels import from_python

Array = NDArray[np.float64]

beam_increment, wall_normals = from_python(walls.beam_increment), from_python(walls.wall_normals)


def normals_of(points: Array, sensor: Array, reach: float, spacings: float, neighbours: int, flatness: float) -> Array:
    return np.asarray(wall_normals(points, sensor, reach, spacings, neighbours, flatness)[0])


@pytest.mark.parametrize("direction", [0.0, 0.4, math.pi / 2, 2.5])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_normal_of_a_straight_wall_points_to_the_lidar(direction: float, side: float) -> None:
    """A wall 1 m to the side of the lidar, which is not where the robot is: some walls lie between the two."""
    along = np.array([math.cos(direction), math.sin(direction)])
    normal = np.array([-along[1], along[0]])
    sensor = np.array([3.0, -2.0])
    points = sensor - side * 1.0 * normal + np.linspace(-1, 1, 60)[:, None] * along
    np.testing.assert_allclose(
        normals_of(points, sensor, 0.3, 0.0, 20, 0.1), np.tile(side * normal, (60, 1)), atol=1e-6
    )


def test_a_rough_wall_has_about_its_normal() -> None:
    """Noise of 1 cm on 13 points over 0.6 m turns a line by 1 cm / (√13 · 0.19 m), 0.015 rad, about."""
    points = np.column_stack([np.linspace(-2, 2, 81), 1.0 + 0.01 * np.random.default_rng(0).standard_normal(81)])
    normals = normals_of(points, np.zeros(2), 0.3, 0.0, 20, 0.1)[6:-6]
    angle = np.arctan2(normals[:, 0], -normals[:, 1])
    assert 0.007 < np.sqrt(np.mean(angle**2)) < 0.03
    assert np.allclose(np.hypot(*normals.T), 1.0)


def test_corners_and_stray_points_have_no_normal() -> None:
    """Two walls meet at (2, 1): half a metre off the corner they are straight, on it there is no line."""
    ahead = np.column_stack([np.full(21, 2.0), np.linspace(-1, 1, 21)])
    aside = np.column_stack([np.linspace(1.95, 0, 40), np.full(40, 1.0)])
    stray = np.array([[-1.0, 1.0], [-1.0, 0.5]])
    normals = normals_of(np.vstack([ahead, aside, stray]), np.zeros(2), 0.3, 0.0, 20, 0.1)
    np.testing.assert_array_equal(normals[20:22], 0)
    np.testing.assert_allclose(normals[:15], np.tile([-1.0, 0.0], (15, 1)), atol=1e-6)
    np.testing.assert_allclose(normals[28:61], np.tile([0.0, -1.0], (33, 1)), atol=1e-6)
    np.testing.assert_array_equal(normals[-2:], 0)


def test_a_normal_needs_two_neighbours_within_reach() -> None:
    wall = np.array([[1.0, 0.0], [1.0, 0.25], [1.0, 0.5]])
    sensor = np.zeros(2)
    np.testing.assert_allclose(normals_of(wall, sensor, 0.3, 0.0, 20, 0.1)[1], [-1.0, 0.0], atol=1e-6)
    np.testing.assert_array_equal(normals_of(wall, sensor, 0.3, 0.0, 20, 0.1)[[0, 2]], 0)  # one neighbour each
    np.testing.assert_array_equal(normals_of(wall, sensor, 0.2, 0.0, 20, 0.1), 0)
    np.testing.assert_array_equal(
        normals_of(np.tile([[1.0, 0.5]], (5, 1)), sensor, 0.2, 0.0, 20, 0.1), 0
    )  # a heap, no line


def plain_normals(
    points: Array, sensor: Array, reach: float, spacings: float, neighbours: int, flatness: float
) -> Array:
    """The eigenvector of the smaller eigenvalue of the neighbours' covariance, as NumPy finds it."""
    out = np.zeros_like(points)
    seen = points - sensor
    increment = np.median(np.abs(np.diff(np.unwrap(np.arctan2(seen[:, 1], seen[:, 0])))))
    for b, point in enumerate(points):
        near = np.hypot(*(points - point).T) <= max(reach, spacings * increment * np.hypot(*seen[b]))
        first = max([k + 1 for k in range(b) if not near[k]] + [b - neighbours, 0])
        end = min([k for k in range(b + 1, len(points)) if not near[k]] + [b + neighbours + 1, len(points)])
        if end - first < 3:
            continue
        values, vectors = np.linalg.eigh(np.cov(points[first:end].T))
        if values[0] <= flatness * values[1]:
            out[b] = vectors[:, 0] * (1.0 if vectors[:, 0] @ (sensor - point) >= 0.0 else -1.0)
    return out


@pytest.mark.parametrize(("spacings", "neighbours"), [(0.0, 2), (0.0, 20), (5.0, 20), (8.0, 20)])
def test_normals_equal_their_plain_twin(spacings: float, neighbours: int) -> None:
    """Walls that bend and end, rough in places, with stray points between them, seen all around."""
    rng = np.random.default_rng(3)
    bearings = np.linspace(-3.0, 3.0, 500)
    ranges = 3.0 + np.sin(5 * bearings) + np.where(bearings > 1.0, 0.05, 0.003) * rng.standard_normal(500)
    ranges[200:260] += 1.0
    ranges[rng.integers(0, 500, 20)] *= 0.5
    sensor = np.array([0.4, -0.3])
    points = sensor + np.stack([ranges * np.cos(bearings), ranges * np.sin(bearings)], axis=-1)
    expected = plain_normals(points, sensor, 0.3, spacings, neighbours, 0.1)
    np.testing.assert_allclose(normals_of(points, sensor, 0.3, spacings, neighbours, 0.1), expected, atol=1e-6)
    assert 0.1 < expected.any(axis=1).mean() < 0.95  # some have one, some have none


def test_far_walls_have_normals_though_their_end_points_lie_far_apart() -> None:
    """Beams 2° apart see a wall 10 m ahead: 0.35 m from one end point to the next, farther to the sides.

    Within 0.3 m there is no neighbour; three beam distances, 1.05 m there, reach two or three to either side. A wall
    1 m behind has its end points 3.5 cm apart and is as it was.
    """
    bearings = np.radians(np.arange(-30.0, 31.0, 2.0))
    ahead = np.column_stack([np.full(31, 10.0), 10.0 * np.tan(bearings)])
    behind = np.column_stack([np.full(31, -1.0), -np.tan(bearings)])
    points, sensor = np.vstack([ahead, behind]), np.zeros(2)
    assert np.hypot(*np.diff(ahead, axis=0).T).min() > 0.34
    without = normals_of(points, sensor, 0.3, 0.0, 20, 0.1)
    np.testing.assert_array_equal(without[:31], 0)
    np.testing.assert_allclose(without[31:], np.tile([1.0, 0.0], (31, 1)), atol=1e-6)
    found = normals_of(points, sensor, 0.3, 3.0, 20, 0.1)
    np.testing.assert_allclose(found[1:30], np.tile([-1.0, 0.0], (29, 1)), atol=1e-6)
    np.testing.assert_array_equal(found[31:], without[31:])


def test_spacings_reach_as_far_as_they_say() -> None:
    """End points at 10 m, 2° apart: 0.3491 m at the middle. 0.9 of that find no neighbour, 1.1 one to either side.

    The two ahead and behind of the middle lie off the line through it and the next: whether they count shows.
    """
    y = 10.0 * np.tan(np.radians(np.arange(-4.0, 5.0, 2.0)))
    points = np.column_stack([10.0 + np.array([0.15, 0.0, 0.0, 0.0, 0.3]), y])
    assert not normals_of(points, np.zeros(2), 0.01, 0.9, 20, 0.1)[2].any()
    np.testing.assert_allclose(normals_of(points, np.zeros(2), 0.01, 1.1, 20, 0.1)[2], [-1.0, 0.0], atol=1e-9)
    turned = normals_of(points, np.zeros(2), 0.01, 2.5, 20, 0.1)[2]
    slope = np.polyfit(y, points[:, 0], 1)[0]  # of x over y: 0.0858, with all five
    assert slope == pytest.approx((0.3 - 0.15) * y[4] / (2 * (y[3] ** 2 + y[4] ** 2)), rel=1e-9)
    assert math.atan2(turned[1], -turned[0]) == pytest.approx(math.atan(slope), abs=0.01)


def test_the_increment_between_beams_is_the_median_angle() -> None:
    """Seen from (1, 1): at 10°, 11°, 12°, 14°, 90°, and across ±180°; ranges do not matter."""
    sensor = np.array([1.0, 1.0])

    def seen(*degrees: float) -> Array:
        bearings = np.radians(degrees)
        away = 1.0 + np.arange(len(degrees))[:, None]
        points: Array = sensor + away * np.column_stack([np.cos(bearings), np.sin(bearings)])
        return points

    assert beam_increment(seen(10, 11, 12, 14, 90), sensor) == pytest.approx(math.radians(1.5))  # 1, 1, 2, 76
    assert beam_increment(seen(178, 179.5, -179), sensor) == pytest.approx(math.radians(1.5))
    assert beam_increment(seen(30, 28, 26), sensor) == pytest.approx(math.radians(2.0))  # clockwise
    assert beam_increment(seen(30), sensor) == beam_increment(np.zeros((0, 2)), sensor) == 0.0


def test_a_scan_is_described_with_its_normals_and_the_bearings_of_its_beams() -> None:
    """Beams from 1 rad on, through π and on over a gap of 3.5 rad: bearings go on increasing from the first."""
    bearings = np.concatenate([np.linspace(1.0, 3.4, 40), np.linspace(6.9, 7.2, 10)])
    sensor = np.array([-0.2, 0.5])
    points = sensor + 2.0 * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    rows = np.zeros((50, 5), np.float32)
    describe(points, sensor, 0.3, 0.0, 20, 0.1, rows)
    np.testing.assert_allclose(rows[:, :2], points, atol=1e-6)
    np.testing.assert_allclose(rows[:, 2:4], normals_of(points, sensor, 0.3, 0.0, 20, 0.1), atol=1e-6)
    np.testing.assert_allclose(rows[:, 4], bearings, atol=1e-5)


def test_points_within_a_distance() -> None:
    """Of four points 1, 2, 2 and 3 m from (1, 1), in their order; the border belongs to it."""
    points = np.array([[2.0, 1.0], [1.0, 3.0], [1.0, 4.0], [-1.0, 1.0]])
    np.testing.assert_array_equal(within(points, np.ones(2), 2.0), points[[0, 1, 3]])
    assert within(points, np.ones(2), 0.5).shape == within(np.zeros((0, 2)), np.ones(2), 5.0).shape == (0, 2)


def test_the_noise_is_the_variance_of_the_normals() -> None:
    """A straight wall 2 m ahead, end points 2 cm apart with noise of 5 mm: normals scatter about straight ahead.

    The mean over many scans of the squared angle that a normal is off by, measured, is what one scan says of itself.
    """
    rng = np.random.default_rng(8)
    y = np.arange(-1.0, 1.001, 0.02)
    told, off = [], []
    for _ in range(60):
        points = np.column_stack([2.0 + 0.005 * rng.standard_normal(len(y)), y])
        normals, noise = wall_normals(points, np.zeros(2), 0.3, 0.0, 20, 0.1)
        told.append(noise)
        off.append(np.mean(np.arctan2(normals[:, 1], -normals[:, 0]) ** 2))
    assert np.mean(told) == pytest.approx(np.mean(off), rel=0.15)
    line = np.column_stack([np.full(len(y), 2.0), y])
    assert wall_normals(line, np.zeros(2), 0.3, 0.0, 20, 0.1)[1] < 1e-12
    rows = np.zeros((len(y), 5), np.float32)
    assert describe(points, np.zeros(2), 0.3, 0.0, 20, 0.1, rows) == noise
    assert wall_normals(np.zeros((0, 2)), np.zeros(2), 0.3, 0.0, 20, 0.1)[1] == 0.0


def test_end_points_are_thinned_where_they_lie_close_together() -> None:
    """20 end points 2 cm apart, then five 10 cm apart: every third of the former, all of the latter."""
    x = np.concatenate([0.02 * np.arange(20), 0.38 + 0.1 * np.arange(1, 6)])
    points = np.column_stack([x, np.ones(25)])
    kept = thinned(points, 9, 0.08)  # every third: 25 / 9
    np.testing.assert_array_equal(kept, points[[0, 3, 6, 9, 12, 15, 18, *range(20, 25)]])
    np.testing.assert_array_equal(thinned(points, 9, 1.0), points[::3])
    np.testing.assert_array_equal(thinned(points, 25, 1.0), points)
    assert thinned(points[:0], 9, 0.08).shape == (0, 2)
