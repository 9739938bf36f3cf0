"""A sweep's plots, drawn with matplotlib: the extra ``figures``; import this module only where they are drawn."""

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, StrMethodFormatter

from pfslam_viz.files import replaced
from pfslam_viz.sweep.curves import COLORS, Panel
from pfslam_viz.sweep.summary import LABELS
from pfslam_viz.sweep.trace import Points, Trace
from pfslam_viz.viewer.colors import DEAD_RECKONING, FILTER, TRUTH, Color

COLUMNS, WIDTH, HEIGHT, DPI = 3, 5.0, 3.8, 110
MOST_LABELS = 8
LOG_FROM = 20.0  # from the smallest to the largest error: then the axis is logarithmic


def draw_panels(path: Path, title: str, by: str, panels: Sequence[Panel]) -> None:
    """The number ``by`` over every setting: a point a cell, a line through the medians over the seeds."""
    columns = min(COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    with style.context("default"):
        figure = Figure((WIDTH * columns, HEIGHT * rows + 0.3), DPI, facecolor="white", layout="constrained")
        figure.suptitle(title)
        for k, panel in enumerate(panels):
            _draw(figure.add_subplot(rows, columns, k + 1), panel, LABELS.get(by, by))
        _save(figure, path)


def draw_overview(path: Path, panels: Sequence[tuple[str, str, Sequence[Panel]]]) -> None:
    """All recordings in one picture: setting by setting, a plot for each (name, number, panels) beside the last."""
    settings = list(dict.fromkeys(panel.setting for _, _, own in panels for panel in own))
    rows = math.ceil(len(panels) / COLUMNS)  # of one setting
    columns = math.ceil(len(panels) / rows)
    with style.context("default"):
        size = 0.7 * WIDTH * columns, 0.75 * HEIGHT * rows * len(settings)
        figure = Figure(size, DPI, facecolor="white", layout="constrained")
        for number, (name, by, own) in enumerate(panels):
            for panel in own:
                place = settings.index(panel.setting) * rows * columns + number + 1
                axes = figure.add_subplot(rows * len(settings), columns, place)
                _draw(axes, panel, LABELS.get(by, by))
                axes.set_title(name, fontsize=10)
        _save(figure, path)


def draw_maps(path: Path, title: str, maps: Sequence[tuple[str, Trace]]) -> None:
    """Maps with their trajectories, truth and dead reckoning, beside each other at one scale."""
    with style.context("default"):
        figure = Figure((1.3 * WIDTH * len(maps), 1.3 * HEIGHT), DPI, facecolor="white", layout="constrained")
        figure.suptitle(title)
        first: Axes | None = None
        for k, (name, trace) in enumerate(maps):
            axes = figure.add_subplot(1, len(maps), k + 1, sharex=first, sharey=first)
            first = first or axes
            left, top = trace.corner
            rows, columns = trace.image.shape
            extent = (left, left + columns * trace.cell, top - rows * trace.cell, top)
            axes.imshow(trace.image, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="antialiased")
            for poses, color, label in _paths(trace):
                axes.plot(poses[:, 0], poses[:, 1], color=_rgb(color), linewidth=1.2, label=label)
            axes.set_aspect("equal")
            axes.set_title(name, fontsize=9)
            axes.set_xlabel("m")
        if first is not None:
            first.legend(fontsize=8)
        _save(figure, path)


def _paths(trace: Trace) -> list[tuple[Points, Color, str]]:
    paths = [(trace.dead_reckoning, DEAD_RECKONING, "dead reckoning"), (trace.estimate, FILTER, "filter")]
    if trace.truth is not None:
        paths.append((trace.truth, TRUTH, "truth"))
    return paths


def _draw(axes: Axes, panel: Panel, label: str) -> None:
    values = [value for curve in panel.curves for point in curve.points for value in point.values]
    for k, curve in enumerate(panel.curves):
        color = _rgb(COLORS[k % len(COLORS)])
        x = [point.position for point in curve.points]
        name = curve.label if k < MOST_LABELS else None
        axes.plot(x, [point.median for point in curve.points], color=color, linewidth=1.5, label=name)
        for point in curve.points:
            axes.plot([point.position] * len(point.values), point.values, ".", color=color, markersize=6, alpha=0.7)
    if panel.log:
        axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator([position for position, _ in panel.ticks]))
    axes.xaxis.set_minor_locator(NullLocator())
    many = sum(len(text) for _, text in panel.ticks) > 40
    texts = [f"{position:g}" if panel.numeric else text for position, text in panel.ticks]
    axes.set_xticklabels(texts, rotation=30 if many else 0, ha="right" if many else "center", fontsize=8)
    if min(values) > 0 and max(values) >= LOG_FROM * min(values):
        axes.set_yscale("log")
        axes.yaxis.set_major_locator(LogLocator(10.0, (1.0, 2.0, 5.0)))
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.set_ylim(bottom=0)
    axes.set_xlabel(panel.setting)
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    if any(curve.label for curve in panel.curves) and len(panel.curves) > 1:
        axes.legend(fontsize=7)


def _rgb(color: Color) -> tuple[float, ...]:
    return tuple(part / 255 for part in color)


def _save(figure: Figure, path: Path) -> None:
    FigureCanvasAgg(figure)
    with replaced(path) as temporary:
        figure.savefig(temporary, format="png")
