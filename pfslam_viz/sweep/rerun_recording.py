"""sweep.rrd: a tab for each recording with curves over settings, the best and the worst run, and every trajectory."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from pfslam_viz.sweep.curves import COLORS, Panel, panels
from pfslam_viz.sweep.extremes import Extreme, extremes, label_of, ranked_cells
from pfslam_viz.sweep.plan import Cell, Plan
from pfslam_viz.sweep.results import Results
from pfslam_viz.sweep.summary import LABELS, Ranking, markdown_page
from pfslam_viz.sweep.trace import Points
from pfslam_viz.viewer.colors import DEAD_RECKONING, FILTER, MISS, TRUTH, Color
from pfslam_viz.viewer.sinks import Sink, open_sinks

INK: Color = (130, 130, 130)
BOX = (160.0, 100.0)  # a panel's axes in the view's own units, width and height
GAP = 50.0  # between panels
BACKGROUND = (128, 128, 128)  # as unknown cells of a map


def write_recording(path: Path, plan: Plan, found: Sequence[Ranking], cells: Sequence[Cell], results: Results) -> None:
    """Write the recording. It has no timeline: everything holds for the whole sweep."""
    with open_sinks(save=path, application_id="pfslam-viz sweep", name="sweep") as sink:
        tabs = [_recording(sink, str(k), plan, ranking, cells, results) for k, ranking in enumerate(found)]
        text = markdown_page(plan, found, results.of(cells))
        sink.log_static("table", rr.TextDocument(text, media_type="text/markdown"))
        page = rrb.TextDocumentView(origin="/table", name="Table")
        blueprint = rrb.Blueprint(
            rrb.Tabs(*tabs, page, active_tab=0),
            rrb.BlueprintPanel(state="expanded"),  # its eyes switch trajectories on and off
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="hidden"),
            auto_views=False,
            auto_layout=False,
        )
        sink.send_blueprint(blueprint)


def _recording(
    sink: Sink, at: str, plan: Plan, ranking: Ranking, cells: Sequence[Cell], results: Results
) -> rrb.Container:
    _log_curves(sink, f"{at}/curves", panels(plan, ranking), LABELS.get(ranking.by, ranking.by))
    ends = extremes(plan, ranking, cells, results)
    maps: list[rrb.View] = []
    for end in ends:
        _log_map(sink, f"{at}/{end.name}", end)
        view = rrb.Spatial2DView(origin=f"/{at}/{end.name}", name=end.title, background=BACKGROUND)
        maps.append(view)
    _log_trajectories(sink, f"{at}/runs", plan, ranking, cells, results)
    curves = rrb.Spatial2DView(origin=f"/{at}/curves", name=f"{ranking.by} over the settings")
    runs = rrb.Spatial2DView(origin=f"/{at}/runs", name="Every run's trajectory", contents=["$origin/**"])
    return rrb.Vertical(
        rrb.Horizontal(curves, runs), *([rrb.Horizontal(*maps)] if maps else []), name=ranking.recording
    )


def _log_map(sink: Sink, at: str, end: Extreme) -> None:
    """A map as an image, with trajectories in its pixels."""
    trace = end.trace
    sink.log_static(f"{at}/map", rr.Image(trace.image, draw_order=-10))

    def pixels(poses: Points) -> Points:
        left, top = trace.corner
        return np.stack([(poses[:, 0] - left) / trace.cell, (top - poses[:, 1]) / trace.cell], axis=-1)

    _line(sink, f"{at}/dead_reckoning", pixels(trace.dead_reckoning), DEAD_RECKONING)
    if trace.truth is not None:
        _line(sink, f"{at}/truth", pixels(trace.truth), TRUTH)
    _line(sink, f"{at}/trajectory", pixels(trace.estimate), FILTER)


def _log_trajectories(
    sink: Sink, at: str, plan: Plan, ranking: Ranking, cells: Sequence[Cell], results: Results
) -> None:
    """Each an entity, which the viewer's eye switches; from best (blue) to worst (magenta), in metres."""
    ranked = ranked_cells(ranking, cells, results)
    truth = None
    for place, (value, cell) in reversed(list(enumerate(ranked))):
        trace = results.trace(cell)
        if trace is None:
            continue
        truth = trace.truth if trace.truth is not None else truth
        share = place / max(len(ranked) - 1, 1)
        color = tuple(round(a + share * (b - a)) for a, b in zip(FILTER, MISS, strict=True))
        path = rr.new_entity_path([*at.split("/"), f"{place + 1:04d} {label_of(plan, cell)}: {value:.4g}"])
        _line(sink, path, _upright(trace.estimate), color)
    if truth is not None:
        _line(sink, f"{at}/truth", _upright(truth), TRUTH, 2.0)


