"""An error over a setting: which cells make one curve, and where their points lie on the axis."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from pfslam_viz.sweep.plan import Plan
from pfslam_viz.sweep.results import number
from pfslam_viz.sweep.summary import Line, Ranking, short_names, value_of, varying
from pfslam_viz.viewer.colors import HIT, MISS, RUNS, TRUTH, Color

COLORS: tuple[Color, ...] = (*RUNS[:3], TRUTH, MISS, *RUNS[3:], HIT)
"""Of the curves of a panel, in this order."""
LOG_FROM = 10.0  # times from the smallest to the largest value: then an axis is logarithmic


@dataclass(frozen=True, slots=True)
class Point:
    """One value of the setting: ``position`` on the axis, its text, the number of every seed."""

    position: float
    text: str
    values: tuple[float, ...]

    @property
    def median(self) -> float:
        """Over the seeds."""
        return median(self.values)


@dataclass(frozen=True, slots=True)
class Curve:
    """Points that differ in the setting alone; ``label`` says what the other settings are."""

    label: str
    points: tuple[Point, ...]


@dataclass(frozen=True, slots=True)
class Panel:
    """All curves over one setting; ``log`` says how its axis is best drawn, ``ticks`` are the positions with texts."""

    setting: str
    curves: tuple[Curve, ...]
    log: bool
    numeric: bool
    ticks: tuple[tuple[float, str], ...]


def panels(plan: Plan, ranking: Ranking) -> list[Panel]:
    """A panel for each setting that differs; none where nothing has been measured."""
    order = {id(variant): k for k, variant in enumerate(plan.variants)}  # so that recordings have the same colours
    known = [line for line in ranking.lines if ranking.by in line.ranges]
    lines = sorted(known, key=lambda line: order[id(line.variant)])
    return [panel for name in varying(plan) if (panel := _panel(name, varying(plan), lines, ranking.by))]


def as_number(text: str) -> float | None:
    """A value's place on an axis: a number, or the one that all parts of a list are; None for words."""
    if text.startswith("["):
        try:
            parts = {float(part) for part in json.loads(text)}
        except (ValueError, TypeError):
            return None
        return parts.pop() if len(parts) == 1 else None
    return number(text)


def _panel(name: str, names: Sequence[str], lines: Sequence[Line], by: str) -> Panel | None:
    texts = list(dict.fromkeys(value_of(line.variant, name) for line in lines))
    numbers = {text: as_number(text) for text in texts}
    numeric = None not in numbers.values() and len(set(numbers.values())) == len(texts)
    texts.sort(key=lambda text: numbers[text] if numeric else 0.0)  # type: ignore[arg-type, return-value]
    places = {text: float(numbers[text] if numeric else k) for k, text in enumerate(texts)}  # type: ignore[arg-type]
    short = short_names(names) | {"config": ""}
    groups: dict[tuple[str, ...], list[Point]] = {}
    for line in lines:
        text = value_of(line.variant, name)
        others = tuple(f"{short[o]} {value_of(line.variant, o)}".strip() for o in names if o != name)
        values = tuple(v for _, row in line.rows if (v := number(row[by])) is not None)
        groups.setdefault(others, []).append(Point(places[text], text, values))
    if any(len(points) > 1 for points in groups.values()):  # the rest is drawn over another setting
        groups = {others: points for others, points in groups.items() if len(points) > 1}
    curves = [
        Curve(", ".join(others), tuple(sorted(points, key=lambda p: p.position))) for others, points in groups.items()
    ]
    shown = sorted({(point.position, point.text) for curve in curves for point in curve.points})
    if not shown:
        return None
    low, high = shown[0][0], shown[-1][0]
    return Panel(name, tuple(curves), numeric and low > 0 and high >= LOG_FROM * low, numeric, tuple(shown))
