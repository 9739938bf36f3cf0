"""What a sweep costs over the bare runs, and what a second worker brings.

python -m benchmarks sweep --recording demo --cells 40

The same cells four times: one after another in one process, in two processes that share them, and through the sweep's
engine with one worker and with two, cluster start and stop included. Two bare processes show what this machine's two
cores can do at all, and the CPU's seconds are less disturbed by what else runs. All processes have loaded their kernels
and the recording before the clock starts, the engine's workers after it.
"""

import argparse
import multiprocessing
from pathlib import Path
from resource import RUSAGE_CHILDREN, RUSAGE_SELF, getrusage
from time import perf_counter, process_time
from typing import Any

from pfslam_viz.recordings.catalog import find
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.sweep.engine import open_cluster, run_cells
from pfslam_viz.sweep.plan import Block, Cell, make_plan
from pfslam_viz.sweep.version import code_version
from pfslam_viz.sweep.worker import Answer, Order, content, fingerprint, run_order


def main(arguments: list[str]) -> None:
    """Print seconds and ratios."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks sweep", description=__doc__)
    parser.add_argument("--recording", default="demo")
    parser.add_argument("--data", type=Path, default=None)
    parser.add_argument("--cells", type=int, default=40)
    parser.add_argument("--particles", default="500")
    given = parser.parse_args(arguments)
    path = find(given.recording, given.data, make_demo=True).chosen_by.resolve()
    choice = RecordingChoice(str(path))
    recording = content(choice.load())
    plan = make_plan([("it", choice)], [Block(("paper",), (("particles", (given.particles,)),))], range(given.cells))
    digest = fingerprint(recording)
    cells = plan.cells({"it": digest})
    orders = [Order(cell.id, digest, choice, cell.config.model_dump(mode="json"), code_version()) for cell in cells]
    run_order(orders[0])
    seconds = {"bare, one process": _bare(orders, 1), "bare, two processes": _bare(orders, 2)}
    for workers in (1, 2):
        answers: list[Answer] = []

        def on_answer(cell: Cell, answer: Answer, answers: list[Answer] = answers) -> None:
            answers.append(answer)

        started, busy = perf_counter(), _cpu()
        with open_cluster(None, workers) as client:
            run_cells(client, cells, {"it": choice}, {"it": recording}, {"it": digest}, on_answer)
        seconds[f"sweep, {workers} worker{'s' * (workers > 1)}"] = perf_counter() - started, _cpu() - busy
        assert len(answers) == len(cells) and not any(answer.error for answer in answers)
    print(f"{given.cells} cells of {given.recording}, {given.particles} particles\n")
    print("| | s | CPU s | CPU ÷ bare, as many processes | s ÷ bare | s ÷ one |")
    print("| --- | ---: | ---: | ---: | ---: | ---: |")
    for k, (name, (total, busy)) in enumerate(seconds.items()):
        bare, one = (list(seconds.values())[at] for at in (k % 2, k - k % 2))
        ratios = f"{busy / bare[1]:.2f} | {total / bare[0]:.2f} | {total / one[0]:.2f}"
        print(f"| {name} | {total:.1f} | {busy:.1f} | {ratios} |")


def _cpu() -> float:
    """Seconds of the CPU that this process and its ended children have used."""
    return sum(u.ru_utime + u.ru_stime for u in (getrusage(RUSAGE_SELF), getrusage(RUSAGE_CHILDREN)))


def _bare(orders: list[Order], processes: int) -> tuple[float, float]:
    """Seconds for all orders in so many processes, which are ready before the clock starts; and the CPU's, in them."""
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
    return total, busy


def _share(orders: list[Order], ready: Any, go: Any, spent: Any) -> None:
    run_order(orders[0])
    ready.wait()
    go.wait()
    before = process_time()
    for order in orders:
        assert run_order(order).error is None
    spent.put(process_time() - before)
