"""What a sweep found: for each recording its settings, best first, with median and range over the seeds."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import TYPE_CHECKING

from pfslam_viz.errors import InputError
from pfslam_viz.sweep.plan import Cell, Plan, Variant
from pfslam_viz.sweep.results import TextRow, number
from pfslam_viz.sweep.row import HIGHER_IS_BETTER, JUDGES, NUMBERS

if TYPE_CHECKING:
    from rich.console import RenderableType

ALSO = (
    *("position_rmse_m", "position_max_m", "heading_rmse_deg", "relations_translation_mean_m"),
    *("relations_rotation_mean_deg", "wall_thickness_m", "revisit_error_m", "times_real_time"),
)
"""Columns that a table shows beside the one that it is sorted by, where known."""

LABELS = {
    "position_rmse_m": "rmse m",
    "position_max_m": "max m",
    "position_final_m": "end m",
    "heading_rmse_deg": "rmse °",
    "heading_max_deg": "max °",
    "relations_translation_mean_m": "relations m",
    "relations_rotation_mean_deg": "relations °",
    "wall_thickness_m": "walls m",
    "revisit_error_m": "revisits m",
    "scan_to_map_score": "scan-to-map",
    "end_to_start_gap_m": "gap m",
    "n_eff_mean": "N_eff",
    "times_real_time": "x real time",
}
SAME = "≈"
BEST = "*"
SAME_MEANS = f"{SAME}: its range over the seeds overlaps that of the best; the seeds do not tell them apart"


@dataclass(frozen=True, slots=True)
class Range:
    """Median, smallest and largest over seeds."""

    median: float
    min: float
    max: float

    def __str__(self) -> str:
        if self.min == self.max:
            return f"{self.median:.4g}"
        return f"{self.median:.3g} [{self.min:.3g}, {self.max:.3g}]"


@dataclass(frozen=True, slots=True)
class Line:
    """One variant over its seeds: rows that are done, how many failed, and the range of every number."""

    variant: Variant
    rows: tuple[tuple[int, TextRow], ...]
    failed: int
    ranges: Mapping[str, Range]
    same: bool = False


@dataclass(frozen=True, slots=True)
class Ranking:
    """One recording's lines, best first by ``by``; those that have no such number come last."""

    recording: str
    by: str
    lines: tuple[Line, ...]

    @property
    def shown(self) -> list[str]:
        """The columns of its table: the one that it is sorted by first."""
        known = [name for name in ALSO if name != self.by and any(name in line.ranges for line in self.lines)]
        return [self.by, *known]


def rankings(plan: Plan, cells: Sequence[Cell], rows: Sequence[TextRow], by: str | None = None) -> list[Ranking]:
    """A ranking for each recording, by the column ``by`` or by the first of :data:`~.row.JUDGES` that is known."""
    found = []
    done = {row["cell"]: row for row in rows}
    for label, _ in plan.recordings:
        lines = []
        for variant in plan.variants:
            own = [c for c in cells if c.recording == label and c.variant is variant and c.id in done]
            good = tuple((cell.seed, done[cell.id]) for cell in own if not done[cell.id]["error"])
            lines.append(Line(variant, good, len(own) - len(good), dict(_ranges([row for _, row in good]))))
        known = [name for name in JUDGES if any(name in line.ranges for line in lines)]
        found.append(_ranked(label, by or (known[0] if known else JUDGES[-1]), lines))
    return found


def check_column(by: str | None) -> None:
    """Raise InputError for a column that there is not."""
    if by is not None and by not in NUMBERS:
        raise InputError(f"--by {by}: no such column; there are {', '.join(NUMBERS)}")


def _ranked(label: str, by: str, lines: Sequence[Line]) -> Ranking:
    sign = -1.0 if by in HIGHER_IS_BETTER else 1.0
    known = sorted((line for line in lines if by in line.ranges), key=lambda line: sign * line.ranges[by].median)
    rest = [line for line in lines if by not in line.ranges]
    marked = [replace(line, same=_overlaps(line, known[0], by)) for line in known]
    return Ranking(label, by, (*marked, *rest))


def _overlaps(line: Line, best: Line, by: str) -> bool:
    """Whether seeds leave open which of the two is better; never with one seed, which has no spread."""
    a, b = line.ranges[by], best.ranges[by]
    return line is not best and min(len(line.rows), len(best.rows)) > 1 and a.min <= b.max and b.min <= a.max


def _ranges(rows: Sequence[TextRow]) -> Iterator[tuple[str, Range]]:
    for name in NUMBERS:
        values = [value for row in rows if (value := number(row.get(name, ""))) is not None]
        if values:
            yield name, Range(median(values), min(values), max(values))


