"""What a sweep costs over the bare runs, and what a second worker brings.

python -m benchmarks sweep --recording demo --cells 40

The same cells: one after another in one process, in two processes that share them, and as a sweep with one worker and
with two, from the start of the cluster to results.parquet. Bare processes have loaded kernels and the recording before
the clock starts, workers after it: what that takes is measured by sweeps of one cell a worker. Two bare processes show
what this machine's cores can do at all. The CPU's seconds are less disturbed by what else runs than the clock's;
with --repeat the smallest of each is kept.
"""

import argparse
import multiprocessing
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from time import perf_counter, process_time
from typing import Any, NamedTuple

from pfslam_viz.recordings.catalog import find
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.sweep.engine import open_cluster, run_cells
from pfslam_viz.sweep.plan import Block, Cell, Plan, make_plan
from pfslam_viz.sweep.results import Results
from pfslam_viz.sweep.version import code_version
from pfslam_viz.sweep.worker import Answer, Order, content, fingerprint, run_order

PROCESSES = (1, 2)


class Cost(NamedTuple):
    """Seconds of the clock, and of the CPU in all processes together."""

    clock: float
    cpu: float


class Study(NamedTuple):
    """One recording's cells, which differ in the seed alone."""

    plan: Plan
    recording: Recording
    digest: str
    cells: list[Cell]

    def orders(self) -> list[Order]:
        """As a worker has them."""
        choice = self.plan.recordings[0][1]
        return [
            Order(cell.id, self.digest, choice, cell.config.model_dump(mode="json"), code_version())
            for cell in self.cells
        ]


def main(arguments: list[str]) -> None:
    """Print seconds and ratios."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks sweep", description=__doc__)
    parser.add_argument("--recording", default="demo")
    parser.add_argument("--data", type=Path, default=None)
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--config", default="paper", help="with settings, if wished: paper,particles=100")
    parser.add_argument("--repeat", type=int, default=1)
    given = parser.parse_args(arguments)
    choice = RecordingChoice(str(find(given.recording, given.data, make_demo=True).chosen_by.resolve()))
    recording = content(choice.load())
    plan = make_plan([("it", choice)], [Block((given.config,))], range(given.cells))
    digest = fingerprint(recording)
    study = Study(plan, recording, digest, plan.cells({"it": digest}))
    run_order(study.orders()[0])  # compiles, if need be
    runs = [_measure(study) for _ in range(given.repeat)]
    costs = {name: Cost(min(run[name].clock for run in runs), min(run[name].cpu for run in runs)) for name in runs[0]}
    print(f"{given.cells} cells of {given.recording}, {given.config}; the smallest of {given.repeat}\n")
    print("| | s | CPU s | s ÷ bare | CPU ÷ bare | s ÷ with one |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for name, cost in costs.items():
        kind, n, few = name
        bare, one = costs["bare", n, False], costs[kind, 1, few]
        words = f"{kind}, {n} process{'es' * (n > 1)}" + f", {n} cell{'s' * (n > 1)} alone" * few
        ratios = "| |" if few else f"{cost.clock / bare.clock:.2f} | {cost.cpu / bare.cpu:.2f} |"
        print(f"| {words} | {cost.clock:.1f} | {cost.cpu:.1f} | {ratios} {cost.clock / one.clock:.2f} |")
    print()
    for n in PROCESSES:
        bare, all_of_it, start = costs["bare", n, False], costs["sweep", n, False], costs["sweep", n, True]
        cell = bare.cpu / given.cells
        each = (all_of_it.cpu - start.cpu) / (given.cells - n)
        print(
            f"With {n}: start and end {start.cpu - n * cell:.1f} CPU s; a bare cell {cell:.3f} CPU s, a cell of the"
            f" sweep {each:.3f}: {each / cell:.3f} of it."
        )
    print("Load average (processes that wanted a core) at the end: " + ", ".join(f"{x:.1f}" for x in os.getloadavg()))


def _measure(study: Study) -> dict[tuple[str, int, bool], Cost]:
    """Kind, processes, and whether it was one cell a process."""
    costs = {("bare", n, False): _bare(study.orders(), n) for n in PROCESSES}
    for n in PROCESSES:
        costs["sweep", n, True] = _swept(study, study.cells[:n], n)
        costs["sweep", n, False] = _swept(study, study.cells, n)
    return costs


def _swept(study: Study, cells: Sequence[Cell], workers: int) -> Cost:
    """As the command does it, without reading, estimating, plots and the viewer's file."""
    started, busy = perf_counter(), _cpu()
    with tempfile.TemporaryDirectory() as folder:
        results = Results(Path(folder), study.plan.keys)
        results.start(cells, None)

        def on_answer(cell: Cell, answer: Answer) -> None:
            assert answer.error is None, answer.error
            results.add(cell, answer.row, answer.trace)

        with open_cluster(None, workers) as client:
            places, recordings = dict(study.plan.recordings), {"it": study.recording}
            run_cells(client, cells, places, recordings, {"it": study.digest}, on_answer)
        results.finish(cells)
        assert len(results.rows) == len(cells)
    return Cost(perf_counter() - started, _cpu() - busy)


def _cpu() -> float:
    """Seconds of the CPU that this process and its ended children have used."""
    return sum(u.ru_utime + u.ru_stime for u in (getrusage(RUSAGE_SELF), getrusage(RUSAGE_CHILDREN)))


def _bare(orders: list[Order], processes: int) -> Cost:
    """All orders in so many processes, which are ready before the clock starts."""
    context = multiprocessing.get_context("spawn")
    ready, go = context.Barrier(processes + 1), context.Barrier(processes + 1)
    spent: Any = context.Queue()
    shares = [orders[k::processes] for k in range(processes)]
    running: list[Any] = [context.Process(target=_share, args=(share, ready, go, spent)) for share in shares]
    for process in running:
        process.start()
    ready.wait()
    started = perf_counter()
    go.wait()
    busy = sum(spent.get() for _ in running)
    total = perf_counter() - started
    for process in running:
        process.join()
    return Cost(total, busy)


def _share(orders: list[Order], ready: Any, go: Any, spent: Any) -> None:
    run_order(orders[0])
    ready.wait()
    go.wait()
    before = process_time()
    for order in orders:
        assert run_order(order).error is None
    spent.put(process_time() - before)