def _log_curves(sink: Sink, at: str, shown: Sequence[Panel], label: str) -> None:
    """Axes, a line through the medians and a point a run, panel beside panel."""
    for k, panel in enumerate(shown):
        x0 = k * (BOX[0] + GAP)
        values = [value for curve in panel.curves for point in curve.points for value in point.values]
        high = max(values) or 1.0
        low_x, high_x = _scaled(panel, panel.ticks[0][0]), _scaled(panel, panel.ticks[-1][0])

        def place(
            position: float,
            value: float,
            panel: Panel = panel,
            x0: float = x0,
            low: float = low_x,
            width: float = high_x - low_x,
            high: float = high,
        ) -> tuple[float, float]:
            share = (_scaled(panel, position) - low) / width if width > 0 else 0.5
            return x0 + share * BOX[0], -value / high * BOX[1]

        here = rr.new_entity_path([*at.split("/"), panel.setting])
        _log_axes(sink, here, panel, place, high, f"{label} over {panel.setting}")
        for number, curve in enumerate(panel.curves):
            color = COLORS[number % len(COLORS)]
            path = f"{here}{rr.new_entity_path([curve.label or 'all'])}"
            medians = [place(point.position, point.median) for point in curve.points]
            _line(sink, f"{path}/median", np.array(medians, np.float32), color, 1.5)
            dots = [place(point.position, value) for point in curve.points for value in point.values]
            sink.log_static(f"{path}/runs", rr.Points2D(dots, colors=color, radii=rr.Radius.ui_points(3.0)))


def _log_axes(sink: Sink, at: str, panel: Panel, place: Any, high: float, title: str) -> None:
    left, right = panel.ticks[0][0], panel.ticks[-1][0]
    (x0, bottom), (x1, top) = place(left, 0.0), place(right, high)
    frame = [[x0, top], [x0, bottom], [x1, bottom]]
    sink.log_static(f"{at}/axes", rr.LineStrips2D([frame], colors=INK, radii=rr.Radius.ui_points(0.75)))
    ticks = [(place(position, 0.0), f"{position:g}" if panel.numeric else text) for position, text in panel.ticks]
    ticks += [((x0 - 6.0, place(left, value)[1]), f"{value:.3g}") for value in (high / 2, high)]
    ticks += [(((x0 + x1) / 2, top - 10.0), title)]
    sink.log_static(
        f"{at}/ticks",
        rr.Points2D(
            [point for point, _ in ticks],
            labels=[text for _, text in ticks],
            colors=INK,
            radii=rr.Radius.ui_points(1.0),
            show_labels=True,
        ),
    )


def _scaled(panel: Panel, position: float) -> float:
    return math.log(position) if panel.log else position


def _upright(poses: Points) -> Points:
    """Positions for a 2-D view, whose second axis points down."""
    return poses[:, :2] * np.array([1.0, -1.0], np.float32)


def _line(sink: Sink, path: str, points: Points, color: tuple[int, ...], width: float = 1.25) -> None:
    sink.log_static(path, rr.LineStrips2D([points[:, :2]], colors=color, radii=rr.Radius.ui_points(width)))
