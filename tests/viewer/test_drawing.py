"""What is drawn of made-up Steps beyond what they hold themselves: errors by colour, and where dead reckoning went."""

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from pfslam_viz.viewer.collector import Collector, StreamOptions
from pfslam_viz.viewer.colors import ERROR_LIMITS, ERROR_RAMP
from pfslam_viz.viewer.drawing import Drawing
from pfslam_viz.viewer.framing import Framing
from pfslam_viz.viewer.sinks import open_sinks
from pfslam_viz.viewer.stream import ReplayStream

if TYPE_CHECKING:
    from pathlib import Path

    from tests.viewer.conftest import Corridor, Readable, Recorded


def color_of(error: float) -> int:
    """As Rerun packs it."""
    r, g, b = ERROR_RAMP[sum(error > limit for limit in ERROR_LIMITS)]
    return (r << 24) | (g << 16) | (b << 8) | 255


def segments(row: dict[str, Any]) -> list[tuple[list[float], list[float], int]]:
    """Every two neighbouring points of a row's strips, with the colour between them."""
    out = []
    for strip, color in zip(row["strips"] or [], row["colors"] or [], strict=True):
        out += [(a[:2], b[:2], color) for a, b in pairwise(strip)]
    return out


@pytest.mark.parametrize("whose", ["filter", "dead_reckoning"])
def test_a_trajectory_has_the_colour_of_its_error_at_every_scan(
    recorded: "Recorded", read_back: "type[Readable]", whose: str
) -> None:
    file = read_back(recorded.path)
    poses = [s.estimate.best if whose == "filter" else s.dead_reckoning for s in recorded.steps]
    errors = [
        float(np.hypot(*(p[:2] - s.truth[:2])))
        for p, s in zip(poses, recorded.steps, strict=True)
        if s.truth is not None
    ]
    assert len({color_of(e) for e in errors}) >= 3 and len(errors) == 60
    done, between, latest = (file.temporal(f"world/{whose}/error/{part}") for part in ("done", "between", "open"))
    assert [row["step"] for row in latest] == list(range(60))
    for k in (0, 6, 7, 33, 59):
        older = [segments([row for row in part if row["step"] <= k][-1]) for part in (done, between)]
        found = [*older[0], *older[1], *segments(latest[k])]
        assert len(found) == k
        for i, (start, end, color) in enumerate(found):
            assert start == pytest.approx(poses[i][:2], abs=1e-5) and end == pytest.approx(poses[i + 1][:2], abs=1e-5)
            assert color == color_of(errors[i + 1]), i


def test_the_settled_trajectory_too(recorded: "Recorded", read_back: "type[Readable]") -> None:
    """It is the one of the run, moved by 2 cm along x: at the last step alone."""
    (row,) = read_back(recorded.path).temporal("world/filter/settled_error")
    assert row["step"] == 59
    found = segments(row)
    assert len(found) == 59
    for step, (_, end, color) in zip(recorded.steps[1:], found, strict=True):
        settled = step.estimate.best[:2] + np.array([0.02, 0.0])
        assert end == pytest.approx(settled, abs=1e-5)
        assert step.truth is not None and color == color_of(float(np.hypot(*(settled - step.truth[:2]))))


def test_without_truth_there_is_nothing_to_colour(
    corridor: "Corridor", read_back: "type[Readable]", tmp_path: "Path"
) -> None:
    blind = replace(corridor.recording, truth=None)
    with open_sinks(save=tmp_path / "x.rrd") as sink:
        drawing = Drawing(blind, corridor.config, sink, 500)
        stream = ReplayStream(Collector(blind, corridor.config, StreamOptions()), drawing)
        steps = [replace(step, truth=None) for step in corridor.steps()]
        for step in steps:
            stream.log(step)
        stream.finish(replace(corridor.result(steps), recording=blind, truth=None))
    file = read_back(tmp_path / "x.rrd")
    assert not [e for e in file.entities if "error" in e and file.temporal(e)]
    assert "world/error_scale" not in file.entities
    assert not [view.name for view in file.views() if "rror" in view.name]


def test_the_colours_of_errors_are_told(recorded: "Recorded", read_back: "type[Readable]") -> None:
    file = read_back(recorded.path)
    assert len(file.static("world/error_scale", "strips")) == len(ERROR_RAMP) == len(ERROR_LIMITS) + 1
    assert file.static("world/error_scale", "colors") == [color_of(e) for e in (0.0, 0.03, 0.07, 0.15, 0.3, 0.7, 2.0)]
    assert file.static("world/error_scale/limits", "labels") == ["2 cm", "5 cm", "10 cm", "20 cm", "50 cm", "1 m"]


def test_an_arrow_points_to_dead_reckoning_while_it_is_out_of_the_picture(
    corridor: "Corridor", read_back: "type[Readable]", tmp_path: "Path"
) -> None:
    """It leaves by the right side at scan 20, 30 m beyond, and is back at 40."""
    steps = list(corridor.steps())
    result = corridor.result(steps)
    strayed = result.dead_reckoning.copy()
    strayed[20:40, :2] = [45.0, 0.5]
    framing = Framing((5.0, 0.0), 20.0, 10.0, np.zeros((4, 2)))  # to x = 15
    with open_sinks(save=tmp_path / "x.rrd") as sink:
        Drawing(corridor.recording, corridor.config, sink, 500).point_out(
            framing, replace(result, dead_reckoning=strayed)
        )
    rows = {row["step"]: row for row in read_back(tmp_path / "x.rrd").temporal("world/dead_reckoning/out_of_view")}
    assert set(rows) == {0, *range(20, 41)}
    assert not rows[0]["vectors"] and not rows[40]["vectors"]
    (origin,), (vector,) = rows[30]["origins"], rows[30]["vectors"]
    tip = np.add(origin, vector)[:2]
    assert tip == pytest.approx([14.5, 0.5]) and vector[0] > 0.5 and vector[1] == 0.0
    assert rows[30]["labels"] == ["30 m"]
