"""The covariance of the pose in the frame of the first one: against drives that are simulated many times over."""

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.rbpf.drift_covariance import DriftCovariance, _known, _smaller
from pfslam_viz.slam.rbpf.settings import UncertaintyConfig

Array = NDArray[np.float64]

NOISE = np.array([0.01, 0.01, 0.004])  # m, m, rad a step
CONFIG = UncertaintyConfig(scan_weight=1.0, scale=1e-6, slip=1e-6, least_distance=1e-6, least_angle=1e-6)


def bend() -> Array:
    """(41, 3) poses 0.5 m apart: straight on, then round a corner."""
    steps = np.tile([0.5, 0.0, 0.0], (41, 1))
    steps[0] = 0.0
    steps[20:25, 2] = math.pi / 10
    return geometry.accumulate(steps)


def carried(poses: Array, config: UncertaintyConfig, odometry: Array, scans: Array) -> DriftCovariance:
    """All motions along ``poses`` told with the same information."""
    drift = DriftCovariance(config)
    for before, pose in pairwise(poses):
        drift.add(before, pose, geometry.between(before, pose), odometry, scans)
    return drift


def test_independent_errors_add_up_with_their_levers() -> None:
    """The sample covariance of 4,000 drives whose every step is off by its own noise."""
    poses = bend()
    rng = np.random.default_rng(0)
    steps = geometry.between(poses[:-1], poses[1:])
    ends = np.array([
        geometry.accumulate(np.vstack([np.zeros(3), geometry.compose(steps, NOISE * rng.standard_normal((40, 3)))]))[-1]
        for _ in range(4000)
    ])  # fmt: skip
    errors = ends - poses[-1]
    errors[:, 2] = geometry.wrap(errors[:, 2])
    sample = errors.T @ errors / len(errors)
    told = carried(poses, CONFIG, 0.25 * np.diag(NOISE**-2), 0.75 * np.diag(NOISE**-2)).covariance
    size = np.sqrt(np.diag(sample))
    np.testing.assert_allclose(told / np.outer(size, size), sample / np.outer(size, size), atol=0.08)


@pytest.mark.parametrize(("length", "slip"), [(1e9, 1e-6), (1.0, 0.1)])
def test_the_scale_of_the_wheels_adds_up_where_the_scans_are_silent_along_the_way(length: float, slip: float) -> None:
    """20 m of bare corridor: a scale that never changes is off by 5 % of it; one that changes every metre by less.

    The latter is a Gauss-Markov process of 0.1; over n steps of 0.5 m the sum's variance is that of its covariances
    exp(-|i - j| / 2), drawn here as a matrix.
    """
    poses = np.column_stack([0.5 * np.arange(41), np.zeros((41, 2))])
    scale = 0.05 if length > 1e3 else slip
    config = CONFIG.model_copy(update={"scale": scale, "slip": slip, "slip_length": length})
    odometry, scans = np.diag([1e6, 1e6, 1e6]), np.diag([0.0, 1e12, 1e12])
    told = carried(poses, config, odometry, scans).covariance
    lags = np.abs(np.arange(40)[:, None] - np.arange(40))
    expected = (0.5 * scale) ** 2 * np.exp(-0.5 * lags / length).sum() + 40 * 1e-6
    assert told[0, 0] == pytest.approx(expected, rel=1e-3)
    assert told[1, 1] < 1e-6 and told[2, 2] < 1e-6  # across, and the heading: the scans know
    nothing_open = carried(poses, config, odometry, np.diag([1e12, 1e12, 1e12])).covariance
    assert nothing_open[0, 0] < 1e-6


def visit(start: int, end: int, poses: Array, missed: float, information: Array) -> Constraints:
    """A match of two key scans that ``poses`` miss by so much along x."""
    measured = geometry.compose(geometry.between(poses[start], poses[end]), np.array([missed, 0.0, 0.0]))
    return Constraints(np.array([start]), np.array([end]), measured[None], information[None], np.ones(1, np.bool_))


