"""Files from the web to the disk: checked, retried, several at a time, never half of one under its final name.

pooch transfers them. Its registry and retries are not used: they know no git blob ids and no check of a file without a
pinned hash, overwrite a user's file of the same name, try a 404 and a wrong hash again like a broken connection, and
sleep where Ctrl-C has to stop them.
"""

import hashlib
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urljoin, urlsplit

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.files import is_full, replaced

# What a check says of a file: None if it is good, else what is wrong with it.
Check = Callable[[Path], str | None]

_CHUNK = 1 << 16
MOST_BYTES = 256 << 20  # of a file that is to be fetched; the largest has 12 MB


class Unavailable(PfslamError):
    """A file could not be fetched; the message says which and why."""


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to wait for a server and how often to try.

    ``timeout`` s without a byte is a stall; ``tries`` in all; ``pause`` s before the second try, doubled each time.
    """

    timeout: float = 30.0
    tries: int = 4
    pause: float = 1.0


@dataclass(slots=True)
class Meter:
    """What is told of a transfer: ``on_bytes(received, total)``, total 0 if unknown; ``stop`` ends it.

    So do more than ``most`` bytes.

    This is the progress bar that pooch asks for.
    """

    on_bytes: Callable[[int, int], None]
    stop: threading.Event
    most: int = MOST_BYTES
    total: int = 0
    received: int = field(default=0, init=False)

    def update(self, size: int) -> None:
        """Count ``size`` bytes more. pooch passes the size of its buffer, so the last call may count too many."""
        if self.stop.is_set():
            raise Unavailable("stopped")
        if self.received + size > self.most + _CHUNK:
            raise _Failed(f"more than {self.most >> 20} MB come, which is not what was published", False)
        self.received = min(self.received + size, self.total or self.received + size)
        self.on_bytes(self.received, self.total)

    def reset(self) -> None:
        """Begin again from 0."""
        self.received = 0

    def close(self) -> None:
        """Nothing is held open."""


def has_digest(path: Path, digest: str) -> bool:
    """Whether a file has the ``digest``: ``sha256:...``, or ``git:...``, git's id of a blob with its content."""
    kind, _, expected = digest.partition(":")
    hashed = hashlib.sha256() if kind == "sha256" else hashlib.sha1(usedforsecurity=False)
    if kind == "git":
        hashed.update(b"blob %d\0" % path.stat().st_size)
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            hashed.update(block)
    return hashed.hexdigest() == expected


@dataclass(frozen=True, slots=True)
class Request:
    """One file to fetch: the first of ``urls`` that exists, to ``target``.

    ``check`` sees the file before it gets its name. ``on_bytes(received, total)`` hears of the progress, from another
    thread; total is 0 if the server does not say. More than ``most`` bytes are not taken.
    """

    urls: Sequence[str]
    target: Path
    check: Check
    on_bytes: Callable[[int, int], None] = lambda received, total: None
    most: int = MOST_BYTES


def download_all(
    requests: Iterable[Request], connections: int = 4, patience: Patience | None = None
) -> Iterator[tuple[Request, Unavailable | None]]:
    """Fetch files, ``connections`` at a time; yields each as it is done, with what went wrong if it failed.

    Leaving the iteration, by an error or by Ctrl-C, ends the transfers under way. Raises InputError when a file cannot
    be written.
    """
    stop = threading.Event()
    waiting = iter(requests)
    running: dict[Future[None], Request] = {}
    with ThreadPoolExecutor(connections) as pool:
        try:
            while True:
                while len(running) < connections and (request := next(waiting, None)) is not None:
                    running[pool.submit(download, request, stop, patience)] = request
                if not running:
                    return
                for job in wait(running, return_when=FIRST_COMPLETED).done:
                    request = running.pop(job)
                    error = job.exception()
                    if error is not None and not isinstance(error, Unavailable):
                        raise error
                    yield request, error
        finally:
            stop.set()


