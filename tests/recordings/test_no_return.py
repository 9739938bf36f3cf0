"""Which readings are returns, on drives made by a ray caster; a lidar that writes a value for no return, and walls."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.checking.check import check
from pfslam_viz.recordings.no_return import find, without_sentinels
from pfslam_viz.recordings.recording import Lidar, Recording
from pfslam_viz.simulation.sensors import true_ranges

Array = NDArray[np.float64]

ANGLES = np.radians(np.arange(-90.0, 91.0, 2.0))


def box(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


HALL = np.array(box(-5, -4, 25, 13) + box(12, -2, 15, 0))
ROUND = np.array(
    [
        (5 * math.cos(a), 5 * math.sin(a), 5 * math.cos(a + 0.02), 5 * math.sin(a + 0.02))
        for a in np.arange(0.0, 2 * math.pi, 0.02)
    ]
)


def drive(
    walls: Array, steps: Array, digits: int = 2, noise: float = 0.01, angles: Array = ANGLES, limit: float = 80.0
) -> Recording:
    """What a robot sees that moves so; ranges written with so many ``digits``."""
    rng = np.random.default_rng(1)
    exact = true_ranges(walls, geometry.accumulate(steps), angles)[0]
    ranges = np.round(exact + noise * rng.standard_normal(exact.shape), digits)
    lidar = Lidar(angles, 0.05, limit, np.zeros(3))
    odometry = steps.copy()
    odometry[0] = 0.0
    stamps = np.linspace(0.0, 0.1 * len(steps), len(steps))
    return Recording("drive", "test", None, stamps, ranges.astype(np.float32), lidar, odometry)


def ahead(scans: int) -> Array:
    return np.tile([0.1, 0.0, 0.01], (scans, 1))


def written(recording: Recording, ranges: NDArray[np.float32], limit: float | None = None) -> Recording:
    old = recording.lidar
    lidar = Lidar(old.angles, old.range_min, limit or old.range_max, old.pose)
    return Recording("drive", "test", None, recording.stamps, ranges, lidar, recording.odometry)


def returns(recording: Recording) -> NDArray[np.bool_]:
    """Which readings (n, B) are returns."""
    return (recording.ranges >= recording.lidar.range_min) & (recording.ranges <= recording.lidar.range_max)


@pytest.mark.parametrize("limit", [8.0, 80.0])
@pytest.mark.parametrize(("most", "digits"), [(8.0, 2), (8.0, 6), (5.6, 3), (12.0, 2), (20.0, 1)])
def test_the_greatest_range_for_no_return(most: float, digits: int, limit: float) -> None:
    """Everything farther than ``most`` is written as that; a file may declare that limit or none (80 m)."""
    seen = drive(HALL, ahead(150), digits)
    short = written(seen, np.minimum(seen.ranges, np.float32(most)), max(most, limit))
    assert (seen.ranges >= np.float32(most)).mean() > 0.02
    made = without_sentinels(short)
    np.testing.assert_array_equal(returns(made), seen.ranges < np.float32(most))
    assert len(made.notes) == 1 and f"no return is written as {most:.2f} m" in made.notes[0]
    share = 100 * (seen.ranges >= np.float32(most)).mean()
    assert f"({share:.0f} % of the readings)" in made.notes[0]
    np.testing.assert_array_equal(made.ranges, short.ranges)


@pytest.mark.parametrize("codes", [(51.14, 51.15), (81.83, 81.87, 81.91), (32.759, 32.763, 32.767)])
@pytest.mark.parametrize("limit", [31.0, 80.0])
def test_codes_above_all_ranges(codes: tuple[float, ...], limit: float) -> None:
    """One beam in fifty has one of a few neighbouring codes, whichever comes."""
    seen = drive(HALL, ahead(150))
    rng = np.random.default_rng(2)
    lost = rng.random(seen.ranges.shape) < 0.02
    ranges = np.where(lost, rng.choice(codes, seen.ranges.shape), seen.ranges).astype(np.float32)
    made = without_sentinels(written(seen, ranges, limit))
    np.testing.assert_array_equal(returns(made), ~lost)
    assert made.lidar.range_max == (limit if codes[0] > limit else pytest.approx(codes[0] - 0.0005))
    assert f"{codes[0]:.2f} to {codes[-1]:.2f} m (2 % of" in made.notes[0]


def test_two_ways_of_writing_it() -> None:
    """An error code of 81.83 m, and beyond 12 m the lidar's greatest range."""
    seen = drive(HALL, ahead(150))
    lost = np.random.default_rng(2).random(seen.ranges.shape) < 0.02
    ranges = np.where(lost, np.float32(81.83), np.minimum(seen.ranges, np.float32(12.0))).astype(np.float32)
    made = without_sentinels(written(seen, ranges))
    np.testing.assert_array_equal(returns(made), ~lost & (seen.ranges < np.float32(12.0)))
    assert ["81.83" in made.notes[0], "12.00" in made.notes[1]] == [True, True]


