"""Colours are told apart by colour-blind people, and show on light and dark; recordings hold what the table says."""

from collections import Counter
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz.config import Config
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.entities import ENTITIES, Color, Entity, Kind, View

if TYPE_CHECKING:
    from tests.viewer.conftest import Readable, Recorded


# Machado, Oliveira and Fernandes (2009), severity 1.0, on linear RGB.
DEFICIENCIES = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(color: Color) -> NDArray[np.float64]:
    c = np.asarray(color) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: Any) -> NDArray[np.float64]:
    """CIE L*a*b* (D65) of linear RGB."""
    to_xyz = np.array(
        [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    )
    xyz = to_xyz @ np.clip(rgb, 0, 1) / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def apart(a: Color, b: Color, deficiency: str) -> float:
    matrix = np.asarray(DEFICIENCIES[deficiency])
    return float(np.linalg.norm(lab(matrix @ linear(a)) - lab(matrix @ linear(b))))


def contrast(a: Color, b: Color) -> float:
    """WCAG contrast ratio."""
    light = [0.05 + float(np.array([0.2126, 0.7152, 0.0722]) @ linear(c)) for c in (a, b)]
    return max(light) / min(light)


TOGETHER = {
    "trajectories": [entities.DEAD_RECKONING, entities.FILTER, entities.TRUTH],
    "end points": [entities.HIT, entities.MISS],
    "runs": [*entities.RUNS],
    "curves": [entities.DEAD_RECKONING, *entities.RUNS],
    "map": [(255, 255, 255), (0, 0, 0), (112, 137, 134)],
}


@pytest.mark.parametrize("deficiency", DEFICIENCIES)
@pytest.mark.parametrize("group", TOGETHER)
def test_colors_that_appear_together_differ_for_everyone(group: str, deficiency: str) -> None:
    for a, b in combinations(TOGETHER[group], 2):
        assert apart(a, b, deficiency) > 20, (group, a, b)  # 2.3 is a just noticeable difference


@pytest.mark.parametrize("color", TOGETHER["trajectories"])
@pytest.mark.parametrize("ground", [(255, 255, 255), (13, 16, 17)])
def test_trajectories_show_on_a_white_floor_and_on_the_dark_theme(color: Color, ground: Color) -> None:
    assert contrast(color, ground) > 3.0  # what WCAG asks of graphics


def test_heavier_particles_are_darker() -> None:
    lightness = [lab(linear(color))[0] for color in entities.WEIGHT_RAMP]
    assert np.all(np.diff(lightness) < -3)


def test_runs_have_paths_of_their_own() -> None:
    assert entities.MAP.path("paper") == "world/paper/map"
    assert entities.N_EFF.path("paper") == "plots/n_eff/paper"
    assert entities.RECKONED_MAP.path("paper") == "world/dead_reckoning/map"
    assert entities.TRAJECTORY.visible("a") == ("world/a/trajectory/done", "world/a/trajectory/open")


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
        name = entities.COLOR_NAMES[row.color]
        assert f"`/{path}`: {name}" in page or row.kind in (Kind.BOXES, Kind.CURVE)


COLORED = {Kind.CAMERA: "color", Kind.CURVE: "colors", Kind.MARKS: "colors", Kind.BOXES: "colors"}
PLAIN = (Kind.GRID, Kind.IMAGE, Kind.FRAME, Kind.EVENTS)  # their data say all


@each_row
def test_the_static_style_is_the_rows(file: "Readable", row: Entity) -> None:
    if row.kind in PLAIN:
        assert row.color is None and row.width == 0.0
        return
    r, g, b = entities.FILTER if row.color == "run" else row.color or (0, 0, 0)
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
    View.CLOSE_UP: "The robot (9 m)",
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


def test_a_configuration_keeps_its_colour() -> None:
    default, paper, other = (Config(name=name) for name in ("default", "paper", "mine.toml"))
    blue, amber, third, _ = entities.RUNS
    assert entities.run_colors([paper]) == entities.run_colors([default, paper])[1:] == [amber]
    assert entities.run_colors([paper, default]) == [amber, blue]
    assert entities.run_colors([other]) == [blue]
    assert entities.run_colors([other, default, other, paper]) == [third, blue, entities.RUNS[3], amber]
    assert len(set(entities.run_colors([default, default, paper, paper]))) == 4
