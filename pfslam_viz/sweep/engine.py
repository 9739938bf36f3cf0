"""Cells on Dask workers: of a cluster on this machine, or of a scheduler that runs elsewhere."""

import logging
import tempfile
from asyncio import CancelledError as AsyncCancelledError
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from importlib.util import find_spec
from queue import Empty, SimpleQueue
from time import monotonic
from typing import TYPE_CHECKING, Any

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.evaluation.cell import WARM_UP
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.sweep import version, worker
from pfslam_viz.sweep.plan import Cell
from pfslam_viz.sweep.version import code_version
from pfslam_viz.sweep.worker import Answer, Order

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_SECONDS = 5.0  # a scheduler has this long to answer
POLL_SECONDS = 0.2  # how soon Ctrl-C is noticed
ASK_SECONDS = 2.0  # from one look at the workers to the next
AHEAD = 3  # cells a worker that are submitted at a time, so that a large sweep does not wait in the scheduler
ONE_THREAD = dict.fromkeys(
    ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)

GONE = "the scheduler went away"

OnAnswer = Callable[[Cell, Answer], None]


def require_distributed() -> None:
    """Raise InputError, with what to do, where Dask is not installed."""
    if find_spec("distributed") is None:
        raise InputError("sweep runs on Dask, which is missing: pip install 'pfslam-viz[sweep]'")


@contextmanager
def open_cluster(scheduler: str | None, workers: int = 1) -> Iterator["Client"]:
    """A client of the scheduler at the address, or of ``workers`` processes of one thread on this machine's loopback.

    Raises InputError for a scheduler that does not answer.
    """
    require_distributed()
    import dask
    from distributed import Client, LocalCluster

    for name in ("asyncio", "tornado", "distributed", *logging.root.manager.loggerDict):
        if name.partition(".")[0] in ("asyncio", "tornado", "distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is said by us, in a line
    settings = {
        "distributed.comm.timeouts.connect": f"{CONNECT_SECONDS}s",
        "distributed.worker.profile.enabled": False,  # it would stop a cell a hundred times a second
        "distributed.admin.tick.interval": "1s",  # processes look at themselves fifty times a second otherwise,
        "distributed.admin.system-monitor.interval": "10s",  # which takes 2 % of a core each
    }
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(settings))
        if scheduler is None:
            scratch = stack.enter_context(tempfile.TemporaryDirectory(prefix="pfslam-", ignore_cleanup_errors=True))
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address=None,
                scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},  # a free port, without a word
                memory_limit=0,
                local_directory=scratch,
                env=ONE_THREAD,
                preload=[worker.__name__],
                silence_logs=logging.CRITICAL,
            )
            stack.callback(_quietly, cluster.close, timeout=5)
            client = Client(cluster)
        else:
            try:
                client = Client(scheduler, timeout=CONNECT_SECONDS, set_as_default=False)
            except (OSError, ValueError, TypeError) as error:
                reason = " ".join(str(error).split()) or type(error).__name__
                raise InputError(
                    f"--scheduler {scheduler}: no Dask scheduler answers there ({reason}); 'dask scheduler' starts one"
                ) from None
        stack.callback(_quietly, client.close, timeout=5)
        yield client


def run_cells(
    client: "Client",
    cells: Sequence[Cell],
    choices: Mapping[str, RecordingChoice],
    recordings: Mapping[str, Recording],
    fingerprints: Mapping[str, str],
    on_answer: OnAnswer,
    stopped: Callable[[], bool] = lambda: False,
    tell: Callable[[str], None] = lambda text: None,
) -> None:
    """Run every cell once; ``on_answer`` is called with each as it ends, until ``stopped`` says so.

    A cell whose worker is lost is tried again on another one; one that four workers were lost with is answered as an
    error. ``choices`` says where the recordings lie, for workers that have them; ``recordings`` are sent to those that
    do not. Raises InputError for workers of another version, PfslamError when the scheduler goes away.
    """
    run = _Run(client, choices, recordings, fingerprints, tell)
    with _scheduler_there():
        run.check_workers()
        run.compile_kernels(cells)
    waiting = list(reversed(cells))
    while waiting or run.pending:
        with _scheduler_there():
            while waiting and len(run.pending) < run.room():
                run.submit(waiting.pop())
            answered = run.next_answer()
        if answered is not None:
            on_answer(*answered)
        if stopped():
            run.cancel()
            return


@contextmanager
def _scheduler_there() -> Iterator[None]:
    """Raise PfslamError where the connection to the scheduler breaks."""
    try:
        yield
    except (OSError, CancelledError, AsyncCancelledError):  # Dask's errors of communication are OSErrors
        raise PfslamError(GONE) from None