def test_a_few_readings_beyond_do_not_hide_it() -> None:
    seen = drive(HALL, ahead(150))
    ranges = np.minimum(seen.ranges, np.float32(8.0))
    ranges[3, 5], ranges[90, 30] = 61.0, 9.5
    made = without_sentinels(written(seen, ranges))
    assert made.lidar.range_max == pytest.approx(7.9995)


def test_nothing_but_no_return() -> None:
    seen = drive(HALL, ahead(60))
    made = without_sentinels(written(seen, np.full_like(seen.ranges, 30.0), 30.0))
    assert not returns(made).any() and "(100 % of the readings)" in made.notes[0]


def test_one_value_for_everything_below_the_limit_is_left() -> None:
    seen = drive(HALL, ahead(60))
    assert find(written(seen, np.full_like(seen.ranges, 2.0), 30.0)) == []


STAND = np.zeros((400, 3))


@pytest.mark.parametrize(
    ("walls", "steps", "noise"),
    [
        pytest.param(HALL, ahead(150), 0.01, id="a drive"),
        pytest.param(HALL, ahead(150), 0.0, id="a drive without noise"),
        # The robot stands for minutes: each beam has one value, the farthest too.
        pytest.param(HALL, np.vstack([ahead(30), STAND, ahead(30)]), 0.0, id="standing"),
        pytest.param(np.array([(2.0, -9.0, 2.0, 9.0)]), np.tile([0.0, 0.0, 0.0], (200, 1)), 0.0, id="a wall at 2 m"),
        pytest.param(np.array(box(-2, -2, 2, 2)), np.vstack([STAND, ahead(15), STAND]), 0.0, id="a square room"),
        pytest.param(ROUND, np.vstack([STAND, 0.4 * ahead(60)]), 0.0, id="a round room, first from its middle"),
        pytest.param(
            HALL, np.vstack([ahead(20), STAND + np.array([0.002, 0, 0]), ahead(20)]), 0.01, id="wheels that creep"
        ),
        pytest.param(np.array(box(-3, -1, 40, 1)), np.tile([0.1, 0.0, 0.0], (150, 1)), 0.0, id="along a corridor"),
        pytest.param(np.array(box(-30, -1, 40, 1)), np.tile([0.1, 0.0, 0.0], (150, 1)), 0.01, id="a long corridor"),
    ],
)
def test_walls_are_not_taken_for_it(walls: Array, steps: Array, noise: float) -> None:
    seen = drive(walls, steps, noise=noise, limit=120.0)
    if steps[0, 0] == 0.1 and (steps[20:300, 0] == 0.002).any():  # the wheels count, but the robot stands
        still = drive(walls, np.where(steps == 0.002, 0.0, steps), noise=noise, limit=120.0)
        seen = written(seen, still.ranges)
    assert find(seen) == []
    assert without_sentinels(seen) is seen


def test_a_drive_beside_a_wall_with_a_narrow_view() -> None:
    """Every beam keeps its range for the whole way, and the outermost the greatest."""
    steps = np.tile([0.1, 0.0, 0.0], (150, 1))
    seen = drive(np.array([(-50.0, 3.0, 50.0, 3.0)]), steps, noise=0.0, angles=np.radians(np.arange(60.0, 121.0)))
    assert (np.ptp(seen.ranges, axis=0) == 0).all()
    assert find(seen) == []


def test_ranges_written_to_a_decimetre() -> None:
    """The greatest of a small room comes often, but not more often than those below."""
    seen = drive(np.array(box(-2, -2, 4, 3)), 0.15 * ahead(200), digits=1)
    assert (seen.ranges == seen.ranges.max()).sum() > 7
    assert find(seen) == []


def test_a_part_of_the_robot_in_view() -> None:
    """Some beams always end 0.4 m away; nothing else comes so often, but much lies beyond."""
    seen = drive(HALL, ahead(150), digits=6, noise=0.2)
    seen.ranges[:, :8] = 0.4
    assert find(seen) == []


def test_without_odometry_it_is_told_from_what_changes_in_the_scans() -> None:
    seen = drive(HALL, ahead(150))
    short = np.minimum(seen.ranges, np.float32(8.0))
    lidar = Lidar(ANGLES, 0.05, 80.0, np.zeros(3))
    still = Recording("drive", "test", None, seen.stamps, short, lidar, np.zeros((150, 3)))
    assert without_sentinels(still).lidar.range_max == pytest.approx(7.9995)


def test_arrays_in_memory_are_looked_at_as_well() -> None:
    seen = drive(HALL, ahead(150))
    short = np.minimum(seen.ranges, np.float32(8.0))
    made = check(Recording.from_arrays(seen.stamps, short, ANGLES, seen.odometry))
    assert made.lidar.range_max == pytest.approx(7.9995)
    assert any("8.00 m" in note for note in made.notes)
