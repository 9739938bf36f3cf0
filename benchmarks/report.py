"""All benchmarks one after the other, as benchmarks/README.md.

python -m benchmarks report --data DIR --write

DIR holds ``twin21/`` (a set 21 with known truth) and ``carmen/`` (the log intel); without it only ``demo`` is measured.
Takes some ten minutes; the machine should have nothing else to do.
"""

import argparse
import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path

from benchmarks import machine
from benchmarks.case import ROOT

INTRODUCTION = """\
# Benchmarks

Every table below is printed by the command above it, and all of them by `python -m benchmarks report --data DIR
--write`, which wrote this file. `DIR` holds `twin21/`, a set 21 with simulated walls and known truth, and `carmen/`,
the public logs; `demo` needs nothing. No test asserts a time.

Measured on
"""
README = ROOT / "benchmarks" / "README.md"
REMARKS = re.compile("<!-- remarks -->.*<!-- end of remarks -->\n", re.DOTALL)
KERNELS = "python -m pytest benchmarks/test_kernels.py -o addopts="


def main(arguments: list[str]) -> None:
    """Print the report, or write it to benchmarks/README.md."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks report", description=__doc__)
    parser.add_argument("--data", type=Path, help="folder that holds twin21/ and carmen/")
    parser.add_argument("--write", action="store_true", help="write benchmarks/README.md")
    given = parser.parse_args(arguments)
    parts = [INTRODUCTION + "\n```\n" + machine.describe() + "\n```\n", _remarks()]
    for title, text, command in sections(given.data):
        print(f"{title}: python -m benchmarks {command}", file=sys.stderr)
        shown = f"python -m benchmarks {command}" if command else KERNELS
        printed = _run(command, given.data) if command else _kernels()
        parts.append(f"## {title}\n\n{text}\n\n```bash\n{shown}\n```\n\n{printed}")
    report = "\n".join(parts)
    if given.write:
        README.write_text(report, encoding="utf-8")
    else:
        print(report)


def sections(data: Path | None) -> Iterator[tuple[str, str, str]]:
    """Title, introduction and arguments of each; no arguments for the kernels."""
    twin, log = "--recording 21 --data DIR/twin21", "--recording intel --data DIR/carmen"
    where = twin if data else "--recording demo"
    yield (
        "The paper's filter",
        "500 particles, every beam, 0.07 m cells, both maps, and everything logged to a file; beside it the literal"
        " NumPy filter of `literal_filter.py`. `dead reckoning` is its own map; `log` is what the run has to wait for.",
        f"speed {where} --config paper --literal --command",
    )
    yield (
        "The same without logging",
        "The filter and both maps alone.",
        f"speed {where} --config paper --no-log --set texture.enabled=false",
    )
    yield "The default filter", "", f"speed {where} --config default --command"
    if data:
        yield "The default filter on a log", "", f"speed {log} --config carmen --no-log"
    yield (
        "Where to draw",
        "Making Rerun's columns of what the filter's loop gathered, encoding and writing, in that loop or in a thread"
        " beside it: whole runs with `--save`, from start to end. Rerun's own threads compress and write in either"
        " case; what is left holds the interpreter's lock. Drawing stays in the loop, the simpler way.",
        f"logging {where} --config paper",
    )
    yield (
        "Scaling",
        "One number of the paper's settings at a time; the filter and both maps without logging, over 600 scans. `MB`"
        " is the peak of the process, `ratio` the literal filter's sum over ours.",
        f"scaling {where} --start 1000 --stop 1600",
    )
    yield (
        "Memory",
        "Peak resident memory of a process that replays with `--save`: whole recording against its first quarter.",
        f"memory {log if data else '--recording demo'} --config paper",
    )
    for config in ("paper", "default"):
        yield (
            f"The recording in the viewer, {config}",
            "File size; opening and seeking until painted, in Rerun's viewer without a screen, 1,600 x 900, drawn by a"
            " software renderer: compare with the empty view, not with a GPU.",
            f"recording {where} --config {config}",
        )
    yield "Start-up", "", "startup"
    yield "Kernels", "At the paper's size, beside plain NumPy.", ""


def _remarks() -> str:
    """What somebody wrote of the machine; it stays when the report is written anew, to be read again then."""
    found = REMARKS.search(README.read_text(encoding="utf-8"))
    return found[0] if found else ""


def _run(command: str, data: Path | None) -> str:
    name, *arguments = shlex.split(command.replace("DIR", str(data)))
    printed = StringIO()
    with redirect_stdout(printed):
        import_module(f"benchmarks.{name}").main(arguments)
    return printed.getvalue().replace(str(data), "DIR")


def _kernels() -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "kernels.json"
        command = [sys.executable, *shlex.split(KERNELS)[1:], "-q", f"--benchmark-json={path}"]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
        measured = json.loads(path.read_text())["benchmarks"]
    rows = ["| | kernel | median ms | interquartile range ms |", "| --- | --- | ---: | ---: |"]
    for row in sorted(measured, key=lambda row: (row["group"], row["stats"]["median"])):
        stats = row["stats"]
        name = row["name"].removeprefix("test_")
        rows.append(f"| {row['group']} | {name} | {1e3 * stats['median']:.3f} | {1e3 * stats['iqr']:.3f} |")
    return "\n".join(rows) + "\n"
