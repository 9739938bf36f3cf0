"""The table of entities, and that recordings hold what it says."""

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
import pytest
import rerun as rr

from pfslam_viz.viewer import colors, entities
from pfslam_viz.viewer.entities import ENTITIES, Entity, Kind, View

if TYPE_CHECKING:
    from tests.viewer.conftest import Readable, Recorded


def test_runs_have_paths_of_their_own() -> None:
    assert entities.MAP.path("paper") == "world/paper/map"
    assert entities.N_EFF.path("paper") == "plots/n_eff/paper"
    assert entities.RECKONED_MAP.path("paper") == "world/dead_reckoning/map"
    assert entities.TRAJECTORY.visible("a") == tuple(f"world/a/trajectory/{p}" for p in ("done", "between", "open"))


def test_no_path_is_there_twice() -> None:
    paths = [row.template for row in ENTITIES]
    assert len(set(paths)) == len(paths) > 30
    assert {row.owner for row in ENTITIES} == {"{run}", "dead_reckoning", "truth"}


# The table against what a recording holds. ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def file(recorded: "Recorded", read_back: "type[Readable]") -> "Readable":
    return read_back(recorded.path)


each_row = pytest.mark.parametrize("row", ENTITIES, ids=lambda row: row.template)


@each_row
def test_every_row_is_filled_with_data(file: "Readable", row: Entity) -> None:
    paths = row.visible("filter") if row.kind is Kind.TRAIL else [row.path("filter")]
    for path in paths:
        assert file.temporal(path), path


@each_row
def test_every_row_that_is_visible_is_on_the_help_page(file: "Readable", row: Entity) -> None:
    page = file.static("help", "text")[0]
    for path in row.visible("filter") if row.kind is Kind.TRAIL else [row.path("filter")]:
        assert (f"- `/{path}`: " in page) == (row.kind is not Kind.FRAME), path
    if isinstance(row.color, tuple):
        name = colors.COLOR_NAMES[row.color]
        assert f"`/{path}`: {name}" in page or row.kind in (Kind.BOXES, Kind.CURVE)


COLORED = {Kind.CAMERA: "color", Kind.CURVE: "colors", Kind.MARKS: "colors", Kind.BOXES: "colors"}
PLAIN = (Kind.GRID, Kind.IMAGE, Kind.FRAME, Kind.EVENTS)  # their data say all


@each_row
def test_the_static_style_is_the_rows(file: "Readable", row: Entity) -> None:
    if row.kind in PLAIN:
        assert row.color is None and row.width == 0.0
        return
    r, g, b = colors.FILTER if row.color == "run" else row.color or (0, 0, 0)
    packed = (r << 24) | (g << 16) | (b << 8) | 255
    for path in row.visible("filter"):
        if path.endswith("/shape"):
            assert file.static(path, "vertex_colors") == [packed] * 4
            continue
        if row.color is not None:
            assert file.static(path, COLORED.get(row.kind, "colors")) == [packed]
        if row.kind is Kind.CURVE:
            assert file.static(path, "widths") == [row.width]
            assert file.static(path, "aggregation_policy") == [rr.components.AggregationPolicy[row.keep].value]
        elif row.kind is Kind.MARKS:
            assert file.static(path, "marker_sizes") == [row.width]
        elif row.kind not in COLORED:
            assert file.static(path, "radii") == [-(row.few or row.width)]  # negative: in ui points; 40 particles


TITLES = {
    View.CLOSE_UP: "Round the robot (9 m)",
    View.LOUPE: "The particles, coloured by weight",
    View.TEXTURE: "Floor texture over the map",
    View.THREE_D: "3-D",
    View.COLOR_CAMERA: "Colour camera",
    View.DEPTH_CAMERA: "Depth camera (bright is near)",
    View.EVENTS: "Events",
}
RECKONED, FILTERED = "Dead reckoning: wheels and gyro alone", "Particle filter"
BY_ERROR = "Dead reckoning by error", "Particle filter by error"
SIDES = {
    View.COMPARE: {"{run}": {FILTERED}, "dead_reckoning": {RECKONED}, "truth": {RECKONED, FILTERED}},
    View.ERROR: {"{run}": {BY_ERROR[1]}, "dead_reckoning": {BY_ERROR[0]}, "truth": set()},
}


@each_row
def test_the_views_that_the_row_names_show_it_and_no_others(file: "Readable", row: Entity) -> None:
    views = file.views()
    expected = {TITLES[view] for view in row.views if view in TITLES}
    for view, sides in SIDES.items():
        if view in row.views:
            expected |= sides[row.owner]
    for path in row.visible("filter"):
        hidden = {TITLES[View.CLOSE_UP]} if path.endswith("/shape") else set()  # it would cover the particles
        shown = {view.name for view in views if path in view.contents and view.kind != "TimeSeries"}
        assert shown == expected - hidden, path
    plots = [view.name for view in views if row.path("filter") in view.contents and view.kind == "TimeSeries"]
    assert len(plots) == len({View.COMPARE_PLOTS, View.FILTER_PLOTS, View.ERROR_PLOTS} & set(row.views))
    if row.title:
        assert set(plots) - {"Error of the filter alone (m)"} == {row.title}


def test_the_layout_holds_at_least_this(file: "Readable") -> None:
    """Without the table: what the particles' own view and the plots show."""
    views = {view.name: view for view in file.views()}
    names = ["map", "particles", "headings", "scan/hit", "scan/miss", "trajectory/done", "trajectory/open"]
    names += ["mean", "covariance", "lineages", "correction", "degenerate"]
    truth = {"world/truth/trajectory/done", "world/truth/trajectory/open"}
    assert views["The particles, coloured by weight"].contents >= {f"world/filter/{name}" for name in names} | truth
    assert views["Error (m)"].contents >= {"plots/error/filter", "plots/error/dead_reckoning"}
    plots = Counter(view.name for view in file.views() if view.kind == "TimeSeries")
    assert plots >= Counter(
        [
            "Drift (m)",
            "End points on walls",
            "Error (m)",
            "Error of the filter alone (m)",
            "Heading drift (°)",
            "N_eff",
            "N_eff",
            "Spread (m)",
            "Surviving lineages",
        ]
    )


def test_every_map_has_a_scale_bar_of_round_length(file: "Readable") -> None:
    """A fifth of the view at most, and as long as its label says."""
    views = {view.name: view for view in file.views()}
    overview, follow = "world/scale_bar", "world/filter/follow"
    bars = dict.fromkeys((RECKONED, FILTERED, *BY_ERROR, TITLES[View.TEXTURE]), overview)
    bars |= {TITLES[View.CLOSE_UP]: f"{follow}/close_up_scale_bar", TITLES[View.LOUPE]: f"{follow}/loupe_scale_bar"}
    for name, path in bars.items():
        assert path in views[name].contents, name
        points = np.array(file.static(path, "strips")[0])
        (label,) = file.static(path, "labels")
        number, unit = label.split()
        length = float(number) / {"m": 1, "cm": 100}[unit]
        assert np.ptp(points[:, 0]) == pytest.approx(length, rel=1e-4), name
        assert number.strip("0.") in ("1", "2", "5")
    assert file.static(f"{follow}/close_up_scale_bar", "labels") == ["1 m"]
