"""What is shown in the terminal while a command runs: remarks, a status line, a progress bar; and where results go.

It knows no filter: what is in the tables is in ``commands/``.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column
from rich.text import Text

from pfslam_viz import streams
from pfslam_viz.names import readable

PIPE_WIDTH = 120  # columns, where there is no terminal to ask


@cache
def messages() -> Console:
    """Where progress and remarks go: stderr, so that stdout holds results only.

    One console for all of them, so that a remark does not tear a progress bar.
    """
    return Console(stderr=True, highlight=False)


def tell(message: str) -> None:
    """A remark to the user, a line on stderr."""
    messages().print(readable(message), markup=False, soft_wrap=True)


class _Unread(Console):
    """A console whose reader may go away: what is printed then is lost, and nothing else."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As ever; raises PfslamError where standard output takes no more."""
        with streams.full_named():
            super().print(*objects, **options)

    def on_broken_pipe(self) -> None:
        self.quiet = True
        streams.abandon_stdout()


def results(to_stderr: bool = False) -> Console:
    """Where results go: stdout, unless that carries data."""
    if to_stderr:
        return messages()
    return _Unread(highlight=False, width=None if sys.stdout.isatty() else PIPE_WIDTH)


@contextmanager
def status(text: str, quiet: bool = False) -> Iterator[None]:
    """Show ``text`` with a spinner while something runs that has no progress of its own."""
    if quiet:
        yield
        return
    with messages().status(text):
        yield


@contextmanager
def progress(label: str, total: int, quiet: bool = False) -> Iterator[Callable[[], None]]:
    """A progress bar on stderr; what is given is called as each of ``total`` things is done."""
    columns = TextColumn("{task.description}"), BarColumn(bar_width=24), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=messages(), refresh_per_second=5, disable=quiet) as shown:
        task = shown.add_task(label, total=total)
        yield lambda: shown.advance(task)


@contextmanager
def steps(label: str, quiet: bool = False) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on stderr that appears once it is told how many steps of how many are done, if ever."""
    columns = SpinnerColumn(), TextColumn("{task.description}"), BarColumn(bar_width=24), MofNCompleteColumn()
    shown = Progress(*columns, TimeElapsedColumn(), console=messages(), refresh_per_second=5, disable=quiet)
    task = shown.add_task(label, total=None)

    def show(done: int, total: int) -> None:
        shown.start()
        shown.update(task, completed=done, total=total)

    try:
        yield show
    finally:
        if shown.live.is_started:
            shown.stop()


class _Speed(ProgressColumn):
    """Scans per second, and how many times faster than the robot drove."""

    def __init__(self) -> None:
        super().__init__(Column(no_wrap=True))

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        if not speed:
            return Text("")
        recorded = task.fields["seconds_per_scan"]
        return Text(f"{speed:,.0f} scans/s  {speed * recorded:.1f}x real time", style="progress.data.speed")


class ReplayProgress:
    """The progress bar of one or more runs over a recording, on stderr. A context manager."""

    def __init__(self, scans: int, duration: float, quiet: bool = False, label: str = "replay") -> None:
        """For ``scans`` scans in all that took the robot ``duration`` s."""
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            MofNCompleteColumn(),
            _Speed(),
            TimeRemainingColumn(),
            console=messages(),
            refresh_per_second=5,
            disable=quiet,
        )
        self._task = self._progress.add_task(label, total=scans, seconds_per_scan=duration / max(scans, 1))

    def __enter__(self) -> "ReplayProgress":
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def advance(self, scans: int = 1) -> None:
        """So many scans more are done."""
        self._progress.advance(self._task, scans)

    def show(self, label: str, done: int, total: int) -> None:
        """``done`` of ``total`` scans are done, and ``label`` says what is run now."""
        self._progress.update(self._task, description=label, completed=done, total=total)
