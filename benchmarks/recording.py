"""What a recording costs in the viewer: its size, opening it, seeking in it, the viewer's memory.

    python -m benchmarks recording --recording 21 --data DIR --config default

The viewer runs without a window; a seek is measured until the moment is painted, and
compared with the same in a recording that holds one empty view.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.case import ROOT
from benchmarks.speed import add_case_options, case_of, replay_command
from pfslam_viz.viewer.headless import headless_viewer

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
        full = measure(path)
        write_empty(empty, int(full["steps"]))
        nothing = measure(empty)
        print("| | this recording | an empty view |", "| --- | ---: | ---: |", sep="\n")
    for name, unit in (("file", "MB"), ("opening", "s"), ("seek, median", "ms"), ("seek, longest", "ms")):
        print(f"| {name} | {full[name]:.4g} {unit} | {nothing[name]:.4g} {unit} |")
    for name in ("viewer's memory", "viewer's peak memory"):
        print(f"| {name} | {full[name]:,.0f} MB | {nothing[name]:,.0f} MB |")
    ratio = full["seek, median"] / nothing["seek, median"]
    print(f"\n{full['steps']:,.0f} steps; a seek takes {ratio:.2f} x an empty view's")


def measure(path: Path) -> dict[str, float]:
    """Open the recording in a fresh viewer and seek to and fro."""
    with headless_viewer() as viewer:
        opening = viewer.open(path)
        steps = viewer.last_step()
        viewer.seek(steps)
        places = [(k * 7919) % SEEKS * steps // SEEKS for k in range(SEEKS)]  # all over the place, each once
        seeks = [1e3 * viewer.seek(step) for step in places]
        if reports := viewer.reports():
            print(f"{path.name}: the views report {reports}", file=sys.stderr)
        memory = resident_mb(viewer.process.pid)
    return {
        "file": path.stat().st_size / 1e6,
        "steps": steps + 1,
        "opening": opening,
        "seek, median": median(seeks),
        "seek, longest": max(seeks),
        **memory,
    }


def resident_mb(pid: int) -> dict[str, float]:
    """A process's memory now and at its peak, from Linux's /proc."""
    status = Path(f"/proc/{pid}/status").read_text()
    values = {line.split(":")[0]: line.split()[1] for line in status.splitlines() if line.startswith("Vm")}
    return {
        "viewer's memory": int(values["VmRSS"]) * 1024 / 1e6,
        "viewer's peak memory": int(values["VmHWM"]) * 1024 / 1e6,
    }


def write_empty(path: Path, steps: int) -> None:
    """A recording of as many steps with one empty 2-D view."""
    import rerun as rr
    import rerun.blueprint as rrb

    recording = rr.RecordingStream("empty")
    layout = rrb.Blueprint(rrb.Spatial2DView(origin="/nothing"), rrb.TimePanel(timeline="step"))
    recording.save(path, default_blueprint=layout)
    recording.send_columns(
        "/elsewhere",
        [rr.TimeColumn("step", sequence=range(steps))],
        rr.Scalars.columns(scalars=[0.0] * steps),
    )
    recording.disconnect()
