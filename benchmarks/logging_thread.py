"""Whether a thread that draws, encodes and writes would let the filter run on: against logging in the loop.

    python -m benchmarks logging_thread --recording 21 --data DIR --config paper

Only the time counts: in the thread, maps are drawn while the filter writes on in them, so that its file is of no use.
A real one would have to copy them first.
"""

import argparse
import tempfile
import threading
from pathlib import Path
from queue import Queue
from statistics import median
from time import perf_counter
from typing import Any

from benchmarks.case import load
from benchmarks.speed import add_case_options, case_of
from pfslam_viz.replay import Replay
from pfslam_viz.slam.kernels import warm_up

REPEATS = 3
QUEUED = 200  # scans that may wait to be logged


def main(arguments: list[str]) -> None:
    """Print the seconds of both ways, run in turns."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks logging_thread", description=__doc__.splitlines()[0])
    add_case_options(parser)
    recording, config = load(case_of(parser.parse_args(arguments)))
    warm_up()
    seconds: dict[str, list[float]] = {"in the loop": [], "in a thread": []}
    for _ in range(REPEATS):
        for way, measured in seconds.items():
            measured.append(run(recording, config, threaded=way == "in a thread"))
    print("| logging | median s | all s |", "| --- | ---: | --- |", sep="\n")
    for way, measured in seconds.items():
        print(f"| {way} | {median(measured):.1f} | {', '.join(f'{s:.1f}' for s in measured)} |")
    plain, threaded = (median(measured) for measured in seconds.values())
    print(f"\nthe loop takes {plain / threaded:.2f} x the thread's time")


def run(recording: Any, config: Any, threaded: bool) -> float:
    """Seconds of the whole loop with closing the file."""
    from pfslam_viz.viewer.sinks import open_sinks
    from pfslam_viz.viewer.stream import ReplayStream

    with tempfile.TemporaryDirectory() as folder:
        started = perf_counter()
        replay = Replay(recording, config)
        with open_sinks(save=Path(folder) / "out.rrd") as sink:
            stream = ReplayStream(recording, config, sink)
            if threaded:
                steps: Queue[Any] = Queue(QUEUED)
                logger = threading.Thread(target=lambda: [stream.log(step) for step in iter(steps.get, None)])
                logger.start()
                for step in replay:
                    steps.put(step)
                steps.put(None)
                logger.join()
            else:
                for step in replay:
                    stream.log(step)
            stream.finish(replay.result())
        return perf_counter() - started