class _Run:
    """The cells that are on their way."""

    def __init__(
        self,
        client: "Client",
        choices: Mapping[str, RecordingChoice],
        recordings: Mapping[str, Recording],
        fingerprints: Mapping[str, str],
        tell: Callable[[str], None],
    ) -> None:
        self.client, self.choices, self.recordings, self.fingerprints = client, choices, recordings, fingerprints
        self.tell = tell
        self.pending: dict[str, Cell] = {}
        self._futures: dict[str, Future[Any]] = {}
        self._done: SimpleQueue[str] = SimpleQueue()
        self._sent: set[tuple[str, str]] = set()
        self._attempts = 0
        self._room, self._asked = 0, float("-inf")

    def room(self) -> int:
        """How many cells may be on their way; workers may come and go, so that it is asked for now and then."""
        if monotonic() > self._asked + ASK_SECONDS:
            self._room = AHEAD * max(sum(self._threads().values()), 2)
            self._asked = monotonic()
        return self._room

    def check_workers(self) -> None:
        """Raise InputError for workers of another version; say what else is amiss with them."""
        threads = self._threads()
        if not threads:
            self.tell("the scheduler has no workers yet: cells wait until one joins ('dask worker' starts one)")
            return
        for address, found in self.client.run(version.code_version, on_error="return").items():
            if isinstance(found, BaseException):
                raise InputError(
                    f"worker {address} cannot run pfslam-viz ({worker.one_line(found)}):"
                    f" install {code_version()} in its environment"
                )
            _refuse_other(address, found)
        if many := [address for address, count in threads.items() if count > 1]:
            self.tell(
                f"{len(many)} workers run several cells at a time in one process, such as {many[0]}:"
                " 'dask worker --nworkers -1 --nthreads 1' is faster"
            )

    def compile_kernels(self, cells: Sequence[Cell]) -> None:
        """Have one worker on every machine compile what cells need, so that the others load it from the cache."""
        hosts = {address.rpartition(":")[0]: address for address in self._threads()}
        variants = {id(cell.variant): cell.variant.values for cell in cells}
        kinds = {worker.kind(values): values.model_dump(mode="json") for values in variants.values()}
        recording = worker.content(self.recordings[cells[0].recording].select(0, WARM_UP))
        if hosts:
            first = list(hosts.values())
            self.client.run(worker.load_kernels, recording, [*kinds.values()], workers=first, on_error="return")

    def submit(self, cell: Cell) -> None:
        """Send one cell."""
        self._attempts += 1
        label = cell.recording
        config = cell.config.model_dump(mode="json")
        order = Order(cell.id, self.fingerprints[label], self.choices[label], config, code_version())
        key = f"cell-{cell.id}-{self._attempts}"
        future = self.client.submit(worker.run_order, order, key=key, pure=False)
        self.pending[key], self._futures[key] = cell, future
        future.add_done_callback(lambda done: self._done.put(done.key))

    def next_answer(self) -> tuple[Cell, Answer] | None:
        """A cell that has ended, or None where none has within a moment, or it had to be sent once more."""
        try:
            key = self._done.get(timeout=POLL_SECONDS)
        except Empty:
            if self.client.status not in ("running", "connecting"):
                raise PfslamError(GONE) from None
            return None
        cell, future = self.pending.pop(key), self._futures.pop(key)
        if future.status == "finished":
            answer: Answer = future.result()
            if answer.lacks or answer.code != code_version():
                self._send_recording(cell, future, answer.code)
                self.submit(cell)
                return None
            return cell, answer
        if future.status == "error":
            return cell, Answer(cell.id, code_version(), {}, error=_explain(future.exception()))
        if self.client.status not in ("running", "connecting"):
            raise PfslamError(GONE)
        self.submit(cell)  # lost with its worker, or cancelled by somebody else
        return None

    def cancel(self) -> None:
        """Let what has not begun be."""
        with suppress(Exception):
            self.client.cancel(list(self._futures.values()))

    def _send_recording(self, cell: Cell, future: "Future[Any]", code: str) -> None:
        """Give the workers that answered ``future`` the recording that they lack, once each."""
        label = cell.recording
        for address in self.client.who_has([future]).get(future.key, ()):
            _refuse_other(address, code)
            if (address, label) not in self._sent:
                self._sent.add((address, label))
                sent = worker.content(self.recordings[label])
                self.client.run(worker.receive, self.fingerprints[label], sent, workers=[address], on_error="return")

    def _threads(self) -> dict[str, int]:
        found: dict[str, int] = self.client.nthreads()
        return found


def _refuse_other(address: str, code: str) -> None:
    if code != code_version():
        raise InputError(
            f"worker {address} has pfslam-viz {code}, and this is {code_version()}: install the same there"
        )


def _explain(error: BaseException | None) -> str:
    """Why Dask gave a cell up."""
    from distributed.scheduler import KilledWorker

    if isinstance(error, KilledWorker):
        return "every worker that ran it was lost (out of memory?)"
    return "lost" if error is None else worker.one_line(error)


def _quietly(close: Callable[..., Any], **options: Any) -> None:
    """Close, whatever state the other end is in."""
    with suppress(Exception):
        close(**options)
