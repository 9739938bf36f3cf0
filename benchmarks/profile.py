"""What a whole `pfslam-viz replay --save` spends on what: processor time of all threads, and the clock's.

python -m benchmarks profile --recording 21 --data DIR --config paper
"""

import argparse
import builtins
import importlib
import json
import resource
import subprocess
import sys
import tempfile
import threading
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from pathlib import Path
from statistics import median
from time import perf_counter, thread_time
from typing import Any

from benchmarks.case import ROOT
from benchmarks.speed import add_case_options, case_of, replay_command


def _of(owner: str, names: str) -> tuple[str, ...]:
    return tuple(f"{owner}{name}" for name in names.split())


PARTS = {
    "imports": (),
    "loading the recording": ("recordings.catalog:load_recording",),
    "loading kernels": ("compiling.compile:Compiling.prepare",),
    "filter": (
        "slam.scan_reader:ScanReader.read",
        *_of("slam.paper.particle_filter:ParticleFilter.", "predict update update_map resample"),
        *_of("slam.rbpf.rao_blackwellized:RaoBlackwellizedFilter.", "predict update update_map resample revise finish"),
    ),
    "dead reckoning's map": ("slam.background_grid:BackgroundGrid.add",),
    "decoding images": ("recordings.images:read_image",),
    "painting the floor": _of("texture.painter:TexturePainter.", "add_pose finish repaint"),
    "columns and pictures": ("viewer.stream:replay_stream", *_of("viewer.stream:ReplayStream.", "log finish _close")),
    "Rerun's encoder and the disk": _of("viewer.sinks:Sink.", "send_columns log_static send_blueprint push"),
    "closing the file": ("viewer.sinks:Sink._close",),
}
"""What is told apart, and whose calls it is, ``module:function`` within the package; a call within a call counts once.

What another thread does counts as what asked for it.
"""
REST = "the rest"  # Rerun's own threads, the loop, start and end of the interpreter


class Meter:
    """Seconds by part: ``processor`` of all threads of Python's, ``wall`` of the main one."""

    def __init__(self) -> None:
        self.processor: dict[str, float] = defaultdict(float)
        self.wall: dict[str, float] = defaultdict(float)
        self._lock, self._of = threading.Lock(), threading.local()

    def current(self) -> str | None:
        """The part that this thread is at."""
        stack = getattr(self._of, "stack", [])
        return stack[-1] if stack else None

    def within(self, part: str | None, call: Callable[[], Any]) -> Any:
        """What ``call`` returns; its time is the part's, but for that of parts within it."""
        if part is None or part == self.current():
            return call()
        stack = self._of.__dict__.setdefault("stack", [])
        self._lap()
        stack.append(part)
        try:
            return call()
        finally:
            self._lap()
            stack.pop()

    def _lap(self) -> None:
        """What passed since this thread last began or ended a part goes to the one that it is at."""
        now = thread_time(), perf_counter()
        part, since = self.current(), getattr(self._of, "since", now)
        self._of.since = now
        if part is not None:
            with self._lock:
                self.processor[part] += now[0] - since[0]
                if threading.current_thread() is threading.main_thread():
                    self.wall[part] += now[1] - since[1]


