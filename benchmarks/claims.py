"""The sweeps that test the report's claims, and their tables and plots in docs/paper-claims.md.

python -m benchmarks claims --data DIR --out studies --write

DIR holds the recordings by the names that the studies in configs/sweeps have: ``twin21/``, ``intel/`` and the simulated
buildings (docs/paper-claims.md says how they are made). One folder holds all runs, so that what studies share is run
once; what is done is not run again. ``--only perturbation:demo,office-1`` leaves recordings out of a study, and studies
that are not named. With --write, what stands in the page between ``<!-- particles -->`` and ``<!-- end -->`` is
replaced by the study's table, and docs/images/claims-particles.png by its plot.
"""

import argparse
import csv
import re
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

from benchmarks.case import ROOT

STUDIES = ("particles", "resampling", "variance", "resolution", "perturbation", "uturn")
WALLS = ("particles", "resolution")
PAGE = ROOT / "docs" / "paper-claims.md"
PICTURES = ("curves.png", "maps-0.png")  # of several recordings, of one
LEFT_OUT = ("", "x real time", "seeds")  # columns: the mark, times of a machine that others use, what the text says


def main(arguments: list[str]) -> None:
    """Run what is missing, study by study, and print the tables or write them into the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks claims", description=__doc__)
    parser.add_argument("--data", type=Path, help="folder that holds the recordings")
    parser.add_argument("--out", type=Path, required=True, help="folder for the runs")
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--only", action="append", metavar="STUDY[:RECORDING,...]", help="this study; repeatable")
    parser.add_argument("--write", action="store_true", help="write docs/paper-claims.md")
    given = parser.parse_args(arguments)
    tables = {}
    for text in given.only or STUDIES:
        study, _, names = text.partition(":")
        command = ["pfslam_viz", "sweep", *(names.split(",") if names else ()), "--plan", study]
        command += ["--out", str(given.out), "--no-rrd", "--quiet"]
        command += ["--data", str(given.data)] if given.data else []
        command += ["--workers", str(given.workers)] if given.workers else []
        if study in WALLS:
            tables[f"{study}-walls"] = first_table(_swept([*command, "--by", "wall_thickness_m"], given.out))
        page = _swept(command, given.out)
        tables[study] = first_table(page)
        if given.write:
            several = page.count("\n### ") > 1
            shutil.copyfile(given.out / PICTURES[not several], ROOT / "docs" / "images" / f"claims-{study}.png")
    tables["cost"] = cost(given.out / "results.csv")
    if given.write:
        PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), tables), encoding="utf-8")
    else:
        print("\n\n".join(f"## {name}\n\n{table}" for name, table in tables.items()))


def _swept(command: list[str], out: Path) -> str:
    """Run the command; the page of tables that it leaves."""
    print(" ".join(command), file=sys.stderr)
    subprocess.run([sys.executable, "-m", *command], check=True)
    return (out / "table.md").read_text(encoding="utf-8")


def first_table(page: str) -> str:
    """Of a sweep's table.md: the table of all recordings, or the one that there is, and what it took."""
    found = re.search(r"^\|.*?(?=\n(?!\|))", page, re.DOTALL | re.MULTILINE)
    assert found is not None, page
    rows = [[text.strip() for text in line.strip("|").split("|")] for line in found.group().splitlines()]
    kept = [k for k, name in enumerate(rows[0]) if name not in LEFT_OUT]
    lines = [f"| {' | '.join(row[k] for k in kept)} |" for row in rows]
    return "\n".join([*lines, "", f"{page.partition(chr(10))[0]}."])


def filled(page: str, tables: dict[str, str]) -> str:
    """The page with these tables between their marks."""
    for name, table in tables.items():
        before, mark, rest = page.partition(f"<!-- {name} -->\n")
        _, end, after = rest.partition("<!-- end -->")
        assert mark and end, f"{PAGE}: no <!-- {name} --> ... <!-- end -->"
        page = f"{before}{mark}{table}\n{end}{after}"
    return page


def cost(results: Path) -> str:
    """What all runs in the folder took, with which code."""
    with results.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    hours = sum(float(row["cell_s"] or 0) for row in rows) / 3600
    names = ("code", "python", "numpy", "scipy", "numba")
    versions = Counter(", ".join(f"{name} {row[name]}" for name in names) for row in rows)
    lines = [f"- {count:,} runs with {text}" for text, count in versions.items()]
    return "\n".join([f"{len(rows):,} runs, {hours:.1f} hours of one worker:", "", *lines])
