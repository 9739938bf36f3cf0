import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pfslam_viz.recordings.ros_scans import Grid, Scans

RIGHT = math.pi / 2


def message(ranges: Sequence[float], first: float = 0.0, step: float = 0.1, **fields: Any) -> SimpleNamespace:
    defaults = {"range_min": 0.1, "range_max": 30.0, "time_increment": 0.0, "scan_time": 0.0}
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=500_000_000), frame_id="/laser")
    return SimpleNamespace(
        header=header,
        angle_min=first,
        angle_increment=step,
        ranges=np.array(ranges, dtype=np.float32),
        **{**defaults, **fields},
    )


def gather(*messages: SimpleNamespace) -> tuple[Grid, list[str]]:
    scans, notes = Scans(), list[str]()
    for one in messages:
        scans.add(one, 0.0)
    return scans.gather(np.arange(len(messages)), notes), notes


def test_angles_and_stamps() -> None:
    scans = Scans()
    scans.add(message([1, 2, 3], first=-0.1), received=9.0)
    assert (scans.stamps[0], scans.received[0], scans.frames) == (1.5, 9.0, ["laser"])
    grid = scans.gather(np.array([0]), [])
    np.testing.assert_allclose(grid.angles, [-0.1, 0.0, 0.1])
    assert grid.ranges.tolist() == [[1, 2, 3]]
    assert not grid.clockwise


def test_angles_that_were_rounded_to_float32_are_as_they_were_meant() -> None:
    """Or a drive's filter takes another way than with the same drive from a log in degrees."""
    for first, step in ((-90.0, 1.0), (-135.0, 0.25), (-119.53125, 0.3515625), (-60.0, 1 / 3)):
        lidar = message([1.0] * 100, float(np.float32(math.radians(first))), float(np.float32(math.radians(step))))
        grid, _ = gather(lidar)
        assert grid.angles.tolist() == (math.radians(first) + math.radians(step) * np.arange(100)).tolist()
    odd = float(np.float32(0.04947393760085106))
    assert gather(message([1.0] * 3, 0.0, odd))[0].angles[2] == 2 * odd


def test_a_clockwise_lidar() -> None:
    """From 90 degrees to the left down to 90 degrees to the right: the last range is the right one's."""
    grid, notes = gather(message([1, 2, 3], first=RIGHT, step=-RIGHT))
    np.testing.assert_allclose(grid.angles, [-RIGHT, 0, RIGHT])
    assert grid.ranges.tolist() == [[3, 2, 1]]
    assert grid.clockwise
    assert notes == []


def test_no_return_by_its_names() -> None:
    grid, _ = gather(message([math.inf, -math.inf, math.nan, 0.0, 5.0]))
    assert grid.ranges.tolist() == [[0, 0, 0, 0, 5]]


def test_the_upper_limit_itself_is_no_return() -> None:
    scans, notes = Scans(), list[str]()
    for _ in range(2):
        scans.add(message([5.6, 5.599, 7.0, 0.01], range_max=np.float32(5.6)), 0.0)
    ranges = scans.gather(np.arange(2), notes).ranges
    assert scans.range_limits(ranges, notes) == (0.1, 5.6)
    # What is above the limit or below the lower one is none by Lidar's definition.
    np.testing.assert_allclose(ranges[0], [0, 5.599, 7.0, 0.01])
    assert notes == []


@pytest.mark.parametrize("high", [0.0, math.inf, math.nan])
def test_no_upper_limit(high: float) -> None:
    scans, notes = Scans(), list[str]()
    scans.add(message([5.0, 12.5, math.inf, 0.0], range_min=0.0, range_max=high), 0.0)
    ranges = scans.gather(np.arange(1), notes).ranges
    low, limit = scans.range_limits(ranges, notes)
    assert low > 0  # so that 0 is no return
    assert limit >= 12.5
    assert ranges[0].tolist() == [5.0, 12.5, 0.0, 0.0]
    assert any("12.50 m" in note for note in notes)


def test_most_ranges_above_the_limit_are_said() -> None:
    scans, notes = Scans(), list[str]()
    scans.add(message([5.0, 12.5, 13.0], range_max=10.0), 0.0)
    scans.range_limits(scans.gather(np.arange(1), notes).ranges, notes)
    assert any("more than half" in note for note in notes)


def test_a_varying_number_of_beams() -> None:
    """Two scans with beams 0.1 rad apart; one that is twice as fine, and one of which the last beam is missing."""
    grid, notes = gather(
        message([1, 2, 3, 4]),
        message([1, 2, 3, 4]),
        message([1, 1.5, 2, 2.5, 3, 3.5, 4], step=0.05),
        message([1, 2, 3]),
    )
    np.testing.assert_allclose(grid.angles, [0, 0.1, 0.2, 0.3])
    assert grid.ranges.tolist() == [[1, 2, 3, 4], [1, 2, 3, 4], [1, 2, 3, 4], [1, 2, 3, 0]]
    assert notes == ["lidar: scans have 3 to 7 beams; brought to one grid of 4 angles, the nearest beam for each"]


def test_the_grid_reaches_as_far_as_any_scan() -> None:
    grid, _ = gather(message([1, 2]), message([1, 2]), message([5, 6, 7, 8], first=-0.1))
    np.testing.assert_allclose(grid.angles, [-0.1, 0, 0.1, 0.2], atol=1e-12)
    assert grid.ranges.tolist() == [[0, 1, 2, 0], [0, 1, 2, 0], [5, 6, 7, 8]]


def test_whole_turns_of_another_count_and_another_start() -> None:
    """Eight beams round, twice; then four, that begin a quarter turn earlier in name, and run clockwise."""
    eighth = math.pi / 4
    grid, _ = gather(
        message(range(1, 9), step=eighth),
        message(range(1, 9), step=eighth),
        message([1, 7, 5, 3], first=2 * math.pi, step=-2 * eighth),
    )
    np.testing.assert_allclose(grid.angles, eighth * np.arange(8), atol=1e-6)
    assert grid.ranges[0].tolist() == list(range(1, 9))
    # Each direction takes the beam nearest to it: every second one is a beam's own, those between either neighbour's.
    assert grid.ranges[2, ::2].tolist() == [1, 3, 5, 7]
    assert (grid.ranges[2] > 0).all()


def test_impossible_beams() -> None:
    scans = Scans()
    for one in (
        message([1, 2]),
        message([]),
        message([1, 2], step=0.0),
        message([1, 2], step=math.nan),
        message([1, 2], first=-90.0),
        message([1] * 400, step=1.0),
    ):
        scans.add(one, 0.0)
    assert scans.usable("laser").tolist() == [True, False, False, False, False, False]
    assert not scans.usable("other").any()


def test_beam_times() -> None:
    def told(spacing: float, **fields: float) -> tuple[float | None, str]:
        scans = Scans()
        scans.add(message([1.0] * 271, step=math.radians(1), **fields), 0.0)
        return scans.beam_time_increment(spacing, 271)

    assert told(0.1) == (None, "")
    assert told(0.1, time_increment=1e-4) == (1e-4, "time_increment")
    # A turn takes 0.1 s, 1 degree of it a 360th.
    value, source = told(0.1, scan_time=0.1)
    assert value == pytest.approx(0.1 / 360) and source == "scan_time"
    # 270 beams' widths of 10 ms are 2.7 s, and scans come each 0.1 s: it is in other units.
    assert told(0.1, time_increment=1e-2) == (None, "")
    assert told(0.1, time_increment=math.nan) == (None, "")
