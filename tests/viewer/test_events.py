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
    assert found[0][2] == f"particles resampled: N_eff {steps[3].estimate.n_eff:.1f} of 40"
    resampling = plain_corridor.config.resampling.model_copy(update={"policy": "always"})
    always = plain_corridor.config.model_copy(update={"resampling": resampling})
    assert told(Chronicle(plain_corridor.recording, always), steps) == []  # it says nothing there


def test_what_lasts_is_told_where_it_begins_and_ends(plain_corridor: "Corridor", steps: list[Step]) -> None:
    known = np.ones(60, bool)
    known[40:45] = False
    blind = [
        replace(s, estimate=replace(s.estimate, informative=not 10 <= s.index < 13, resampled=False)) for s in steps
    ]
    found = told(Chronicle(replace(plain_corridor.recording, odometry_known=known), plain_corridor.config), blind)
    assert [(step, level, text.split(":")[0]) for step, level, text in found] == [
        (10, "WARN", "no match"),
        (13, "INFO", "matches the map again after 3 scans"),
        (40, "WARN", "odometry unknown"),
        (45, "INFO", "odometry back after 5 scans"),
    ]


def test_an_open_corridor_is_told(corridor: "Corridor") -> None:
    """Its scans leave the direction open at every other one."""
    found = told(Chronicle(corridor.recording, corridor.config), list(corridor.steps())[:4])
    assert [(step, text.split(":")[0]) for step, _, text in found] == [
        (1, "corridor open"),
        (3, "corridor open"),
        (3, "particles resampled"),
    ]


def test_the_end_tells_loops_hindsight_and_what_was_kept(corridor: "Corridor") -> None:
    steps = list(corridor.steps())
    zero = np.zeros(2)
    closures = tuple(LoopClosure(earlier, later, zero, zero) for earlier, later in ((1, 30), (2, 33), (5, 50)))
    result = replace(corridor.result(steps), closures=closures, kept=Kept("online", 0.0, 0.2))
    chronicle = Chronicle(corridor.recording, corridor.config)
    told(chronicle, steps)
    found = list(chronicle.finish(result, painted_anew=True))
    assert [(e.step, e.level, e.text.split(":")[0].split(",")[0]) for e in found] == [
        (30, "INFO", "loop closed (in hindsight)"),
        (50, "INFO", "loop closed (in hindsight)"),
        (59, "INFO", "map settled in hindsight"),
        (59, "WARN", "trajectory of the run kept"),
        (59, "INFO", "floor texture painted anew along the settled trajectory"),
    ]
    assert "scan 1" in found[0].text and found[0].seconds == pytest.approx(7.5)
    assert "0.02 m" in found[2].text


def test_a_silent_sensor_is_told_at_the_scan_it_fell_silent(plain_corridor: "Corridor") -> None:
    """Encoders at 40 Hz that pause for three seconds from 5.0 s on; the lidar's 0.25 s are no gap."""
    stamps = 100.0 + np.concatenate([np.arange(0.0, 5.01, 0.025), np.arange(8.0, 14.0, 0.025)])
    streams = (Stream("encoders", stamps), Stream("lidar", plain_corridor.recording.stamps))
    (gap,) = gaps(replace(plain_corridor.recording, streams=streams))
    assert (gap.step, gap.seconds, gap.level) == (20, pytest.approx(5.0), "WARN")
    assert gap.text == "encoders: silent for 3.0 s"


def test_lines_are_broken_and_name_their_scan() -> None:
    lines = Event(1234, 5.0, "INFO", "loop closed (in hindsight): the same place as at scan 12").line.split("\n")
    assert lines[0].startswith("scan 1,234: loop closed") and len(lines) > 1 and max(map(len, lines)) <= 30


def test_events_are_read_back_from_a_recording(recorded: "Recorded", read_back: "type[Readable]") -> None:
    rows = read_back(recorded.path).rows("events/filter")
    found = {(row["step"], row["level"][0], row["text"][0].replace("\n", " ").split(": ")[1]) for row in rows}
    assert {(1, "WARN", "corridor open"), (59, "INFO", "loop closed (in hindsight)")} <= found
    assert (3, "DEBUG", "particles resampled") in found
    assert any("map settled in hindsight" in text for _, _, text in found)
