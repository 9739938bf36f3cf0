"""How the time of a scan grows with particles, beams and cell size, beside the literal NumPy filter.

python -m benchmarks scaling --recording 21 --data DIR --start 1000 --stop 1600
"""

import argparse
from dataclasses import replace
from typing import Any

from benchmarks.case import Case, measure
from benchmarks.literal_filter import PHASES
from benchmarks.speed import add_case_options, case_of

BASE: dict[str, Any] = {"particles": 500, "beams": 1081, "cell": 0.07}
SWEEPS: dict[str, tuple[Any, ...]] = {
    "particles": (50, 100, 500, 1000, 5000),
    "beams": (270, 540, 1081),
    "cell": (0.03, 0.05, 0.07, 0.1),
}


def main(arguments: list[str]) -> None:
    """Print a markdown table, a row for each case; each sweep changes one number of the paper's settings."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks scaling", description=__doc__.splitlines()[0])
    add_case_options(parser)
    parser.add_argument("--no-literal", action="store_true")
    given = parser.parse_args(arguments)
    base = case_of(given, **BASE, log=False, texture=False)
    print("Mean ms a scan; peak memory of the process.\n")
    print(
        "| particles | beams | cell m | predict | correlate | map | resample | other map | sum | MB | literal | ratio |"
    )
    print("| ---: " * 12 + "|")
    seen: set[tuple[object, ...]] = set()
    for name, values in SWEEPS.items():
        for value in values:
            case = replace(base, **{name: value})
            key = (case.particles, case.beams, case.cell)
            if key not in seen:
                seen.add(key)
                print(_row(case, literal=not given.no_literal), flush=True)


def _row(case: Case, literal: bool) -> str:
    numbers = measure(case)
    times = [numbers["phases"][phase]["mean"] if phase in numbers["phases"] else 0.0 for phase in PHASES]
    cells = [f"{case.particles:,}", f"{numbers['beams']:,}", f"{case.cell:g}"]
    cells += [f"{value:.3f}" for value in (*times, sum(times))]
    cells.append(f"{numbers['peak_mb']:,.0f}")
    if literal:
        beside = sum(p["mean"] for p in measure(replace(case, filter="literal"))["phases"].values())
        cells += [f"{beside:.1f}", f"{beside / sum(times):.1f}"]
    else:
        cells += ["", ""]
    return f"| {' | '.join(cells)} |"
