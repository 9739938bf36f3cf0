"""The layout: the tabs Compare, Filter, Texture, 3-D and About."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb
from rerun import Points3D, Radius

from pfslam_viz.recordings.recording import Recording
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.entities import Entities
from pfslam_viz.viewer.framing import Framing, overhead_size
from pfslam_viz.viewer.style import FOLLOW_HEIGHT

LONGEST = 60.0  # s that a replay takes at most, however long the recording
SPEED_UP = 2.0  # times real time, unless that takes longer
MAPS_IN_A_ROW = 3

BACKGROUND = (112, 137, 134)
"""What the viewer draws unknown cells in: a view looks the same inside and outside the map."""

TRUTH = ["+ /world/truth/trajectory/**"]
ROBOT = ("robot/shape", "robot/outline")


def blueprint(recording: Recording, framing: Framing, runs: Sequence[str], live: bool = False) -> rrb.Blueprint:
    """The layout for one run, or for several that are compared side by side.

    ``live`` follows the newest scan; otherwise the recording plays from its start, a two-minute one in one minute.
    """
    seconds = min(max(recording.duration, 1.0) / SPEED_UP, LONGEST)
    several = len(runs) > 1
    tabs: list[rrb.Container | rrb.View] = [
        _compare(runs, recording, framing),
        _each("Filter", [_filter(run, several, recording) for run in runs]),
    ]
    if recording.frames is not None:
        tabs.append(_each("Texture", [_texture(run, several, framing) for run in runs]))
    tabs.append(_each("3-D", [_three_d(run, several, framing) for run in runs]))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, _pages(), active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline="step",
            fps=max(len(recording) / seconds, 1.0),
            play_state="following" if live else "playing",
        ),
        auto_views=False,
        auto_layout=False,
    )


def _each(name: str, parts: Sequence[rrb.Container | rrb.View]) -> rrb.Container | rrb.View:
    """The one run's part, or the runs' parts as tabs."""
    return parts[0] if len(parts) == 1 else rrb.Tabs(*parts, name=name)


def _overhead(origin: str, aspect: float, name: str, contents: list[str], **more: object) -> rrb.Spatial2DView:
    width, height = overhead_size(aspect)
    return rrb.Spatial2DView(
        origin=f"/{origin}",
        contents=contents,
        name=name,
        background=BACKGROUND,
        visual_bounds=rrb.VisualBounds2D(x_range=[0, width], y_range=[0, height]),
        **more,  # type: ignore[arg-type]
    )


def _of_run(run: str, *names: str) -> list[str]:
    return [f"+ /{Entities(run).filter(name)}" for name in names]


def _compare(runs: Sequence[str], recording: Recording, framing: Framing) -> rrb.Container:
    names = ("map", "scan", "trajectory/**", *ROBOT)
    reckoned = [f"+ /{entities.dead_reckoning(name)}" for name in names]
    maps = [_overhead(entities.OVERVIEW, framing.aspect, "Dead reckoning: wheels and gyro alone", reckoned + TRUTH)]
    drawn = ("map", "scan/**", "particles", "trajectory/**", "hindsight", "closures", *ROBOT)
    for run in runs:
        title = "Particle filter" if len(runs) == 1 else f"Particle filter: {run}"
        maps.append(_overhead(entities.OVERVIEW, framing.aspect, title, _of_run(run, *drawn) + TRUTH))
    alone = len(runs) == 1
    plots = [_plot(recording, "drift", "Dead reckoning from filter (m)", legend=not alone)]
    if recording.truth is not None:
        plots.append(_plot(recording, "error", "Error against truth (m)"))
    plots += [
        _plot(recording, "n_eff", "N_eff: effective particles", legend=not alone),
        _plot(recording, "spread", "Spread of the particles (m)", legend=not alone),
    ]
    row = rrb.Horizontal(*maps) if len(maps) <= MAPS_IN_A_ROW else rrb.Grid(*maps, grid_columns=2)
    return rrb.Vertical(row, rrb.Horizontal(*plots), row_shares=[5, 2], name="Compare")


def _plot(
    recording: Recording, name: str, title: str, contents: list[str] | None = None, legend: bool = True
) -> rrb.TimeSeriesView:
    boundary = rrb.TimeRangeBoundary.absolute
    whole = rrb.TimeRange(start=boundary(seq=0), end=boundary(seq=len(recording) - 1))
    return rrb.TimeSeriesView(
        origin=f"/plots/{name}",
        contents=contents or ["$origin/**"],
        name=title,
        axis_x=rrb.TimeAxis(link="Independent", view_range=whole),
        plot_legend=rrb.PlotLegend(corner="LeftTop", visible=legend),
    )


def _filter(run: str, several: bool, recording: Recording) -> rrb.Container:
    path = Entities(run).filter
    both = ("map", "scan/**", "trajectory/**", "particles", "covariance", "mean", "degenerate")
    close_up = _overhead(
        path("follow/close_up"),
        1.0,
        f"Round the robot ({FOLLOW_HEIGHT:g} m)",
        _of_run(run, *both, "closures", "robot/outline") + TRUTH,
    )
    loupe = _overhead(
        path("follow/loupe"),
        1.0,
        "The particles, coloured by weight",
        _of_run(run, *both, "headings", "lineages", "correction") + TRUTH,
        overrides={f"/{path('particles')}": Points3D.from_fields(radii=Radius.ui_points(3.0))},
    )
    plots = [
        _plot(
            recording,
            "correlation",
            "End points on occupied cells",
            [f"+ /{Entities(run).plot('correlation')}"],
            legend=False,
        ),
        _plot(recording, "n_eff", "N_eff: effective particles", [f"+ /{Entities(run).plot('n_eff')}"], legend=False),
        _plot(recording, "lineages", "Surviving lineages", [f"+ /{Entities(run).plot('lineages')}"], legend=False),
        _plot(recording, "heading_drift", "Heading: dead reckoning from filter (°)", legend=False)
        if not several
        else _plot(
            recording, "heading_drift", "Heading drift (°)", [f"+ /{Entities(run).plot('heading_drift')}"], legend=False
        ),
    ]
    name = run if several else "Filter"
    return rrb.Vertical(rrb.Horizontal(close_up, loupe), rrb.Horizontal(*plots), row_shares=[5, 2], name=name)


def _texture(run: str, several: bool, framing: Framing) -> rrb.Container:
    paths = Entities(run)
    floor = _of_run(run, "map", "texture", "trajectory/**", *ROBOT)
    camera, disparity = f"/{paths.filter('robot/camera')}", f"/{paths.disparity_image}"
    images = rrb.Vertical(
        rrb.Spatial2DView(origin=camera, contents=["$origin"], name="Colour camera"),
        rrb.Spatial2DView(origin=disparity, contents=["$origin"], name="Depth camera (bright is near)"),
    )
    name = run if several else "Texture"
    view = _overhead(entities.OVERVIEW, framing.aspect, "Floor texture over the map", floor)
    return rrb.Horizontal(view, images, column_shares=[5, 2], name=name)


def _three_d(run: str, several: bool, framing: Framing) -> rrb.Spatial3DView:
    x, y = framing.center
    width, height = framing.content
    tall = height > width  # then look from the side, so that the longer side lies across the window
    reach = max(min(width, height), max(width, height) / 1.6)
    back, aside = (
        (np.array([1.0, 0.0]), np.array([0.0, 1.0])) if tall else (np.array([0.0, -1.0]), np.array([1.0, 0.0]))
    )
    eye = np.array([x, y]) + reach * (0.64 * back - 0.08 * aside)
    target = np.array([x, y]) + 0.08 * reach * back
    names = ("map", "walls", "texture", "scan/**", "particles", "trajectory/**", "hindsight", "robot/**", "closures")
    reckoned = [f"+ /{entities.dead_reckoning(name)}" for name in ("trajectory/**", "robot/**")]
    return rrb.Spatial3DView(
        origin="/world",
        contents=_of_run(run, *names) + reckoned + TRUTH,
        name=run if several else "3-D",
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=[*eye, 0.56 * reach],
            look_target=[*target, 0.0],
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
