"""The odometry's errors from motions known twice, with numbers worked out by hand."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.slam.graph.odometry_errors import Latest, OdometryErrors
from pfslam_viz.slam.graph.settings import OdometryConfig

Array = NDArray[np.float64]

ROOM = np.diag([1e4, 1e4, 1e5])  # the scans know every direction
CORRIDOR = np.diag([0.0, 1e4, 1e5])  # they know nothing along x
DEVIATION = np.array([0.01, 0.01, 0.02])
NORMAL = 1.4826


def config(**settings: float) -> OdometryConfig:
    """Without a prior, which settings must have, nor limits that these numbers reach."""
    free = {"prior_motions": 0, "least_noise": 1e-6, "most_noise": 1e6, "scale_motions": 5}
    return OdometryConfig().model_copy(update=free | settings)


def errors(
    odometry: Array, found: Array, settings: OdometryConfig, information: Array = ROOM, *, forget: bool = True
) -> OdometryErrors:
    out = OdometryErrors(settings, forget=forget)
    for said, seen in zip(odometry, found, strict=True):
        out.add(said, seen, information, DEVIATION)
    return out


def values(found: OdometryErrors) -> tuple[float, float, float]:
    return found.scale, found.distance, found.angle


def test_before_any_motion_the_settings_hold() -> None:
    assert values(OdometryErrors(OdometryConfig())) == (1.0, 1.0, 1.0)


def test_the_scale_is_the_median_of_what_was_driven_over_what_was_said() -> None:
    """0.2 m said each time; 0.19, 0.2, 0.21, 0.21 and 0.22 driven: 1.05. The residuals are then 2, 1, 0, 0, 1 cm ahead.

    and 0, 0, 0, 1, 3 cm aside: sorted 0 0 0 0 0 | 1 1 1 2 3, a median of half a centimetre, half the deviation.
    """
    odometry = np.tile([0.2, 0.0, 0.0], (5, 1))
    found = np.array([[0.19, 0, 0], [0.2, 0, 0], [0.21, 0, 0], [0.21, 0.01, 0], [0.22, -0.03, 0]])
    got = errors(odometry, found, config())
    assert got.scale == pytest.approx(1.05)
    assert got.distance == pytest.approx(NORMAL * 0.5)


def test_ahead_is_where_the_odometry_says() -> None:
    """The same, by a robot that drives sideways, backwards and askew: only along its way does the scale count."""
    odometry = np.tile([0.2, 0.0, 0.0], (5, 1))
    found = np.array([[0.19, 0, 0], [0.2, 0, 0], [0.21, 0, 0], [0.21, 0.01, 0], [0.22, -0.03, 0]])
    for k, way in enumerate((math.pi / 2, math.pi, 0.7, -2.0, 0.0)):
        c, s = math.cos(way), math.sin(way)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        odometry[k], found[k] = odometry[k] @ turn, found[k] @ turn
    got = errors(odometry, found, config())
    assert got.scale == pytest.approx(1.05) and got.distance == pytest.approx(NORMAL * 0.5)


def test_the_angles_noise_is_the_median_of_the_residuals_over_the_deviation() -> None:
    """0.01, 0.04, 0.02 rad amiss against 0.02 expected: the middle one is 1, and goes through π."""
    odometry = np.array([[0.0, 0, 0.3], [0, 0, -0.3], [0, 0, math.pi - 0.01]])
    found = np.array([[0.0, 0, 0.29], [0, 0, -0.34], [0, 0, -math.pi + 0.01]])
    got = errors(odometry, found, config())
    assert values(got) == pytest.approx((1.0, 1.0, NORMAL * 1.0))


def test_normal_errors_give_their_deviation() -> None:
    """2000 motions whose wheels are 4 % short, with 1.7 times the noise in distance and 0.4 times in heading."""
    rng = np.random.default_rng(0)
    odometry = np.column_stack([rng.uniform(0.1, 0.3, 2000), np.zeros(2000), rng.normal(0, 0.2, 2000)])
    found = odometry * [1.04, 1.0, 1.0] + rng.normal(0, DEVIATION * [1.7, 1.7, 0.4], (2000, 3))
    many = (np.tile(ROOM, (2000, 1, 1)), np.tile(DEVIATION, (2000, 1)))
    got = OdometryErrors.of(config(), odometry, found, *many)
    assert got.scale == pytest.approx(1.04, abs=0.005)
    assert got.distance == pytest.approx(1.7, abs=0.1) and got.angle == pytest.approx(0.4, abs=0.03)


def test_outliers_do_not_matter() -> None:
    """Two motions in ten slip by metres: nothing grows by more than what dropping to the 4th or 6th value may do."""
    rng = np.random.default_rng(1)
    odometry = np.tile([0.2, 0.0, 0.1], (500, 1))
    found = odometry * [1.02, 1.0, 1.0] + rng.normal(0, DEVIATION, (500, 3))
    slipped = found.copy()
    slipped[::5] += [3.0, -2.0, 1.5]
    clean, spoilt = (errors(odometry, f, config(memory=500)) for f in (found, slipped))
    assert spoilt.scale == pytest.approx(clean.scale, abs=0.03)
    assert 1.0 < spoilt.distance < 1.5 and 1.0 < spoilt.angle < 1.5  # means of squares would say 100 and more
    assert clean.distance == pytest.approx(1.0, abs=0.1) and clean.angle == pytest.approx(1.0, abs=0.1)


def test_corridors_and_rests_tell_no_scale() -> None:
    """In a bare corridor nothing is known of the position, at rest nothing is driven; the heading is known in both."""
    odometry = np.tile([0.2, 0.0, 0.1], (30, 1))
    found = odometry * [1.1, 1.0, 1.0] + [0.0, 0.0, 0.02]
    for got in (
        errors(odometry, found, config(), CORRIDOR),
        errors(odometry * [0.2, 1, 1], found * [0.2, 1, 1], config()),  # 4 cm are fewer than 5
    ):
        assert values(got) == pytest.approx((1.0, 1.0, NORMAL))
    assert errors(odometry, found, config()).scale == pytest.approx(1.1)


@pytest.mark.parametrize(("least", "tells"), [(1900.0, False), (2600.0, True)])
def test_every_direction_must_be_known_by_its_share(least: float, tells: bool) -> None:
    """A fifth of the whole information: 2500 of 12500. The position's axes may lie askew."""
    c, s = math.cos(0.6), math.sin(0.6)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    information = turn @ np.diag([1e4, least, 1e5]) @ turn.T
    odometry = np.tile([0.2, 0.0, 0.0], (10, 1))
    got = errors(odometry, odometry * [1.1, 1.0, 1.0], config(scale_known=0.2), information)
    assert got.scale == pytest.approx(1.1 if tells else 1.0)