def download(request: Request, stop: threading.Event | None = None, patience: Patience | None = None) -> None:
    """Fetch one file. ``stop`` ends it.

    A redirect to another host, or from https to http, is not followed. Server errors (5xx, 408, 429), stalls, broken
    connections and short bodies are tried again.

    Raises:
        Unavailable: it is nowhere, the server keeps failing, or the content is wrong.
        InputError: it cannot be written; PfslamError where the disk is full.
    """
    stop, patience = stop or threading.Event(), patience or Patience()
    reason = ""
    for url in request.urls:
        again = False
        for attempt in range(patience.tries):
            if attempt and stop.wait(patience.pause * 2 ** (attempt - 1)):
                raise Unavailable(f"{url}: stopped")
            reason, again = _attempt(url, request, Meter(request.on_bytes, stop, request.most), patience)
            if not reason:
                return
            if not again:
                break
        if reason != _NOT_FOUND:
            raise Unavailable(f"{url}: {reason}{f', {patience.tries} times' if again else ''}")
    raise Unavailable(f"{request.urls[0]}: {reason}")


_NOT_FOUND = "not there (404)"


def _attempt(url: str, request: Request, meter: Meter, patience: Patience) -> tuple[str, bool]:
    """One try: what went wrong, ``""`` for nothing, and whether to try again."""
    import pooch

    fetcher = pooch.HTTPDownloader(
        progressbar=meter,
        chunk_size=_CHUNK,
        timeout=patience.timeout,
        headers={"Accept-Encoding": "identity"},
        hooks={"response": _refuse_redirect},
    )
    try:
        with replaced(request.target) as temporary:
            try:
                fetcher(url, str(temporary), None)
            except OSError as error:
                if hasattr(error, "request"):  # one of requests' errors, which are OSErrors
                    raise _Failed(*_explain(error, patience)) from None
                if isinstance(error, ConnectionError | TimeoutError):
                    raise _Failed("the connection broke off", True) from None
                if is_full(error):
                    raise  # which is told with the target's name
                raise InputError(f"{request.target}: cannot be written: {error.strerror}") from None
            size = temporary.stat().st_size
            if meter.total and size != meter.total:
                raise _Failed(f"only {size:,} of {meter.total:,} bytes came", True)
            if wrong := request.check(temporary):
                raise _Failed(wrong, False)
    except _Failed as failure:
        return failure.reason, failure.again
    return "", False


def _refuse_redirect(response: Any, **_: Any) -> None:
    """Raise _Failed for an answer that points to another host, or from https to http."""
    if not response.is_redirect:
        return
    here, there = urlsplit(response.url), urlsplit(urljoin(response.url, response.headers["location"]))
    if there.hostname != here.hostname:
        raise _Failed(f"redirected to another host, {there.hostname}, which is not followed", False)
    if (here.scheme, there.scheme) not in (("http", "http"), ("http", "https"), ("https", "https")):
        raise _Failed(f"redirected from {here.scheme} to {there.scheme}, which is not followed", False)


class _Failed(Exception):
    def __init__(self, reason: str, again: bool) -> None:
        super().__init__(reason)
        self.reason, self.again = reason, again


def _explain(error: OSError, patience: Patience) -> tuple[str, bool]:
    """What went wrong in a few words, and whether it may go better the next time."""
    kind = type(error).__name__
    if kind == "TooManyRedirects":
        return "redirected without end", False
    response = getattr(error, "response", None)
    if response is not None:
        code = int(response.status_code)
        if code == 404:
            return _NOT_FOUND, False
        return f"the server answered {code} {response.reason}", code >= 500 or code in (408, 429)
    if isinstance(error, ValueError):  # requests' errors about addresses
        return "not a usable address", False
    if "Timeout" in kind or "timed out" in str(error):
        return f"no data for {patience.timeout:g} s", True
    if kind == "ChunkedEncodingError":
        return "the connection broke off", True
    return "no connection", True
