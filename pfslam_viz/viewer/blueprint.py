"""The layout: tabs Compare, Filter, Texture and 3-D, and the pages."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from pfslam_viz.recordings.recording import Recording
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.entities import Entities
from pfslam_viz.viewer.framing import Framing, overhead_size

LONGEST = 60.0  # s that a replay takes at most, however long the recording
SPEED_UP = 2.0  # times real time, unless that takes longer

BACKGROUND = (112, 137, 137)
"""What the viewer draws unknown cells in: a view looks the same inside and outside the map."""


def blueprint(recording: Recording, framing: Framing, runs: Sequence[str], live: bool = False) -> rrb.Blueprint:
    """The layout for one run, or for several that are compared side by side.

    ``live`` follows the newest scan; otherwise the recording plays from its start.
    """
    n = len(recording)
    seconds = min(max(recording.duration, 1.0) / SPEED_UP, LONGEST)
    tabs = [_compare(runs, recording), *(_filter(run, len(runs) > 1) for run in runs)]
    if recording.frames is not None:
        tabs += [_texture(run, len(runs) > 1) for run in runs]
    tabs += [_three_d(runs, framing), _pages()]
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline="step",
            fps=max(n / seconds, 1.0),
            play_state="following" if live else "playing",
        ),
        auto_views=False,
        auto_layout=False,
    )


def _bounds(aspect: float | None = None) -> rrb.VisualBounds2D:
    width, height = overhead_size() if aspect is None else overhead_size(aspect)
    return rrb.VisualBounds2D(x_range=[0, width], y_range=[0, height])


def _map_view(name: str, contents: list[str]) -> rrb.Spatial2DView:
    return rrb.Spatial2DView(
        origin=f"/{Entities().overview_camera}",
        contents=contents,
        name=name,
        background=BACKGROUND,
        visual_bounds=_bounds(),
    )


def _run_contents(run: str) -> list[str]:
    path = Entities(run).filter
    names = ("map", "scan/**", "particles", "trajectory/**", "hindsight", "closures", "robot/shape", "robot/outline")
    return [f"+ /{path(name)}" for name in names]


TRUTH = ["+ /world/truth/trajectory/**"]


def _compare(runs: Sequence[str], recording: Recording) -> rrb.Container:
    dead_reckoning = [
        f"+ /world/dead_reckoning/{name}"
        for name in ("map", "scan", "trajectory/**", "robot/shape", "robot/outline")
    ]
    maps = [_map_view("Dead reckoning", dead_reckoning + TRUTH)]
    for run in runs:
        title = "Particle filter" if len(runs) == 1 else run
        maps.append(_map_view(title, _run_contents(run) + TRUTH))
    plots = [_plot("drift", "Drift of dead reckoning from the filter (m)")]
    if recording.truth is not None:
        plots.append(_plot("error", "Error against truth (m)"))
    plots += [_plot("n_eff", "N_eff"), _plot("spread", "Spread of the particles (m)")]
    return rrb.Vertical(rrb.Horizontal(*maps), rrb.Horizontal(*plots), row_shares=[7, 3], name="Compare")


def _plot(name: str, title: str, contents: list[str] | None = None) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"/plots/{name}",
        contents=contents or ["$origin/**"],
        name=title,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=rrb.ScalarAxis(zoom_lock=False),
        plot_legend=rrb.PlotLegend(corner="LeftTop"),
    )


def _filter(run: str, several: bool) -> rrb.Container:
    path = Entities(run).filter
    close = ("map", "scan/**", "trajectory/**", "particles", "lineages", "covariance", "mean", "degenerate",
             "closures", "robot/outline")
    loupe = ("map", "scan/**", "trajectory/**", "particles", "headings", "lineages", "covariance", "mean", "correction",
             "degenerate")
    views = [
        rrb.Spatial2DView(
            origin=f"/{path(f'follow/{camera}')}",
            contents=[f"+ /{path(name)}" for name in names] + TRUTH,
            name=title,
            background=BACKGROUND,
            visual_bounds=_bounds(1.0),
        )
        for camera, names, title in (
            ("close_up", close, "Round the robot (9 m)"),
            ("loupe", loupe, "The particles (1 m)"),
        )
    ]
    plots = [
        _plot("correlation", "Scan on the map (share of end points)", [f"+ /plots/correlation/{run}", f"+ /plots/score/{run}"]),
        _plot("lineages", "Surviving lineages", [f"+ /plots/lineages/{run}"]),
        _plot("n_eff", "N_eff", [f"+ /plots/n_eff/{run}"]),
        _plot("heading_drift", "Heading: dead reckoning from the filter (°)", [f"+ /plots/heading_drift/{run}"]),
    ]
    name = f"Filter: {run}" if several else "Filter"
    return rrb.Vertical(rrb.Horizontal(*views), rrb.Horizontal(*plots), row_shares=[7, 3], name=name)


def _texture(run: str, several: bool) -> rrb.Container:
    paths = Entities(run)
    floor = [f"+ /{paths.filter(name)}" for name in ("map", "texture", "trajectory/**", "robot/shape", "robot/outline")]
    images = rrb.Vertical(
        rrb.Spatial2DView(origin=f"/{paths.filter('robot/camera')}", contents=["$origin"], name="Colour"),
        rrb.Spatial2DView(origin=f"/{paths.disparity_image}", contents=["$origin"], name="Disparity"),
    )
    name = f"Texture: {run}" if several else "Texture"
    return rrb.Horizontal(_map_view("Floor", floor), images, column_shares=[2, 1], name=name)


def _three_d(runs: Sequence[str], framing: Framing) -> rrb.Spatial3DView:
    run = runs[-1]
    path = Entities(run).filter
    x, y = framing.center
    reach = framing.height
    names = ("map", "texture", "scan/**", "particles", "headings", "covariance", "trajectory/**", "hindsight", "robot/**",
             "closures", "degenerate")
    return rrb.Spatial3DView(
        origin="/world",
        contents=[f"+ /{path(name)}" for name in names]
        + TRUTH
        + ["+ /world/dead_reckoning/trajectory/**", "+ /world/dead_reckoning/robot/**"],
        name="3-D" if len(runs) == 1 else f"3-D: {run}",
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=[x - 0.15 * reach, y - 0.75 * reach, 0.75 * reach],
            look_target=[x, y - 0.05 * reach, 0.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
    )


def _pages() -> rrb.Container:
    return rrb.Horizontal(
        rrb.TextDocumentView(origin=f"/{entities.HELP}", name="What you see"),
        rrb.TextDocumentView(origin=f"/{entities.ABOUT}", name="This recording"),
        column_shares=[3, 2],
        name="About",
    )