def test_few_motions_tell_no_scale() -> None:
    odometry = np.tile([0.2, 0.0, 0.0], (20, 1))
    found = odometry * [1.1, 1.0, 1.0]
    assert values(errors(odometry[:19], found[:19], config(scale_motions=20)))[:2] == (1.0, 1.0)
    assert errors(odometry, found, config(scale_motions=20)).scale == pytest.approx(1.1)


@pytest.mark.parametrize(("scale", "believed"), [(1.24, True), (1.26, False), (0.81, True), (0.79, False)])
def test_a_scale_beyond_the_limits_is_not_believed(scale: float, believed: bool) -> None:
    """1.25, or 1 / 1.25 = 0.8. Then the odometry stays as it is, and what is missed shows as its noise."""
    odometry = np.tile([0.2, 0.0, 0.0], (10, 1))
    got = errors(odometry, odometry * [scale, 1.0, 1.0], config(largest_scale=1.25))
    assert got.scale == pytest.approx(scale if believed else 1.0)
    missed = 0.0 if believed else abs(scale - 1.0) * 0.2 / 0.01  # ahead; half the residuals, those aside, are zero
    assert got.distance == pytest.approx(max(NORMAL * missed / 2, 1e-6))


def test_noise_stays_within_its_limits() -> None:
    odometry = np.tile([0.2, 0.0, 0.0], (10, 1))
    exact = errors(odometry, odometry, config(least_noise=0.3))
    assert values(exact) == pytest.approx((1.0, 0.3, 0.3))
    wild = errors(odometry, odometry + np.array([0.0, 1.0, 1.0]), config(most_noise=2.5))
    assert wild.angle == wild.distance == 2.5