def main(arguments: list[str]) -> None:
    """Print a row for each part, of several runs the median."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks profile", description=__doc__.splitlines()[0])
    add_case_options(parser)
    parser.add_argument("--repeat", type=int, default=3, help="runs")
    given = parser.parse_args(arguments)
    case = case_of(given)
    with tempfile.TemporaryDirectory() as folder:
        command = replay_command(case, Path(folder) / "out.rrd")
        subprocess.run(command, cwd=ROOT, check=True)  # kernels are compiled, files are in memory
        runs = [_run(command[3:], Path(folder) / "parts.json") for _ in range(given.repeat)]
    print(f"{given.recording}, {case.config}, the median of {len(runs)} runs\n")
    print(table(runs))


Parts = dict[str, tuple[float, float]]
"""Seconds of processor and of the clock, by part; ``all of it`` has the whole process."""


def table(runs: list[Parts]) -> str:
    """Markdown: a row for each part, then the whole."""
    rows = ["| | processor s | s |", "| --- | ---: | ---: |"]
    for part in runs[0]:
        processor, wall = (median(run[part][k] for run in runs) for k in range(2))
        rows.append(f"| {part} | {processor:.2f} | {wall:.2f} |")
    return "\n".join(rows)


def _run(words: list[str], out: Path) -> Parts:
    """One run in a process of its own."""
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    command = [sys.executable, "-m", "benchmarks.profile", str(out), *words]
    subprocess.run(command, cwd=ROOT, check=True)
    wall, after = perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return whole(json.loads(out.read_text()), processor, wall)


def whole(found: dict[str, list[float]], processor: float, wall: float) -> Parts:
    """The parts in order, what the whole process took beyond them, and that itself."""
    parts: Parts = {part: (found[part][0], found[part][1]) for part in PARTS if part in found}
    sums = [sum(seconds[k] for seconds in parts.values()) for k in range(2)]
    return {**parts, REST: (processor - sums[0], wall - sums[1]), "all of it": (processor, wall)}


def _within(out: Path, words: list[str]) -> None:
    """Run the command in this process, measured, and write what was found."""
    meter = Meter()
    _measure_imports(meter)
    cli = importlib.import_module("pfslam_viz.cli")
    config = words[words.index("--config") + 1]
    for part, names in PARTS.items():
        for name in names:
            if ("slam.paper" not in name and "slam.rbpf" not in name) or ("slam.paper" in name) == (config == "paper"):
                _measure(meter, part, name)
    _measure_threads(meter)
    sys.argv[1:] = words
    try:
        cli.main()
    finally:
        out.write_text(json.dumps({part: [meter.processor[part], meter.wall[part]] for part in meter.processor}))


def _measure_imports(meter: Meter) -> None:
    for module, name in ((builtins, "__import__"), (importlib, "import_module")):
        setattr(module, name, _measured(meter, "imports", getattr(module, name)))


def _measure(meter: Meter, part: str, name: str) -> None:
    """Have a function or method measured, wherever it was imported."""
    module, _, path = name.partition(":")
    owner: Any = importlib.import_module(f"pfslam_viz.{module}")
    *classes, last = path.split(".")
    for each in classes:
        owner = getattr(owner, each)
    own = getattr(owner, last)
    measured = _measured(meter, part, own)
    owners = [owner] if classes else [one for key, one in sys.modules.items() if key.startswith("pfslam_viz")]
    for one in owners:
        if getattr(one, last, None) is own:
            setattr(one, last, measured)


def _measured(meter: Meter, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def measured(*arguments: Any, **named: Any) -> Any:
        return meter.within(part, lambda: function(*arguments, **named))

    return measured


def _measure_threads(meter: Meter) -> None:
    """What other threads do for a part is its own."""
    worker: Any = importlib.import_module("pfslam_viz.slam.worker")
    submit: Any = ThreadPoolExecutor.submit
    begin = worker.Task.__init__

    def of_this(work: Callable[..., Any]) -> Callable[..., Any]:
        part = meter.current()
        return lambda *arguments, **named: meter.within(part, lambda: work(*arguments, **named))

    def init(self: Any, work: Callable[[], Any]) -> None:
        begin(self, of_this(work))

    def submitted(self: Any, work: Callable[..., Any], /, *arguments: Any, **named: Any) -> Any:
        return submit(self, of_this(work), *arguments, **named)

    worker.Task.__init__ = init
    executor: Any = ThreadPoolExecutor
    executor.submit = submitted


if __name__ == "__main__":
    _within(Path(sys.argv[1]), sys.argv[2:])
