"""How fast one case is: ms a scan per phase, times real time, peak memory, file size.

python -m benchmarks speed --particles 500 --beams 1081 --cell 0.07
python -m benchmarks speed --recording 21 --data DIR --literal --command
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.case import ROOT, Case, measure


def main(arguments: list[str]) -> None:
    """Print a table for the case, and for the literal filter beside it where wished."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks speed", description=__doc__.splitlines()[0])
    add_case_options(parser)
    parser.add_argument("--particles", type=int)
    parser.add_argument("--beams", type=int)
    parser.add_argument("--cell", type=float, help="m")
    parser.add_argument("--no-log", action="store_true", help="the filter alone, without writing a recording")
    parser.add_argument("--literal", action="store_true", help="run the literal NumPy filter too")
    parser.add_argument("--command", action="store_true", help="time the whole `pfslam-viz replay --save` too")
    given = parser.parse_args(arguments)
    case = case_of(given, particles=given.particles, beams=given.beams, cell=given.cell, log=not given.no_log)
    numbers = measure(case)
    print(f"{given.recording}, {case.config}: {settings(numbers)}\n")
    print(table(numbers))
    if given.literal:
        literal = measure(replace(case, filter="literal"))
        print("\nliteral NumPy filter\n")
        print(table(literal))
        ours = sum(numbers["phases"][phase]["mean"] for phase in literal["phases"])
        print(f"\nratio of the phases both have: {sum(p['mean'] for p in literal['phases'].values()) / ours:.1f}")
    if given.command:
        print(f"\npfslam-viz replay --save, from start of the process to its end: {command_seconds(case):.1f} s")


def add_case_options(parser: argparse.ArgumentParser) -> None:
    """Which recording, which configuration."""
    parser.add_argument("--recording", default="demo")
    parser.add_argument("--data", help="folder of recordings")
    parser.add_argument("--config", default="paper")
    parser.add_argument("--start", type=int, default=0, help="first scan")
    parser.add_argument("--stop", type=int, help="scan to stop before")
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="SECTION.KEY=VALUE")


def case_of(given: argparse.Namespace, **more: Any) -> Case:
    """The case that the options of :func:`add_case_options` name."""
    data = str(Path(given.data).resolve()) if given.data else None
    path = Path(given.recording)  # the runs have another working directory
    recording = str(path.resolve()) if len(path.parts) > 1 else given.recording
    return Case(
        recording=recording,
        data=data,
        config=given.config,
        start=given.start,
        stop=given.stop,
        settings=tuple(given.settings),
        **more,
    )


def settings(numbers: dict[str, Any]) -> str:
    """What was run, in words."""
    return (
        f"{numbers['scans']:,} scans, {numbers['particles']:,} particles, {numbers['beams']:,} beams,"
        f" {numbers['cell']:g} m cells"
    )


def table(numbers: dict[str, Any]) -> str:
    """Markdown: a row for each phase, then the whole."""
    rows = ["| ms a scan | median | 95th percentile | mean |", "| --- | ---: | ---: | ---: |"]
    for name, phase in numbers["phases"].items():
        rows.append(f"| {name.replace('_', ' ')} | {phase['median']:.3f} | {phase['p95']:.3f} | {phase['mean']:.3f} |")
    rows.append(f"| all of it | | | {numbers['seconds'] / numbers['scans'] * 1e3:.3f} |")
    whole = (
        f"\n{numbers['seconds']:.2f} s, {numbers['scans'] / numbers['seconds']:,.0f} scans/s,"
        f" {numbers['real_time']:.1f}x real time, peak memory {numbers['peak_mb']:,.0f} MB"
    )
    if numbers["file_mb"] is not None:
        whole += f", file {numbers['file_mb']:.1f} MB"
    return "\n".join(rows) + "\n" + whole


def replay_command(case: Case, path: Path) -> list[str]:
    """The command line that replays the case into ``path``."""
    command = [sys.executable, "-m", "pfslam_viz", "replay", case.recording, "--config", case.config, "--quiet"]
    command += ["--save", str(path)]
    command += ["--data", case.data] if case.data else []
    command += ["--start", str(case.start)] if case.start else []
    command += ["--stop", str(case.stop)] if case.stop else []
    return command + [word for setting in case.all_settings() for word in ("--set", setting)]


def command_seconds(case: Case) -> float:
    """Seconds that the whole command takes, interpreter and imports included."""
    with tempfile.TemporaryDirectory() as folder:
        command = replay_command(case, Path(folder) / "out.rrd")
        started = perf_counter()
        subprocess.run(command, cwd=ROOT, check=True)
        return perf_counter() - started
