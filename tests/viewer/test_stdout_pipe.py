"""Standard output whose reader goes away, in processes of their own."""

import subprocess
import sys
import textwrap
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, cast

import pytest

from pfslam_viz.errors import PfslamError
from pfslam_viz.viewer.destination import Destination
from tests.viewer.test_sinks import SEND

ALONE = (
    SEND
    + """
    try:
        with open_sinks(stdout=True) as sink:
            for _ in range(200):
                send(sink, 1)
        print("not noticed", file=sys.stderr)
    except PfslamError as error:
        print(error, file=sys.stderr)
"""
)


def test_a_run_for_standard_output_alone_ends_with_its_reader() -> None:
    """It ends by itself, in Rerun's own end too, and says why in one line."""
    with subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(ALONE)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.read(100)
        process.stdout.close()
        try:
            assert process.wait(60) == 0
        finally:
            process.kill()
        assert process.stderr.read().decode() == "nobody reads standard output any more: the run has ended\n"


def test_bytes_are_carried_as_they_are_and_standard_output_is_given_back(tmp_path: Path) -> None:
    script = """
        import os
        from pfslam_viz.viewer.stdout_pipe import StdoutPipe
        pipe = StdoutPipe()
        os.write(1, bytes(range(256)) * 4000)
        assert pipe.close(10.0) and pipe.failure is None
        os.write(1, b"after")
    """
    with (tmp_path / "out").open("wb") as out:
        subprocess.run([sys.executable, "-c", textwrap.dedent(script)], stdout=out, check=True, timeout=60)
    assert (tmp_path / "out").read_bytes() == bytes(range(256)) * 4000 + b"after"


def test_a_closed_reader_is_seen_also_while_nothing_is_written() -> None:
    """As by the importer, while it reads a recording or settles a run."""
    script = """
        import os, time
        from pfslam_viz.viewer.stdout_pipe import when_unread
        when_unread(lambda: os._exit(7))
        os.write(1, b"x")
        time.sleep(60)
    """
    process = subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    try:
        assert process.stdout.read(1) == b"x"
        time.sleep(0.5)
        assert process.poll() is None  # as long as it is read
        process.stdout.close()
        assert process.wait(20) == 7
    finally:
        process.kill()
        process.wait()


class Pipe:
    """A pipe of which ``takes`` says how many bytes have been carried at each look."""

    def __init__(self, takes: Iterable[int], failure: str | None = None) -> None:
        self._takes, self.failure = iter(takes), failure
        self.last = 0

    @property
    def carried(self) -> int:
        self.last = next(self._takes, self.last)
        return self.last


class Stream:
    """A stream that is there after so many looks."""

    def __init__(self, looks: int) -> None:
        self.looks, self.waited = looks, 0

    def flush(self, timeout_sec: float) -> None:
        self.waited += 1
        if self.waited <= self.looks:
            raise RuntimeError("Flush timed out")


def destination(stream: Stream, pipe: Pipe) -> Destination:
    return Destination("standard output", cast(Any, stream), live=False, pipe=cast(Any, pipe))


def test_a_slow_reader_is_waited_for_as_long_as_it_reads() -> None:
    stream = Stream(looks=20)
    destination(stream, Pipe(range(1000))).flush(lambda: 1e-9)
    assert stream.waited == 21


def test_a_reader_that_reads_nothing_is_given_up_and_at_once_when_the_user_wants_to_end() -> None:
    asked = iter([1e9, 1e9, 1e9, 0.0])  # seconds to wait: many, until Ctrl-C
    stream = Stream(looks=1000)
    with pytest.raises(RuntimeError, match="timed out"):
        destination(stream, Pipe([])).flush(lambda: next(asked))
    assert stream.waited == 4


def test_a_reader_that_left_is_not_waited_for() -> None:
    stream = Stream(looks=1000)
    lost = destination(stream, Pipe([], failure="No space left on device"))
    lost.flush(lambda: 1e9)
    assert stream.waited == 0
    with pytest.raises(PfslamError, match="standard output cannot be written: No space left on device"):
        lost.raise_if_lost()
