"""The layout: the tabs Compare, Filter, Error, Texture, 3-D and About."""

from collections.abc import Sequence

import rerun.blueprint as rrb
from rerun import Points3D, Radius

from pfslam_viz.recordings.recording import Recording
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.entities import ENTITIES, Entity, Kind, View
from pfslam_viz.viewer.framing import WINDOW, Framing, eye_on, overhead_size
from pfslam_viz.viewer.style import CLOSE_UP, FOLLOW_HEIGHT, LOUPE, scale_bar_path

LONGEST = 60.0  # s that a replay takes at most, however long the recording
SPEED_UP = 2.0  # times real time, unless that takes longer
IN_A_ROW = 3
WIDEST = 2.0  # width by height of all views in a row, in a window of 1280 x 720 pixels or wider

BACKGROUND = (112, 137, 134)
"""What the viewer draws unknown cells in: a view looks the same inside and outside the map."""


def blueprint(
    recording: Recording, framing: Framing, runs: Sequence[str], particles: int, live: bool = False
) -> rrb.Blueprint:
    """The layout for one run, of so many ``particles``, or for several that are compared side by side.

    ``live`` follows the newest scan; otherwise the recording plays from its start, a two-minute one in one minute.
    """
    seconds = min(max(recording.duration, 1.0) / SPEED_UP, LONGEST)
    several = len(runs) > 1
    tabs: list[rrb.Container | rrb.View] = [
        _compare(runs, recording, framing, particles),
        _filter(runs, recording, particles),
    ]
    if recording.truth is not None:
        tabs.append(_error(runs, recording, framing))
    if recording.frames is not None:
        tabs.append(_texture(runs, framing))
    window = min(WINDOW, WIDEST / len(runs)) if len(runs) <= IN_A_ROW else WINDOW
    spaces = [_three_d(run, several, framing, window) for run in runs]
    tabs.append(_in_rows(spaces, name="3-D") if several else spaces[0])
    return rrb.Blueprint(
        rrb.Tabs(*tabs, _pages(several), active_tab=0),
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


def _in_rows(parts: Sequence[rrb.Container | rrb.View], name: str | None = None) -> rrb.Container:
    """Views beside each other, in two rows where they are too many for one."""
    if len(parts) <= IN_A_ROW:
        return rrb.Horizontal(*parts, name=name)
    return rrb.Grid(*parts, grid_columns=-(-len(parts) // 2), name=name)


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
            if row.kind in (Kind.GRID, Kind.BOXES):
                found.append(f"{row.path(run)}/**")  # their blocks
    return [f"+ /{path}" for path in [*found, *more]]


def _maps(view: View, runs: Sequence[str], framing: Framing, titles: Sequence[str], *truth: str) -> rrb.Container:
    """Dead reckoning's map and the runs' beside each other; ``truth`` is the owner "truth", if it is drawn there."""
    more = [entities.SCALE_BAR]
    more += [entities.ERROR_SCALE, f"{entities.ERROR_SCALE}/limits"] if view is View.ERROR else []
    shown = [contents(view, "", "dead_reckoning", *truth, more=more)]
    shown += [contents(view, run, "{run}", *truth, more=more) for run in runs]
    return _in_rows([_overhead(entities.OVERVIEW, framing.aspect, *each) for each in zip(titles, shown, strict=True)])


def _compare(runs: Sequence[str], recording: Recording, framing: Framing, particles: int) -> rrb.Container:
    several = len(runs) > 1
    titles = ["Dead reckoning" if several else "Dead reckoning: wheels and gyro alone"]
    titles += [f"Particle filter: {run}" if several else "Particle filter" for run in runs]
    row = _maps(View.COMPARE, runs, framing, titles, "truth")
    plots = rrb.Horizontal(*_plots(View.COMPARE_PLOTS, recording, runs, particles))
    left = rrb.Vertical(row, plots, row_shares=[5, 2])
    return rrb.Horizontal(left, _beside(runs), column_shares=[14, 4], name="Compare")


def _error(runs: Sequence[str], recording: Recording, framing: Framing) -> rrb.Container:
    """Where the trajectories err, by colour, and the filters' own errors over time, which dead reckoning's dwarf."""
    titles = ["Dead reckoning by error", *(f"{run if len(runs) > 1 else 'Particle filter'} by error" for run in runs)]
    row = _maps(View.ERROR, runs, framing, titles)
    plots = rrb.Horizontal(*_plots(View.ERROR_PLOTS, recording, runs))
    return rrb.Vertical(row, plots, row_shares=[2, 1], name="Error")


def _beside(runs: Sequence[str]) -> rrb.Container:
    """The legend, and a list of events for each run, without its least important ones."""
    legend = rrb.TextDocumentView(origin=f"/{entities.LEGEND}", name="Colours")
    lists = [
        rrb.TextLogView(
            origin="/events",
            contents=[f"+ /{row.path(run)}" for row in ENTITIES if View.EVENTS in row.views],
            name="Events" if len(runs) == 1 else f"Events: {run}",
            columns=rrb.TextLogColumns(
                timeline_columns=["step"], text_log_columns=[rrb.encodings.TextLogColumnKind.Body]
            ),
            rows=rrb.TextLogRows(filter_by_log_level=["INFO", "WARN"]),
        )
        for run in runs
    ]
    return rrb.Vertical(legend, *lists, row_shares=[1, *[1 / len(runs)] * len(runs)])


def _plots(view: View, recording: Recording, runs: Sequence[str], particles: int = 1) -> list[rrb.TimeSeriesView]:
    """The plots of a tab with these runs' curves; a legend where a plot has several."""
    boundary = rrb.TimeRangeBoundary.absolute
    whole = rrb.TimeRange(start=boundary(seq=0), end=boundary(seq=len(recording) - 1))
    curves = [row for row in ENTITIES if view in row.views and (row.plot != "error" or recording.truth is not None)]
    plots = []
    for first in curves:
        if first.title:
            share = first is entities.N_EFF and len(runs) > 1
            most = (1 if share else particles) if first is entities.N_EFF else None
            paths = dict.fromkeys(row.path(run) for row in curves if row.plot == first.plot for run in runs)
            plots.append(
                rrb.TimeSeriesView(
                    origin=f"/plots/{first.plot}",
                    contents=[f"+ /{path}" for path in paths],
                    name=_plot_title(first, view, share),
                    axis_y=rrb.ScalarAxis(range=(-0.03 * most, 1.05 * most)) if most else None,
                    axis_x=rrb.TimeAxis(link="Independent", view_range=whole),
                    plot_legend=rrb.PlotLegend(visible=False),  # it would cover the curves, whose colours are the maps'
                )
            )
    return plots


def _plot_title(first: Entity, view: View, share: bool) -> str:
    if view is View.ERROR_PLOTS:
        return "Error of the filter alone (m)"
    return f"{first.title}, share of N" if share else first.title


def _filter(runs: Sequence[str], recording: Recording, particles: int) -> rrb.Container:
    """What follows the robot, of several runs beside each other, and the curves with what their colours mean."""
    close_ups, loupes = zip(*(_round_the_robot(run, len(runs) > 1) for run in runs), strict=True)
    legend = rrb.TextDocumentView(origin=f"/{entities.FILTER_LEGEND}", name="Colours")
    plots = rrb.Horizontal(*_plots(View.FILTER_PLOTS, recording, runs, particles), legend)
    if len(runs) <= 2:
        return rrb.Vertical(rrb.Horizontal(*close_ups, *loupes), plots, row_shares=[5, 2], name="Filter")
    rows = [rrb.Horizontal(*views) for views in (close_ups, loupes)]
    return rrb.Vertical(*rows, plots, row_shares=[3, 3, 2], name="Filter")


def _round_the_robot(run: str, several: bool) -> tuple[rrb.Spatial2DView, rrb.Spatial2DView]:
    """A few metres round the robot, and the particles."""
    follow = entities.FOLLOW.path(run)
    close_up = _overhead(
        f"{follow}/{CLOSE_UP}",
        1.0,
        f"{run}: the robot ({FOLLOW_HEIGHT:g} m)" if several else f"Round the robot ({FOLLOW_HEIGHT:g} m)",
        contents(View.CLOSE_UP, run, "{run}", "truth", more=[scale_bar_path(run, CLOSE_UP)]),
    )
    loupe = _overhead(
        f"{follow}/{LOUPE}",
        1.0,
        f"{run}: particles" if several else "The particles, coloured by weight",
        contents(View.LOUPE, run, "{run}", "truth", more=[scale_bar_path(run, LOUPE)]),
        overrides={f"/{entities.PARTICLES.path(run)}": Points3D.from_fields(radii=Radius.ui_points(3.5))},
    )
    return close_up, loupe


def _texture(runs: Sequence[str], framing: Framing) -> rrb.Container:
    """Each run's floor, and the camera's images, which are the same for all."""
    images = rrb.Vertical(
        *(
            rrb.Spatial2DView(origin=f"/{row.path(runs[0])}", contents=["$origin"], name=name)
            for view, name in (
                (View.COLOR_CAMERA, "Colour camera"),
                (View.DEPTH_CAMERA, "Depth camera (bright is near)"),
            )
            for row in ENTITIES
            if view in row.views
        )
    )
    floors = [
        _overhead(
            entities.OVERVIEW,
            framing.aspect,
            "Floor texture over the map" if len(runs) == 1 else f"Floor: {run}",
            contents(View.TEXTURE, run, "{run}", more=[entities.SCALE_BAR]),
        )
        for run in runs
    ]
    return rrb.Horizontal(_in_rows(floors), images, column_shares=[5, 2], name="Texture")


def _three_d(run: str, several: bool, framing: Framing, window: float) -> rrb.Spatial3DView:
    eye, target = eye_on(framing, window)
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


def _pages(several: bool) -> rrb.Container:
    """``several`` runs have a wide table of results."""
    return rrb.Horizontal(
        rrb.TextDocumentView(origin=f"/{entities.HELP}", name="What you see"),
        rrb.TextDocumentView(origin=f"/{entities.ABOUT}", name="This recording"),
        column_shares=[1, 1] if several else [3, 2],
        name="About",
    )
