"""Standard output whose reader goes away, in processes of their own."""

import subprocess
import sys
import textwrap
import time
from pathlib import Path

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