def varying(plan: Plan) -> list[str]:
    """The columns that tell the variants apart: ``config`` if there are several, and settings that differ."""
    names = ["config"] if len({variant.config for variant in plan.variants}) > 1 else []
    keys = [key for key in plan.keys if len({dict(variant.settings)[key] for variant in plan.variants}) > 1]
    return [*names, *keys] or ["config"]


def short_names(names: Sequence[str]) -> dict[str, str]:
    """For each column the last part of its name, or all of it where several end alike."""
    ends = [name.rpartition(".")[2] for name in names]
    return {name: end if ends.count(end) == 1 else name for name, end in zip(names, ends, strict=True)}


def value_of(variant: Variant, column: str) -> str:
    """What stands in one of the :func:`varying` columns; - where the filter has no such setting."""
    return variant.config if column == "config" else dict(variant.settings)[column] or "-"


def cells_of(plan: Plan, ranking: Ranking) -> tuple[list[str], list[list[str]]]:
    """The head and the body of a ranking's table, as text."""
    names, shown = varying(plan), ranking.shown
    head = ["", *short_names(names).values(), *(LABELS.get(name, name) for name in shown), "seeds"]
    body = []
    for line in ranking.lines:
        counts = f"{len(line.rows)}" + (f", {line.failed} failed" if line.failed else "")
        values = [_text(line.ranges.get(name), name == ranking.by) for name in shown]
        body.append([SAME if line.same else "", *(value_of(line.variant, name) for name in names), *values, counts])
    return head, body


def overview(plan: Plan, found: Sequence[Ranking]) -> tuple[list[str], list[list[str]]]:
    """Head and body of one table of all recordings: a row for each variant as listed, a column for each recording.

    The best of a column is marked ``*``, what the seeds do not tell from it ``≈``.
    """
    names = varying(plan)
    head = [
        *short_names(names).values(),
        *(f"{ranking.recording}, {LABELS.get(ranking.by, ranking.by)}" for ranking in found),
    ]
    body = []
    for variant in plan.variants:
        row = [value_of(variant, name) for name in names]
        for ranking in found:
            place, line = next((k, ln) for k, ln in enumerate(ranking.lines) if ln.variant is variant)
            known = line.ranges.get(ranking.by)
            mark = SAME if line.same else BEST if place == 0 else ""
            row.append("" if known is None else f"{known} {mark}".strip())
        body.append(row)
    return head, body


def cost(rows: Sequence[TextRow]) -> str:
    """What runs cost together: how many, and the core-hours that they took, scoring included."""
    seconds = sum(number(row.get("cell_s", "")) or 0.0 for row in rows)
    return f"{len(rows):,} run{'s' * (len(rows) != 1)}, {seconds / 3600:.2f} core-hours"


def _text(found: Range | None, whole: bool) -> str:
    """The range of what is ranked; the median alone of the rest, for a table that fits a terminal."""
    if found is None:
        return ""
    return str(found) if whole else f"{found.median:.3g}"


def table(plan: Plan, ranking: Ranking) -> "RenderableType":
    """For the terminal."""
    from rich.markup import escape
    from rich.table import Table

    head, body = cells_of(plan, ranking)
    seeds = len(plan.seeds)
    over = f"; median [smallest, largest] over {seeds} seeds" if seeds > 1 else ""
    title = escape(f"{ranking.recording}, best first by {ranking.by}{over}")
    caption = escape(SAME_MEANS) if any(line.same for line in ranking.lines) else None
    shown = Table(title=title, title_justify="left", caption=caption, caption_justify="left")
    for k, name in enumerate(head):
        shown.add_column(
            escape(name), justify="right" if k > len(varying(plan)) else "left", no_wrap=k == len(varying(plan)) + 1
        )
    for row in body:
        shown.add_row(*(escape(text) for text in row))
    return shown


def markdown(plan: Plan, ranking: Ranking) -> str:
    """The same table as Markdown."""
    lines = [f"### {ranking.recording}", "", *_markdown_table(*cells_of(plan, ranking))]
    if any(line.same for line in ranking.lines):
        lines += ["", SAME_MEANS]
    return "\n".join(lines) + "\n"


def markdown_page(plan: Plan, found: Sequence[Ranking], rows: Sequence[TextRow]) -> str:
    """Everything as Markdown: the overview, where there are several recordings, and a table for each."""
    parts = [f"{plan.in_words}; {cost(rows)}\n"]
    if len(found) > 1:
        parts.append("\n".join([*_markdown_table(*overview(plan, found)), "", f"{BEST}: the best. {SAME_MEANS}", ""]))
    return "\n".join([*parts, *(markdown(plan, ranking) for ranking in found)])


def _markdown_table(head: Sequence[str], body: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *body)]
