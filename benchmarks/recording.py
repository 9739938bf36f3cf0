"""What a recording costs in the viewer: its size, opening it, seeking in it, the viewer's memory.

    python -m benchmarks recording --recording 21 --data DIR --config default

The viewer runs headless, as set up by benchmarks/headless.py; a seek is measured until the moment is painted, and
compared with the same in a recording that holds one empty view.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.case import ROOT
from benchmarks.headless import headless_viewer
from benchmarks.speed import add_case_options, case_of, replay_command

SEEKS = 15


def main(arguments: list[str]) -> None:
    """Replay into a file (or take one) and print what it costs."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks recording", description=__doc__.splitlines()[0])
    add_case_options(parser)
    parser.add_argument("--rrd", type=Path, help="measure this file instead of making one")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        path = given.rrd or Path(folder) / "out.rrd"
        if given.rrd is None:
            subprocess.run(replay_command(case_of(given), path), cwd=ROOT, check=True)
        empty = Path(folder) / "empty.rrd"
        steps = last_step(path)
        write_empty(empty, steps)
        print("| | this recording | an empty view |", "| --- | ---: | ---: |", sep="\n")
        (full, nothing) = (measure(p, steps) for p in (path, empty))
    for name, unit in (("file", "MB"), ("opening", "s"), ("seek, median", "ms"), ("seek, longest", "ms")):
        print(f"| {name} | {full[name]:.4g} {unit} | {nothing[name]:.4g} {unit} |")
    for name in ("viewer's memory", "viewer's peak memory"):
        print(f"| {name} | {full[name]:,.0f} MB | {nothing[name]:,.0f} MB |")
    print(f"\n{steps + 1:,} steps; a seek takes {full['seek, median'] / nothing['seek, median']:.2f} x an empty view's")


def measure(path: Path, steps: int) -> dict[str, float]:
    """Open the recording in a fresh viewer and seek to and fro."""
    with headless_viewer() as viewer:
        opening = viewer.open(path)
        viewer.seek(steps)
        places = [(k * 7919) % SEEKS * steps // SEEKS for k in range(SEEKS)]  # all over the place, each once
        seeks = [1e3 * viewer.seek(step) for step in places]
        if reports := viewer.reports():
            print(f"{path.name}: the views report {reports}", file=sys.stderr)
        memory = viewer.memory_mb()
    return {
        "file": path.stat().st_size / 1e6,
        "opening": opening,
        "seek, median": median(seeks),
        "seek, longest": max(seeks),
        "viewer's memory": memory["now"],
        "viewer's peak memory": memory["peak"],
    }


def last_step(path: Path) -> int:
    """The last step that anything is logged at."""
    from rerun.chunk import RrdReader

    last = 0
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if "step" in batch.schema.names and batch.num_rows:
            last = max(last, *(value for value in batch.column("step").to_pylist() if value is not None))
    return last


def write_empty(path: Path, steps: int) -> None:
    """A recording of as many steps with one empty 2-D view."""
    import rerun as rr
    import rerun.blueprint as rrb

    recording = rr.RecordingStream("empty")
    layout = rrb.Blueprint(rrb.Spatial2DView(origin="/nothing"), rrb.TimePanel(timeline="step"))
    recording.save(path, default_blueprint=layout)
    recording.send_columns(
        "/elsewhere",
        [rr.TimeColumn("step", sequence=range(steps + 1))],
        rr.Scalars.columns(scalars=[0.0] * (steps + 1)),
    )
    recording.disconnect()
