"""The best and the worst cell of a recording, with what was kept of them."""

from collections.abc import Sequence
from dataclasses import dataclass

from pfslam_viz.sweep.plan import Cell, Plan
from pfslam_viz.sweep.results import Results, number
from pfslam_viz.sweep.row import HIGHER_IS_BETTER
from pfslam_viz.sweep.summary import Ranking, value_of, varying
from pfslam_viz.sweep.trace import Trace


@dataclass(frozen=True, slots=True)
class Extreme:
    """``name`` is "best" or "worst"; ``title`` says which cell it is, and its number."""

    name: str
    title: str
    trace: Trace


def label_of(plan: Plan, cell: Cell) -> str:
    """What a cell is called: the settings that differ, and its seed."""
    parts = [value_of(cell.variant, name) if name == "config" else f"{name} {value_of(cell.variant, name)}"
             for name in varying(plan)]  # fmt: skip
    return ", ".join([*parts, f"seed {cell.seed}"])


def ranked_cells(ranking: Ranking, cells: Sequence[Cell], results: Results) -> list[tuple[float, Cell]]:
    """The recording's cells that are done, with the number that they are ranked by, best first."""
    rows = {row["cell"]: row for row in results.rows}
    own = [cell for cell in cells if cell.recording == ranking.recording and cell.id in rows]
    known = [(value, cell) for cell in own if (value := number(rows[cell.id].get(ranking.by, ""))) is not None]
    return sorted(known, key=lambda pair: pair[0], reverse=ranking.by in HIGHER_IS_BETTER)


def extremes(plan: Plan, ranking: Ranking, cells: Sequence[Cell], results: Results) -> list[Extreme]:
    """The best cell and, where there is another one, the worst."""
    ranked = ranked_cells(ranking, cells, results)
    ends = [("best", ranked[0]), ("worst", ranked[-1])] if len(ranked) > 1 else [("best", pair) for pair in ranked]
    found = []
    for name, (value, cell) in ends:
        if (trace := results.trace(cell)) is not None:
            found.append(Extreme(name, f"{name}: {label_of(plan, cell)}: {ranking.by} {value:.4g}", trace))
    return found
