"""Where drawing, encoding and writing cost least: in the filter's loop, or in a thread beside it.

python -m benchmarks logging --recording 21 --data DIR --config paper
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

from benchmarks.case import ROOT, Case, load
from benchmarks.speed import add_case_options, case_of

REPEATS = 5
WAYS = ("loop", "thread")


def main(arguments: list[str]) -> None:
    """Print the seconds of whole runs, from start of the process to its end, run in turns."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks logging", description=__doc__.splitlines()[0])
    add_case_options(parser)
    parser.add_argument("--way", choices=WAYS, help="run in this way once, without a word")
    given = parser.parse_args(arguments)
    if given.way is not None:
        run(case_of(given), given.way)
        return
    seconds: dict[str, list[float]] = {way: [] for way in WAYS}
    for _ in range(REPEATS):
        for way, measured in seconds.items():
            started = perf_counter()
            subprocess.run([sys.executable, "-m", "benchmarks.logging", *arguments, "--way", way], cwd=ROOT, check=True)
            measured.append(perf_counter() - started)
    plain = median(seconds["loop"])
    print("| drawn in | median s | of the loop's | all s |", "| --- | ---: | ---: | --- |", sep="\n")
    for way, measured in seconds.items():
        shown = ", ".join(f"{s:.1f}" for s in measured)
        print(f"| the {way} | {median(measured):.1f} | {median(measured) / plain:.2f} | {shown} |")


def run(case: Case, way: str) -> None:
    """What ``pfslam-viz replay --save`` does, but for where it draws."""
    from pfslam_viz.compiling.compile import compile_all
    from pfslam_viz.compiling.needed import needed
    from pfslam_viz.replay import Replay
    from pfslam_viz.viewer.sinks import open_sinks
    from pfslam_viz.viewer.stream import replay_stream

    recording, config = load(case)
    compile_all(needed([config], viewer=True, texture=recording.frames is not None))
    with (
        tempfile.TemporaryDirectory() as folder,
        open_sinks(save=Path(folder) / "x.rrd") as sink,
        ThreadPoolExecutor(1) as thread,
    ):
        stream = replay_stream(recording, config, sink)
        if way == "thread":
            stream._drawing = ThreadedDrawing(stream._drawing, thread)  # type: ignore[assignment]
        replay = Replay(recording, config)
        for step in replay:
            stream.log(step)
        stream.finish(replay.result())


class ThreadedDrawing:
    """Hands everything to a thread."""

    def __init__(self, drawing: Any, thread: ThreadPoolExecutor) -> None:
        self.sink, self._drawing, self._thread = drawing.sink, drawing, thread

    def draw(self, block: Any, pictures: Sequence[Any]) -> None:
        """Return at once."""
        self._thread.submit(self._drawing.draw, block, pictures)

    def finish(self, framing: Any, left_out: Sequence[str]) -> None:
        """Return when everything is drawn."""
        self._thread.submit(self._drawing.finish, framing, left_out).result()


if __name__ == "__main__":
    main(sys.argv[1:])
