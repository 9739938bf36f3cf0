"""A replay that is served: it ends at the first Ctrl-C, or request to terminate, whenever that comes."""

import re
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from pfslam_viz.commands.choices import SinkChoice
from pfslam_viz.errors import InputError
from pfslam_viz.viewer.connections import answers

SECONDS = 60.0  # for what takes a moment


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A CARMEN log of 400 scans of a wall."""
    path = tmp_path_factory.mktemp("log") / "drive.clf"
    line = "FLASER 181 {ranges} {x:.3f} 0 0 {x:.3f} 0 0 {t:.2f} host {t:.2f}\n"
    ranges = " ".join(["2.5"] * 181)
    path.write_text("".join(line.format(ranges=ranges, x=0.01 * k, t=0.2 * k) for k in range(400)))
    return path


@contextmanager
def replayed(log: Path, *options: object) -> "Iterator[subprocess.Popen[str]]":
    """A replay in a process of its own, which is over at the end of the block."""
    command = [sys.executable, "-m", "pfslam_viz", "replay", str(log), "--config", "paper", "--force", "--quiet"]
    process = subprocess.Popen([*command, *map(str, options)], stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def lines_until(process: "subprocess.Popen[str]", word: str) -> str:
    """What it says on stderr up to the line with ``word``."""
    said = ""
    for line in process.stderr or ():
        said += line
        if word in line:
            return said
    raise AssertionError(said)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serving_after_the_run_ends_at_the_first_signal(log: Path, tmp_path: Path, number: signal.Signals) -> None:
    with replayed(log, "--particles", 5, "--serve", "--save", tmp_path / "out.rrd") as process:
        said = lines_until(process, "still serving")
        assert (tmp_path / "out.rrd").read_bytes()[:4] == b"RRF2"  # complete, and not only when serving ends
        process.send_signal(number)
        assert process.wait(SECONDS) == 0
    assert said.count("Ctrl-C") == 1


def test_serving_in_mid_run_ends_at_the_first_signal(log: Path, tmp_path: Path) -> None:
    with replayed(log, "--particles", 20_000, "--serve", "--save", tmp_path / "out.rrd") as process:
        lines_until(process, "serving at")
        process.send_signal(signal.SIGTERM)
        assert process.wait(SECONDS) == 130
        assert process.stderr is not None
        rest = process.stderr.read()
    assert "still serving" not in rest and "Traceback" not in rest
    assert {path.name for path in tmp_path.iterdir()} <= {"out.rrd"}


def test_the_web_viewer_is_served_as_long_as_the_run(log: Path) -> None:
    with replayed(log, "--particles", 5, "--serve", "--web") as process:
        said = lines_until(process, "still serving")
        found = re.search(r"the web viewer is at (http://127\.0\.0\.1:(\d+)/\?url=(\S+))", said)
        assert found is not None
        with urllib.request.urlopen(found[1], timeout=SECONDS) as page:
            assert page.status == 200
        process.send_signal(signal.SIGINT)
        assert process.wait(SECONDS) == 0
        assert not answers("127.0.0.1", int(found[2]))


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (SinkChoice(web=True, save=Path("x.rrd")), "--web goes with --serve"),
        (SinkChoice(web=True, serve=True, bind="0.0.0.0"), "this machine alone, and --bind 0.0.0.0 others"),
    ],
)
def test_what_the_web_viewer_does_not_go_with(choice: SinkChoice, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        choice.check()
