import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.simulation.drive import RATE, Drive, DriveConfig, drive_along
from pfslam_viz.simulation.world import distance_to_polyline

ROUTE = np.array([(0.0, 0.0), (8.0, 0.0), (8.0, 0.9), (2.0, 0.9), (2.0, 6.0)])


def drive(duration: float | None = None, **options: float) -> Drive:
    return drive_along(ROUTE, np.random.default_rng(3), DriveConfig(**options), duration)


def test_stands_still_at_both_ends() -> None:
    d = drive()
    before, after = d.times < d.still_before - 0.5, d.times > d.duration - d.still_after + 0.5
    assert before.sum() > 2.0 * RATE and after.sum() > 1.5 * RATE
    assert np.abs(d.speed[before | after]).max() < 1e-9
    assert np.ptp(d.poses[before], axis=0).max() < 1e-9 and np.ptp(d.poses[after], axis=0).max() < 1e-9


def test_goes_along_the_route_to_its_end() -> None:
    d = drive()
    assert distance_to_polyline(d.poses[::10, :2], ROUTE).max() < 0.35
    assert d.poses[0, :2] == pytest.approx(ROUTE[0], abs=0.03)
    assert d.poses[-1, :2] == pytest.approx(ROUTE[-1], abs=0.03)


def test_moves_forward_at_the_speed_it_reports() -> None:
    d = drive()
    steps = geometry.between(d.poses[:-1], d.poses[1:])
    middle = 0.5 * (d.speed[1:] + d.speed[:-1]) / RATE
    assert steps[:, 0] == pytest.approx(middle, abs=2e-4)
    assert np.abs(steps[:, 1]).max() < 2e-4  # wheels do not go sideways
    turned = np.cumsum(d.yaw_rate) / RATE
    assert turned[-1] == pytest.approx(np.unwrap(d.poses[:, 2])[-1] - d.poses[0, 2], abs=0.01)


def test_keeps_its_limits() -> None:
    d = drive(cruise=1.0, yaw_rate=0.8, hesitation=0.0)
    assert 0.95 < d.speed.max() < 1.001
    assert np.abs(d.yaw_rate).max() < 0.8 * 1.15  # smoothing the speed over time shifts it a little along the path
    assert np.abs(np.diff(d.speed) * RATE).max() < 1.0


def test_duration_shortens_the_drive() -> None:
    whole, short = drive(), drive(12.0)
    assert short.duration == pytest.approx(12.0, abs=0.1) and whole.duration > 20.0
    assert short.speed[-1] == pytest.approx(0.0, abs=1e-6)
    assert 3.0 < short.speed.sum() / RATE < 10.0
    assert drive(1000.0).duration == whole.duration


@pytest.mark.parametrize("duration", [-1.0, 0.0, 4.9, float("nan")])
def test_too_short_a_duration_is_an_input_error(duration: float) -> None:
    with pytest.raises(InputError, match="at least 5 s"):
        drive(duration)
