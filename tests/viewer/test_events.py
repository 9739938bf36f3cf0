"""What the list of events says, of Steps and Results made up for it."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from pfslam_viz.recordings.recording import Stream
from pfslam_viz.slam.protocol import Kept, LoopClosure
from pfslam_viz.step import Step
from pfslam_viz.viewer.events import Chronicle, Event, gaps

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor, Readable, Recorded


def told(chronicle: Chronicle, steps: list[Step]) -> list[tuple[int, str, str]]:
    return [(e.step, e.level, e.text) for step in steps for e in chronicle.add(step)]


@pytest.fixture(scope="module")
def steps(plain_corridor: "Corridor") -> list[Step]:
    """Without matches, resampled after every fourth."""
    return list(plain_corridor.steps())


def test_resampling_is_told_at_the_lowest_level(plain_corridor: "Corridor", steps: list[Step]) -> None:
    found = told(Chronicle(plain_corridor.recording, plain_corridor.config), steps)
    assert [(step, level) for step, level, _ in found] == [(k, "DEBUG") for k in range(3, 60, 4)]
    assert found[0][2] == f"resampled, N_eff {steps[3].estimate.n_eff:.1f} of 40"
    resampling = plain_corridor.config.resampling.model_copy(update={"policy": "always"})
    always = plain_corridor.config.model_copy(update={"resampling": resampling})
    assert told(Chronicle(plain_corridor.recording, always), steps) == []  # it says nothing there


def test_what_lasts_is_told_where_it_begins_and_ends(plain_corridor: "Corridor", steps: list[Step]) -> None:
    known = np.ones(60, bool)
    known[40:45] = False
    blind = {10, 11, 14}  # two in a row, then a flicker
    seen = [replace(s, estimate=replace(s.estimate, informative=s.index not in blind, resampled=False)) for s in steps]
    found = told(Chronicle(replace(plain_corridor.recording, odometry_known=known), plain_corridor.config), seen)
    assert found == [
        (10, "WARN", "no match with map"),
        (24, "INFO", "matches again, 5 scans"),
        (40, "WARN", "odometry unknown"),
        (54, "INFO", "odometry back, 5 scans"),
    ]


def test_an_open_corridor_is_told_once_it_lasts(corridor: "Corridor") -> None:
    """Open at every other scan it is not told; from 3 to 7 it is, at the third."""
    steps = [replace(s, estimate=replace(s.estimate, resampled=False, informative=True)) for s in corridor.steps()]
    assert told(Chronicle(corridor.recording, corridor.config), steps) == []
    open_one = steps[1].estimate
    in_a_row = [replace(s, estimate=open_one) if 4 <= s.index < 8 else s for s in steps[:20]]
    assert told(Chronicle(corridor.recording, corridor.config), in_a_row) == [(5, "WARN", "corridor open")]


def test_the_end_tells_loops_hindsight_and_what_was_kept(corridor: "Corridor") -> None:
    steps = list(corridor.steps())
    zero = np.zeros(2)
    closures = tuple(LoopClosure(earlier, later, zero, zero) for earlier, later in ((1, 30), (2, 33), (5, 50)))
    result = replace(corridor.result(steps), closures=closures, kept=Kept("online", 0.0, 0.2, (20, 29, 31)))
    chronicle = Chronicle(corridor.recording, corridor.config)
    told(chronicle, steps)
    found = list(chronicle.finish(result, painted_anew=True))
    assert [(e.step, e.level, e.text.split(":")[0].split(",")[0]) for e in found] == [
        (30, "INFO", "loop closed with scan 1"),
        (50, "INFO", "loop closed with scan 5"),
        (59, "INFO", "hindsight"),
        (59, "INFO", "run's trajectory kept"),
        (20, "WARN", "against good odometry"),
        (31, "WARN", "against good odometry"),
        (59, "INFO", "texture painted anew"),
    ]
    assert found[0].seconds == pytest.approx(7.5)
    assert "0.02 m" in found[2].text


def test_a_silent_sensor_is_told_at_the_scan_it_fell_silent(plain_corridor: "Corridor") -> None:
    """Encoders at 40 Hz that pause for three seconds from 5.0 s on; the lidar's 0.25 s are no gap."""
    stamps = 100.0 + np.concatenate([np.arange(0.0, 5.01, 0.025), np.arange(8.0, 14.0, 0.025)])
    streams = (Stream("encoders", stamps), Stream("lidar", plain_corridor.recording.stamps))
    (gap,) = gaps(replace(plain_corridor.recording, streams=streams))
    assert (gap.step, gap.level) == (20, "WARN") and gap.seconds == pytest.approx(5.0)
    assert gap.text == "encoders silent 3.0 s"


def test_sensors_that_pause_together_are_told_as_one(plain_corridor: "Corridor") -> None:
    pause = np.concatenate([np.arange(0.0, 5.01, 0.25), np.arange(9.0, 14.0, 0.25)]) + 100.0
    streams = (Stream("lidar", pause), Stream("odometry", pause + 0.02))
    (gap,) = gaps(replace(plain_corridor.recording, streams=streams))
    assert gap.text == "lidar, odometry silent 4.0 s"
    assert Event(1234, 5.0, "INFO", "resampled").line == "1,234: resampled"


def test_events_are_read_back_from_a_recording(recorded: "Recorded", read_back: "type[Readable]") -> None:
    rows = read_back(recorded.path).rows("events/filter")
    found = {(row["step"], row["level"][0], row["text"][0].split(": ")[1]) for row in rows}
    assert (59, "INFO", "loop closed with scan 0") in found
    assert any(step == 3 and level == "DEBUG" and "resampled" in text for step, level, text in found)
    assert any(text == "hindsight" for _, _, text in found)
