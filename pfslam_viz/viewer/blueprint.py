"""The layout: the tabs Compare, Filter, Texture, 3-D and About."""

from collections.abc import Sequence

import rerun.blueprint as rrb
from rerun import Points3D, Radius

from pfslam_viz.recordings.recording import Recording
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.entities import ENTITIES, Kind, View
from pfslam_viz.viewer.framing import Framing, eye_on, overhead_size
from pfslam_viz.viewer.style import CLOSE_UP, FOLLOW_HEIGHT, LOUPE, scale_bar_path

LONGEST = 60.0  # s that a replay takes at most, however long the recording
SPEED_UP = 2.0  # times real time, unless that takes longer
MAPS_IN_A_ROW = 3

BACKGROUND = (112, 137, 134)
"""What the viewer draws unknown cells in: a view looks the same inside and outside the map."""


def blueprint(recording: Recording, framing: Framing, runs: Sequence[str], live: bool = False) -> rrb.Blueprint:
    """The layout for one run, or for several that are compared side by side.

    ``live`` follows the newest scan; otherwise the recording plays from its start, a two-minute one in one minute.
    """
    seconds = min(max(recording.duration, 1.0) / SPEED_UP, LONGEST)
    several = len(runs) > 1
    tabs: list[rrb.Container | rrb.View] = [
        _compare(runs, recording, framing),
        _filter(runs, recording),
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


def contents(view: View, run: str, *owners: str, more: Sequence[str] = ()) -> list[str]:
    """Queries for what a spatial view shows of these owners ({run}, dead_reckoning, truth), and ``more``."""
    found: list[str] = []
    for row in ENTITIES:
        if view in row.views and row.owner in owners:
            paths = row.visible(run)
            outline_only = view is View.CLOSE_UP and row.kind is Kind.ROBOT  # its shape would cover the particles
            found += paths[-1:] if outline_only else paths
    return [f"+ /{path}" for path in [*found, *more]]


def _compare(runs: Sequence[str], recording: Recording, framing: Framing) -> rrb.Container:
    reckoned = contents(View.COMPARE, "", "dead_reckoning", "truth", more=[entities.SCALE_BAR])
    maps = [_overhead(entities.OVERVIEW, framing.aspect, "Dead reckoning: wheels and gyro alone", reckoned)]
    for run in runs:
        title = "Particle filter" if len(runs) == 1 else f"Particle filter: {run}"
        shown = contents(View.COMPARE, run, "{run}", "truth", more=[entities.SCALE_BAR])
        maps.append(_overhead(entities.OVERVIEW, framing.aspect, title, shown))
    row = rrb.Horizontal(*maps) if len(maps) <= MAPS_IN_A_ROW else rrb.Grid(*maps, grid_columns=2)
    plots = rrb.Horizontal(*_plots(View.COMPARE_PLOTS, recording, runs))
    left = rrb.Vertical(row, plots, row_shares=[5, 2])
    return rrb.Horizontal(left, _beside(runs), column_shares=[9, 2], name="Compare")


def _beside(runs: Sequence[str]) -> rrb.Container:
    """The legend, and the list of events without its least important ones."""
    kind = rrb.encodings.TextLogColumnKind
    paths = [row.path(run) for row in ENTITIES if View.EVENTS in row.views for run in runs]
    several = len(runs) > 1
    events = rrb.TextLogView(
        origin="/events",
        contents=[f"+ /{path}" for path in paths],
        name="Events",
        columns=rrb.TextLogColumns(
            timeline_columns=["step"],
            text_log_columns=[*([kind.EntityPath] if several else []), kind.Body],
        ),
        rows=rrb.TextLogRows(filter_by_log_level=["INFO", "WARN"]),
    )
    legend = rrb.TextDocumentView(origin=f"/{entities.LEGEND}", name="Colours")
    return rrb.Vertical(legend, events, row_shares=[1, 1])


def _plots(view: View, recording: Recording, runs: Sequence[str]) -> list[rrb.TimeSeriesView]:
    """The plots of a tab with these runs' curves; a legend where a plot has several."""
    boundary = rrb.TimeRangeBoundary.absolute
    whole = rrb.TimeRange(start=boundary(seq=0), end=boundary(seq=len(recording) - 1))
    curves = [row for row in ENTITIES if view in row.views and (row.plot != "error" or recording.truth is not None)]
    plots = []
    for first in curves:
        if first.title:
            paths = dict.fromkeys(row.path(run) for row in curves if row.plot == first.plot for run in runs)
            share = first is entities.N_EFF and len(runs) > 1
            plots.append(
                rrb.TimeSeriesView(
                    origin=f"/plots/{first.plot}",
                    contents=[f"+ /{path}" for path in paths],
                    name="N_eff as a share of the particles" if share else first.title,
                    axis_x=rrb.TimeAxis(link="Independent", view_range=whole),
                    plot_legend=rrb.PlotLegend(visible=False),  # it would cover the curves, whose colours are the maps'
                )
            )
    return plots


def _filter(runs: Sequence[str], recording: Recording) -> rrb.Container:
    """What follows the robot: of one run side by side, of several the runs side by side."""
    near = [_round_the_robot(run, len(runs) > 1) for run in runs]
    plots = rrb.Horizontal(*_plots(View.FILTER_PLOTS, recording, runs))
    if len(runs) == 1:
        return rrb.Vertical(rrb.Horizontal(*near[0]), plots, row_shares=[5, 2], name="Filter")
    rows = [rrb.Horizontal(*row) for row in zip(*near, strict=True)]
    return rrb.Vertical(*rows, plots, row_shares=[3, 3, 2], name="Filter")


def _round_the_robot(run: str, several: bool) -> tuple[rrb.Spatial2DView, rrb.Spatial2DView]:
    """A few metres round the robot, and the particles."""
    follow = entities.FOLLOW.path(run)
    whose = f"{run}: " if several else ""
    close_up = _overhead(
        f"{follow}/{CLOSE_UP}",
        1.0,
        f"{whose}{'round' if several else 'Round'} the robot ({FOLLOW_HEIGHT:g} m)",
        contents(View.CLOSE_UP, run, "{run}", "truth", more=[scale_bar_path(run, CLOSE_UP)]),
    )
    loupe = _overhead(
        f"{follow}/{LOUPE}",
        1.0,
        f"{whose}{'the' if several else 'The'} particles, coloured by weight",
        contents(View.LOUPE, run, "{run}", "truth", more=[scale_bar_path(run, LOUPE)]),
        overrides={f"/{entities.PARTICLES.path(run)}": Points3D.from_fields(radii=Radius.ui_points(3.5))},
    )
    return close_up, loupe


def _texture(run: str, several: bool, framing: Framing) -> rrb.Container:
    images = rrb.Vertical(
        *(
            rrb.Spatial2DView(origin=f"/{row.path(run)}", contents=["$origin"], name=name)
            for view, name in (
                (View.COLOR_CAMERA, "Colour camera"),
                (View.DEPTH_CAMERA, "Depth camera (bright is near)"),
            )
            for row in ENTITIES
            if view in row.views
        )
    )
    name = run if several else "Texture"
    view = _overhead(
        entities.OVERVIEW,
        framing.aspect,
        "Floor texture over the map",
        contents(View.TEXTURE, run, "{run}", more=[entities.SCALE_BAR]),
    )
    return rrb.Horizontal(view, images, column_shares=[5, 2], name=name)


def _three_d(run: str, several: bool, framing: Framing) -> rrb.Spatial3DView:
    eye, target = eye_on(framing)
    return rrb.Spatial3DView(
        origin="/world",
        contents=contents(View.THREE_D, run, "{run}", "dead_reckoning", "truth"),
        name=run if several else "3-D",
        background=BACKGROUND,
        line_grid=rrb.LineGrid3D(visible=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye,
            look_target=target,
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
