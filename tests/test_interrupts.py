"""Ctrl-C, requests to terminate and SIGKILL in every phase: whole files or none, and one line that says which."""

import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from pfslam_viz.interrupts import deferred, stop_on_interrupt
from pfslam_viz.viewer.connections import viewer_binary

Run = Callable[..., tuple[int, str, str]]
SIGNALS = [signal.SIGINT, signal.SIGTERM]
PAPER = ["--config", "paper", "--particles", 10, "--stop", 30, "--quiet"]

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are those of POSIX")


@pytest.fixture(autouse=True)
def terminated_as_interrupted() -> Iterator[None]:
    """As the entry point of the command line has it."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    yield
    signal.signal(signal.SIGTERM, before)


def signal_in(phase: str, number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a signal arrive as ``phase``, a function or method ``module:name``, is called for the first time."""
    module, _, name = phase.partition(":")
    owner: Any = import_module(module)
    *parents, last = name.split(".")
    for parent in parents:
        owner = getattr(owner, parent)
    plain = getattr(owner, last)
    sent: list[int] = []

    def call(*arguments: Any, **options: Any) -> Any:
        if not sent:
            sent.append(number)
            os.kill(os.getpid(), number)
        return plain(*arguments, **options)

    monkeypatch.setattr(owner, last, call)


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize(
    "phase",
    ["pfslam_viz.commands.replay:read", "pfslam_viz.compiling.compile:compiling", "pfslam_viz.config:load_config"],
    ids=["reading", "loading kernels", "settings"],
)
def test_before_the_first_scan_nothing_is_left(
    run: Run, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, phase: str, number: int
) -> None:
    signal_in(phase if "config" not in phase else "pfslam_viz.commands.choices:load_config", number, monkeypatch)
    out = tmp_path / "new" / "out.rrd"
    assert run("replay", drive, "--save", out, *PAPER) == (130, "", "pfslam-viz: interrupted\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize(
    "phase",
    [
        "pfslam_viz.viewer.stream:ReplayStream.finish",
        "pfslam_viz.viewer.sinks:Sink._close_files",
        "pfslam_viz.export:write_map",
    ],
    ids=["drawing the end", "closing the file", "exporting"],
)
def test_after_the_last_scan_everything_is_completed(
    run: Run, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, phase: str, number: int
) -> None:
    signal_in(phase, number, monkeypatch)
    out, folder = tmp_path / "out.rrd", tmp_path / "export"
    handlers = [signal.getsignal(known) for known in SIGNALS]
    status, _, err = run("replay", drive, "--save", out, "--export", folder, *PAPER)
    assert status == 130
    assert err == f"pfslam-viz: interrupted after the last scan; {out} and {folder} hold the whole run\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["export", "out.rrd"]
    assert (folder / "metrics.json").is_file() and len((folder / "estimate.tum").read_text().splitlines()) == 30
    verified = subprocess.run([viewer_binary(), "rrd", "verify", out], capture_output=True, text=True, check=True)
    assert "1 file verified" in verified.stdout + verified.stderr
    assert [signal.getsignal(known) for known in SIGNALS] == handlers


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize(
    ("command", "phase"),
    [
        (["simulate", "OUT", "--duration", 5, "--no-frames"], "pfslam_viz.simulation.recording:scan"),
        (["figures", "DRIVE", "OUT", *PAPER], "pfslam_viz.figures:grid_layer"),
        (["evaluate", "DRIVE", "--no-paper", *PAPER], "pfslam_viz.commands.evaluate:evaluate"),
        (["compare", "DRIVE", "--config", "paper,seed=1", "--save", "OUT", *PAPER], "pfslam_viz.commands.compare:read"),
    ],
    ids=["simulate", "figures", "evaluate", "compare"],
)
def test_other_commands_leave_whole_files_or_none(
    run: Run, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[Any], phase: str, number: int
) -> None:
    signal_in(phase, number, monkeypatch)
    places = {"DRIVE": drive, "OUT": tmp_path / "out"}
    status, _, err = run(*(places.get(part, part) for part in command))
    assert (status, err.splitlines()[-1]) == (130, "pfslam-viz: interrupted")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("phase", ["viewer.stream:ReplayStream.finish", "viewer.destination:Destination.close"])
def test_a_late_sigkill_leaves_the_old_file_and_the_next_run_tidies_up(
    run: Run, drive: Path, tmp_path: Path, phase: str
) -> None:
    out = tmp_path / "out.rrd"
    old = b"RRF2 an older recording of pfslam-viz's"
    out.write_bytes(old)
    arguments = [str(argument) for argument in ("replay", drive, "--save", out, *PAPER)]
    script = f"""
        import os, signal
        from tests.test_interrupts import signal_in
        from pfslam_viz import cli
        import pytest
        signal_in("pfslam_viz.{phase}", signal.SIGKILL, pytest.MonkeyPatch())
        cli.call({arguments})
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(script)], cwd=Path(__file__).parents[1], check=False)
    assert done.returncode == -signal.SIGKILL
    assert out.read_bytes() == old
    assert len(list(tmp_path.iterdir())) == 2  # what it was writing
    assert run(*arguments)[0] == 0
    assert list(tmp_path.iterdir()) == [out]
    assert out.read_bytes().startswith(b"RRF2\x00")


def test_a_deferred_signal_comes_at_the_end_and_a_second_one_at_once() -> None:
    reached = []
    with pytest.raises(KeyboardInterrupt), deferred():
        os.kill(os.getpid(), signal.SIGINT)
        reached.append("after the first")
    with pytest.raises(KeyboardInterrupt), deferred():
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGINT)
        reached.append("after the second")
    with stop_on_interrupt() as stopped, deferred():
        os.kill(os.getpid(), signal.SIGINT)
        assert not stopped()
    assert stopped()
    assert reached == ["after the first"]