def test_what_was_known_at_an_earlier_place_is_known_there_again() -> None:
    """There and back again, facing the same way: the start's covariance and the match's, and nothing of the way."""
    poses = np.column_stack([[*np.arange(21.0), *np.arange(19.0, -1.0, -1.0)], np.zeros((41, 2))])
    odometry = scans = 0.5 * np.diag(NOISE**-2)
    drift = carried(poses, CONFIG, odometry, scans)
    lost = drift.covariance.copy()
    assert lost[0, 0] == pytest.approx(40 * NOISE[0] ** 2, rel=0.01)
    drift.come_back(poses, visit(0, 40, poses, 0.2, np.diag([1e6, 1e6, 1e6])))  # too far off: not where it should be
    np.testing.assert_array_equal(drift.covariance, lost)
    drift.come_back(poses, visit(0, 40, poses, 0.02, np.diag([1e6, 1e6, 1e6])))
    floor = np.array([CONFIG.visit_distance, CONFIG.visit_distance, CONFIG.visit_angle])
    np.testing.assert_allclose(np.sqrt(np.diag(drift.covariance)), np.sqrt(floor**2 + 1e-6), rtol=0.01)


def test_along_a_bare_corridor_coming_back_tells_nothing() -> None:
    """The match knows x by a tenth of what it knows across: unevenness of the walls, which fits anywhere."""
    poses = np.column_stack([[*np.arange(21.0), *np.arange(19.0, -1.0, -1.0)], np.zeros((41, 2))])
    drift = carried(poses, CONFIG, 0.5 * np.diag(NOISE**-2), 0.5 * np.diag(NOISE**-2))
    lost = drift.covariance.copy()
    drift.come_back(poses, visit(0, 40, poses, 0.0, np.diag([1e5, 1e6, 1e6])))
    assert drift.covariance[0, 0] == pytest.approx(lost[0, 0], rel=1e-3)
    assert drift.covariance[1, 1] < 0.01 * lost[1, 1]


def test_a_revisit_some_key_scans_ago_counts_with_what_came_since() -> None:
    """Key scan 36 came back to 4; four more steps back to 0 add their own noise."""
    poses = np.column_stack([[*np.arange(21.0), *np.arange(19.0, -1.0, -1.0)], np.zeros((41, 2))])
    information = 0.5 * np.diag(NOISE**-2)
    drift = carried(poses, CONFIG, information, information)
    drift.come_back(poses, visit(4, 36, poses, 0.0, np.diag([1e8, 1e8, 1e8])))
    # x: four steps to key scan 4, the match, four steps since
    assert drift.covariance[0, 0] == pytest.approx(8 * NOISE[0] ** 2 + CONFIG.visit_distance**2, rel=0.02)


def test_the_smaller_of_two_covariances_in_each_direction() -> None:
    """Ellipses along the axes, turned together: the shorter half axes of both."""
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    one, other = turn @ np.diag([4.0, 1.0, 9.0]) @ turn.T, turn @ np.diag([1.0, 2.0, 16.0]) @ turn.T
    np.testing.assert_allclose(_smaller(one, other), turn @ np.diag([1.0, 1.0, 9.0]) @ turn.T, atol=1e-12)


def test_a_direction_with_too_small_a_share_is_not_known() -> None:
    """Also where x and the heading are coupled, as by a wall ahead that is off to one side."""
    information = np.diag([10.0, 100.0, 50.0])
    np.testing.assert_array_equal(_known(information, 0.05), information)
    np.testing.assert_allclose(_known(information, 0.2), np.diag([0.0, 100.0, 50.0]), atol=1e-12)
    coupled = np.array([[30.0, 0.0, 35.0], [0.0, 100.0, 0.0], [35.0, 0.0, 50.0]])  # 30 - 35²/50 = 5.5 is left of x
    assert _known(coupled, 0.2)[0, 0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", list(UncertaintyConfig.model_fields))
def test_every_setting_counts(name: str) -> None:
    """Half or twice of each gives another covariance, on a way back along a corridor that is nearly open."""
    poses = np.column_stack([[*np.arange(21.0), *np.arange(19.0, -1.0, -1.0)], np.zeros((41, 2))])
    usual = UncertaintyConfig()

    def told(config: UncertaintyConfig) -> Array:
        drift = carried(poses, config, np.diag(NOISE**-2), np.diag([1e-9, *NOISE[1:] ** -2]))
        lost = drift.covariance.copy()
        drift.come_back(poses, visit(0, 40, poses, 0.07, np.diag([3e5, 1e6, 1e6])))
        return np.stack([lost, drift.covariance])

    value = getattr(usual, name)
    others = [usual.model_copy(update={name: factor * value}) for factor in (0.5, 2.0)]
    assert any(not np.allclose(told(usual), told(other), rtol=1e-6) for other in others)
