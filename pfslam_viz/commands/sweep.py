"""``pfslam-viz sweep``: many runs, on this machine or on a Dask cluster."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from pfslam_viz import console
from pfslam_viz.commands.choices import RecordingChoice
from pfslam_viz.commands.interrupt import Interrupted, stop_on_interrupt
from pfslam_viz.commands.progress import kernels
from pfslam_viz.commands.replay import read
from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.files import replaced
from pfslam_viz.recordings.catalog import find
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.slam.worker import cores
from pfslam_viz.sweep.engine import open_cluster, require_distributed, run_cells
from pfslam_viz.sweep.estimate import estimate_seconds
from pfslam_viz.sweep.extremes import extremes
from pfslam_viz.sweep.page import require_matplotlib, write_page
from pfslam_viz.sweep.plan import Block, Cell, Plan, make_plan, parse_values
from pfslam_viz.sweep.plan_file import PlanFile, read_plan_file
from pfslam_viz.sweep.results import Results
from pfslam_viz.sweep.row import provenance
from pfslam_viz.sweep.summary import Ranking, check_column, cost, markdown_page, rankings, table
from pfslam_viz.sweep.version import code_version
from pfslam_viz.sweep.worker import Answer, content, fingerprint


@dataclass(frozen=True, slots=True)
class SweepChoice:
    """What is run, where, and what is made of it; None leaves it to the plan file or to the default."""

    configs: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    seeds: int | None = None
    plan: Path | None = None
    by: str | None = None
    scheduler: str | None = None
    workers: int | None = None
    redo_old: bool | None = None
    viewer: bool = True


def run(names: Sequence[str], recording: RecordingChoice, choice: SweepChoice, out: Path, quiet: bool) -> None:
    """Run what is missing in ``out``, then show what was found. ``recording`` says how all recordings are read."""
    require_distributed()
    file = PlanFile() if choice.plan is None else read_plan_file(choice.plan)
    by = choice.by or file.by
    check_column(by)
    if choice.scheduler is not None and choice.workers is not None:
        raise InputError("--workers is for a cluster on this machine; --scheduler has workers of its own")
    plan = _plan(names, recording, choice, file)
    results = Results(out, plan.keys)
    several = len(plan.recordings) > 1
    recordings = {label: content(read(place, quiet, label if several else "")) for label, place in plan.recordings}
    digests = {label: fingerprint(found) for label, found in recordings.items()}
    cells = plan.cells(digests)
    code = _code_to_keep(results, cells, choice.redo_old)
    missing = results.start(cells, code)
    if missing:
        _run(plan, missing, recordings, digests, results, choice, quiet)
    elif not quiet:
        console.tell(f"{plan.in_words}; all of them are done")
    results.finish(cells)
    _show(plan, cells, results, by, choice.viewer, quiet)
    failed = [row for row in results.of(cells) if row["error"]]
    if failed:
        raise PfslamError(
            f"{len(failed)} of {plan.count} runs failed, such as {failed[0]['recording']} with seed"
            f" {failed[0]['seed']}: {failed[0]['error']}; the same command tries them again"
        )


def _plan(names: Sequence[str], recording: RecordingChoice, choice: SweepChoice, file: PlanFile) -> Plan:
    """What the command line says, and what the file says where the command line does not."""
    blocks = file.blocks
    if choice.configs or choice.settings or not blocks:
        configs = choice.configs or (blocks[0].configs if len(blocks) == 1 else ("default",))
        blocks = [Block(tuple(configs), parse_values(choice.settings))]
    seeds = choice.seeds if choice.seeds is not None else file.seeds if file.seeds is not None else 1
    places = []
    for name in names or file.recordings:
        found = find(name, recording.data, make_demo=True).chosen_by.resolve()
        robot = recording.robot
        if robot is not None and Path(robot).is_file():
            robot = str(Path(robot).resolve())
        places.append((name, replace(recording, name=str(found), data=None, robot=robot)))
    if not places:
        raise InputError('name a recording, or list them in the plan\'s file: recordings = ["demo"]')
    return make_plan(places, blocks, range(seeds) if isinstance(seeds, int) else seeds)


def _code_to_keep(results: Results, cells: Sequence[Cell], redo_old: bool | None) -> str | None:
    """The version whose rows are kept, or None for all. Raises InputError where the user has to say."""
    others = results.other_code(cells, code_version())
    if not others or redo_old:
        return code_version()
    if redo_old is None:
        told = ", ".join(f"{count} of {code}" for code, count in others.items())
        raise InputError(
            f"{results.csv}: has runs of other code ({told}; this is {code_version()}): pass --redo-old to run them"
            " anew, --keep-old to keep them, or another --out"
        )
    return None


def _run(
    plan: Plan,
    missing: Sequence[Cell],
    recordings: dict[str, Recording],
    digests: dict[str, str],
    results: Results,
    choice: SweepChoice,
    quiet: bool,
) -> None:
    """Run the missing cells, each into its row."""
    workers = min(choice.workers or cores(), len(missing))
    with ExitStack() as stack:
        if choice.scheduler is not None:  # one that is not there is told before anything that takes long
            client = stack.enter_context(open_cluster(choice.scheduler))
            workers = max(sum(client.nthreads().values()), 1)
        stack.enter_context(kernels([cell.config for cell in missing], quiet=quiet))
        with console.status("timing a few scans", quiet):
            seconds = estimate_seconds(missing, recordings, workers)
        if not quiet:
            console.tell(_announcement(plan, len(missing), seconds, workers))
        stopped = stack.enter_context(stop_on_interrupt())
        if choice.scheduler is None:
            client = stack.enter_context(open_cluster(None, workers))
        bar = stack.enter_context(_Bar(missing, quiet))

        def on_answer(cell: Cell, answer: Answer) -> None:
            row = {**provenance(), **answer.row}
            results.add(cell, row, answer.trace, answer.error)
            bar.advance(failed=answer.error is not None)

        places = dict(plan.recordings)
        try:
            run_cells(client, missing, places, recordings, digests, on_answer, stopped, console.tell)
        except PfslamError as error:
            if isinstance(error, InputError) or not bar.done:
                raise
            raise PfslamError(f"{error}; {_kept(plan, len(missing), bar.done - bar.failed, results)}") from None
        was_stopped = stopped()
    if was_stopped and bar.done < len(missing):
        raise Interrupted(f"interrupted; {_kept(plan, len(missing), bar.done - bar.failed, results)}")


def _announcement(plan: Plan, missing: int, seconds: float, workers: int) -> str:
    """How many runs, and about how long they take."""
    done = plan.count - missing
    resumed = f"; {done:,} are done, {missing:,} are missing" if done else ""
    return f"{plan.in_words}{resumed}; about {_duration(seconds)} on {workers} worker{'s' * (workers != 1)}"


def _kept(plan: Plan, missing: int, new: int, results: Results) -> str:
    done = plan.count - missing + new
    return f"{results.csv} holds {done} of {plan.count} runs, and the same command goes on from there"


def _show(plan: Plan, cells: Sequence[Cell], results: Results, by: str | None, viewer: bool, quiet: bool) -> None:
    """The table, sweep.rrd and index.html."""
    rows = results.of(cells)
    found = rankings(plan, cells, rows, by)
    ends = [extremes(plan, ranking, cells, results) for ranking in found]
    with replaced(results.folder / "table.md") as temporary:
        temporary.write_text(markdown_page(plan, found, rows), encoding="utf-8")
    if not quiet:
        for ranking in found:
            console.results().print(table(plan, ranking))
        console.results().print(cost(rows), markup=False)
    if viewer:
        _write_recording(plan, cells, results, found, quiet)
    try:
        require_matplotlib()
    except InputError as error:
        console.tell(str(error))
    else:
        with console.status("drawing plots", quiet):
            page = write_page(results.folder, plan, found, ends)
        if not quiet:
            console.results().print(f"{page} shows it with plots", markup=False, soft_wrap=True)


def _write_recording(
    plan: Plan, cells: Sequence[Cell], results: Results, found: Sequence[Ranking], quiet: bool
) -> None:
    from pfslam_viz.sweep.rerun_recording import write_recording

    with console.status("writing sweep.rrd", quiet):
        write_recording(results.folder / "sweep.rrd", plan, found, cells, results)


def _duration(seconds: float) -> str:
    if seconds < 90:
        return f"{max(seconds, 1):.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


class _Bar:
    """Cells done and failed, and the time left. A context manager."""

    def __init__(self, cells: Sequence[Cell], quiet: bool) -> None:
        self.done = self.failed = 0
        self._progress = Progress(
            TextColumn("sweep"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            TextColumn("{task.fields[failed]}"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console.messages(),
            refresh_per_second=2,
            disable=quiet,
        )
        self._task = self._progress.add_task("sweep", total=len(cells), failed="")

    def __enter__(self) -> "_Bar":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def advance(self, failed: bool) -> None:
        """One more cell has ended."""
        self.done += 1
        self.failed += failed
        self._progress.update(self._task, advance=1, failed=f"{self.failed} failed" if self.failed else "")