def test_the_settings_count_as_so_many_motions_that_agree_with_them() -> None:
    """Of exact motions, residuals 0, against 6 that say 1 / 1.4826: 5 leave the noise at 1, 6 in the middle, 7 at 0."""
    step = np.array([0.0, 0.0, 0.1])
    for count, expected in ((5, 1.0), (6, 0.5), (7, 0.0)):
        got = errors(np.tile(step, (count, 1)), np.tile(step, (count, 1)), config(prior_motions=6))
        assert got.angle == pytest.approx(max(expected, 1e-6))
    for count, expected in ((11, 1.0), (12, 0.5), (13, 0.0)):  # motions that tell the position do so twice
        odometry = np.tile([0.2, 0.0, 0.0], (count, 1))
        got = errors(odometry, odometry, config(prior_motions=2 * 12))
        assert got.distance == pytest.approx(max(expected, 1e-6))


def test_old_motions_are_forgotten_unless_all_are_asked_for() -> None:
    """50 motions of one robot, then 30 of another, and a memory of 30."""
    odometry = np.tile([0.2, 0.0, 0.0], (80, 1))
    found = odometry * [1.1, 1.0, 1.0] + [0.0, 0.0, 0.04]
    found[50:] = odometry[50:] * [0.9, 1.0, 1.0] + [0.0, 0.0, 0.01]
    late = errors(odometry, found, config(memory=30))
    assert (late.scale, late.angle) == pytest.approx((0.9, NORMAL * 0.5))
    nearly = errors(odometry[:64], found[:64], config(memory=30))  # 14 of the last 30
    assert (nearly.scale, nearly.angle) == pytest.approx((1.1, NORMAL * 2.0))
    for got in (
        errors(odometry, found, config(memory=30), forget=False),
        OdometryErrors.of(config(memory=30), odometry, found, np.tile(ROOM, (80, 1, 1)), np.tile(DEVIATION, (80, 1))),
    ):
        assert (got.scale, got.angle) == pytest.approx((1.1, NORMAL * 2.0))


def test_many_at_once_are_as_one_after_the_other() -> None:
    rng = np.random.default_rng(2)
    odometry = rng.normal(0.2, 0.05, (60, 3))
    found = odometry + rng.normal(0, 0.02, (60, 3))
    information = np.where(rng.random(60)[:, None, None] < 0.3, CORRIDOR, ROOM)
    deviation = rng.uniform(0.01, 0.03, (60, 3))
    one = OdometryErrors(OdometryConfig(), forget=False)
    for motion in zip(odometry, found, information, deviation, strict=True):
        one.add(*motion)
    assert values(OdometryErrors.of(OdometryConfig(), odometry, found, information, deviation)) == values(one)
    nothing = OdometryErrors.of(
        OdometryConfig(), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3))
    )
    assert values(nothing) == (1.0, 1.0, 1.0)


@pytest.mark.parametrize("most", [None, 1, 3, 64, 65, 200])
def test_the_latest_rows_are_those_of_a_plain_list(most: int | None) -> None:
    latest, rows = Latest(2, most), list[tuple[float, float]]()
    assert len(latest) == 0 and latest.columns.shape == (2, 0)
    for k in range(450):
        rows.append((float(k), -0.5 * k))
        latest.append(rows[-1])
        kept = rows if most is None else rows[-most:]
        assert len(latest) == len(kept)
        assert sorted(map(tuple, latest.columns.T.tolist())) == kept
