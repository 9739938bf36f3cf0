"""Standard output and error that are closed, unread or full: what was made is kept, and one line says so.

Each in a process of its own, since it is the process's own streams that go.
"""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name != "posix", reason="needs a POSIX shell")
FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
PAPER = ("--config", "paper", "--particles", "10", "--stop", "20")


def shell(line: str, arguments: Sequence[object] = (), **environment: str) -> tuple[int, str, str]:
    """Run a line of bash, in which ``pfslam "$@"`` is the command line with ``arguments``; it ends in time."""
    script = f'pfslam() {{ "{sys.executable}" -m pfslam_viz "$@"; }}\nset -o pipefail\n{line}\n'
    done = subprocess.run(
        ["bash", "-c", script, "bash", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **environment},
        check=False,
    )
    assert "Traceback" not in done.stderr and "Exception ignored" not in done.stderr
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams_cost_nothing_but_what_was_to_be_printed(drive: Path, tmp_path: Path, closed: str) -> None:
    path = tmp_path / "out.rrd"
    status, out, _ = shell(f'pfslam "$@" {closed}', ["replay", drive, "--save", path, *PAPER])
    assert (status, out) == (0, "")
    assert path.read_bytes().startswith(b"RRF2") and b"path length" not in path.read_bytes()
    assert list(tmp_path.iterdir()) == [path]


def test_a_recording_for_closed_standard_output_is_wrong_use() -> None:
    status, _, err = shell('pfslam "$@" >&-', ["replay", "demo", "--stdout"])
    assert (status, err) == (
        2,
        "pfslam-viz: --stdout: standard output is closed; redirect it to a file or a program\n",
    )


def test_a_summary_that_nobody_reads_is_no_failure(drive: Path, tmp_path: Path) -> None:
    status, _, err = shell('pfslam "$@" | true', ["replay", drive, "--save", tmp_path / "out.rrd", *PAPER])
    assert status == 0, err
    assert (tmp_path / "out.rrd").is_file()


@pytest.mark.parametrize("command", ["info DRIVE", "info DRIVE --json", "config", "config --markdown", "recordings"])
def test_results_of_which_the_beginning_is_read(drive: Path, command: str) -> None:
    status, _, err = shell('pfslam "$@" | head -c 1', command.replace("DRIVE", str(drive)).split())
    assert (status, "pfslam-viz:" in err) == (0, False)


@FULL
@pytest.mark.parametrize("command", ["info DRIVE", "info DRIVE --json", "config", "recordings --json", "--version"])
def test_results_on_a_full_disk_are_an_error_in_one_line(drive: Path, command: str) -> None:
    status, _, err = shell('pfslam "$@" >/dev/full', command.replace("DRIVE", str(drive)).split())
    assert status == 1
    assert err.splitlines()[-1] == "pfslam-viz: standard output cannot be written: No space left on device"


@FULL
def test_a_summary_on_a_full_disk_is_told_and_the_file_is_there(drive: Path, tmp_path: Path) -> None:
    status, _, err = shell('pfslam "$@" >/dev/full', ["replay", drive, "--save", tmp_path / "out.rrd", *PAPER])
    assert status == 1
    assert err.splitlines()[-1] == "pfslam-viz: standard output cannot be written: No space left on device"
    assert (tmp_path / "out.rrd").read_bytes().startswith(b"RRF2")


@pytest.mark.parametrize("reader", ["head -c 100", "true"])
def test_a_recording_whose_reader_leaves_ends_with_one_line(drive: Path, reader: str) -> None:
    status, out, err = shell(f'pfslam "$@" | {reader} | wc -c', ["replay", drive, "--stdout", *PAPER, "--quiet"])
    assert status == 1
    assert int(out) == (100 if reader.startswith("head") else 0)
    assert err == "pfslam-viz: nobody reads standard output any more: the run has ended\n"


@FULL
def test_a_recording_for_a_full_disk_ends_with_one_line(drive: Path) -> None:
    status, _, err = shell('pfslam "$@" >/dev/full', ["replay", drive, "--stdout", *PAPER, "--quiet"])
    reason = "standard output cannot be written: No space left on device; what is there is cut off"
    assert (status, err) == (1, f"pfslam-viz: {reason}\n")


def test_an_ascii_terminal_is_shown_any_name(drive: Path, tmp_path: Path) -> None:
    path = tmp_path / "größe.rrd"
    ascii_only = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    status, out, err = shell('pfslam "$@"', ["replay", drive, "--save", path, *PAPER], **ascii_only)
    assert status == 0, err
    assert "path length" in out
    assert path.read_bytes().startswith(b"RRF2")
    assert list(tmp_path.iterdir()) == [path]


PRINT_ODD = (
    "import sys; sys.argv[1:] = ['info', 'nowhere/\\u05d0\\x1b[31m\\udcff']; from pfslam_viz import cli; cli.main()"
)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_messages_take_any_name_on_any_terminal(encoding: str) -> None:
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    done = subprocess.run(
        [sys.executable, "-c", PRINT_ODD], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 2
    assert "\x1b" not in done.stderr
    assert done.stderr.startswith("pfslam-viz: nowhere/") and done.stderr.count("\n") == 1
