"""``pfslam-viz video``: what it refuses before a viewer is started, and what it passes on."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr

from pfslam_viz.viewer import film
from pfslam_viz.viewer.film import Scene

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def scans(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of nothing but 601 scans at 20 a second."""
    path = tmp_path_factory.mktemp("scans") / "scans.rrd"
    stream = rr.RecordingStream("pfslam-viz")
    stream.save(path)
    times = [rr.TimeColumn("step", sequence=range(601)), rr.TimeColumn("time", duration=np.arange(601) / 20)]
    stream.send_columns("plots/n_eff", times, rr.Scalars.columns(scalars=np.zeros(601)))
    stream.disconnect()
    return path


Made = list[tuple[Any, ...]]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Made:
    """What would have been filmed."""
    calls: Made = []

    def make(recording: Path, out: Path, scene: Scene, steps: Any, on_picture: Any = None) -> list[str]:
        calls.append((out.name, scene, steps))
        out.write_bytes(b"film")
        return []

    monkeypatch.setattr(film, "film", make)
    monkeypatch.setattr(film, "still", make)
    return calls


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("absent.rrd x.mp4", "absent.rrd: no such file"),
        ("text.rrd x.mp4", "text.rrd: is no Rerun recording; make one with: pfslam-viz replay RECORDING --save x.rrd"),
        (
            "scans.rrd x.avi",
            "x.avi: unknown ending; a film has .mp4, .webm, .gif, .webp, a picture .png",
        ),
        (
            "scans.rrd film",
            "film: unknown ending; a film has .mp4, .webm, .gif, .webp, a picture .png",
        ),
        ("scans.rrd x.mp4 --from 30 --to 20", "--from 30 comes after --to 20"),
        ("scans.rrd x.mp4 --to 601", "--to 601: the recording has scans 0 to 600"),
        ("scans.rrd x.png --step 700", "--step 700: the recording has scans 0 to 600"),
        ("scans.rrd x.mp4 --step 7", "--step is for a picture, and a film was asked for"),
        ("scans.rrd x.png --speed 2", "--speed is for a film, and a picture was asked for"),
        ("scans.rrd x.mp4 --size big", "--size big: write WIDTHxHEIGHT in pixels, as 1280x720"),
        ("scans.rrd x.mp4 --size 100x100", "--size 100x100: from 320x240 to 3840x2160 is possible"),
        ("scans.rrd x.mp4 --size 1280x9999", "--size 1280x9999: from 320x240 to 3840x2160 is possible"),
        ("scans.rrd text.rrd/x.mp4", "text.rrd/x.mp4: cannot be written: text.rrd is not a folder"),
    ],
)
def test_wrong_use_is_status_2_and_one_line(
    run: Run, scans: Path, made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scans.rrd").write_bytes(scans.read_bytes())
    (tmp_path / "text.rrd").write_text("a text")
    assert run("video", *line.split()) == (2, "", f"pfslam-viz: {message}\n")
    assert made == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["scans.rrd", "text.rrd"]


def test_by_default_the_whole_is_shown_in_a_quarter_of_a_minute(
    run: Run, scans: Path, made: Made, tmp_path: Path
) -> None:
    status, out, err = run("video", scans, tmp_path / "x.gif")
    assert status == 0, err
    ((name, scene, steps),) = made
    assert (name, scene) == ("x.gif", Scene("Compare", (1280, 720), None))
    assert steps.tolist() == list(range(0, 601, 4))  # 30 s of scans at twice the speed, ten pictures a second
    assert "x.gif: 151 pictures of scans 0 to 600, 2 times as fast as the robot, 0.0 MB" in out


def test_a_part_at_a_speed(run: Run, scans: Path, made: Made, tmp_path: Path) -> None:
    options = "--from 100 --to 140 --speed 4 --view 3-D --size 640x480 --width 320 --quiet"
    assert run("video", scans, tmp_path / "x.webm", *options.split()) == (0, "", "")
    ((_, scene, steps),) = made
    assert scene == Scene("3-D", (640, 480), 320)
    assert len(steps) == 14 and steps[1] == 103  # 2 s in half a second at 25 a second: 3.2 scans each
    assert (steps[0], steps[-1]) == (100, 140)


def test_pictures_show_the_last_scan_or_the_one_that_is_asked_for(
    run: Run, scans: Path, made: Made, tmp_path: Path
) -> None:
    assert run("video", scans, tmp_path / "x.png", "--quiet")[0] == 0
    assert run("video", scans, tmp_path / "y.PNG", "--step", 0, "--quiet")[0] == 0
    assert [step for _, _, step in made] == [600, 0]


def test_without_pyav_mp4_is_remarked_upon(
    run: Run, scans: Path, made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for there in (False, True):
        monkeypatch.setattr("pfslam_viz.commands.video.has_h264", lambda there=there: there)
        err = run("video", scans, tmp_path / "x.mp4")[2]
        assert ("pip install 'pfslam-viz[film]'" in err) is not there


def test_where_no_viewer_can_draw_the_message_names_what_to_install(
    run: Run, scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dud = tmp_path / "rerun"
    dud.write_text("#!/bin/sh\necho INFO something\necho \"thread 'main' panicked at 'no adapter'\"\nexit 101\n")
    dud.chmod(0o755)
    monkeypatch.setattr("pfslam_viz.viewer.headless.viewer_binary", lambda: dud)
    status, out, err = run("video", scans, tmp_path / "x.webm", "--quiet")
    assert (status, out, err.count("\n")) == (1, "", 1)
    assert "apt-get install mesa-vulkan-drivers libvulkan1" in err and "panicked at 'no adapter'" in err
    monkeypatch.setattr("pfslam_viz.viewer.headless.viewer_binary", lambda: tmp_path / "absent")
    status, _, err = run("video", scans, tmp_path / "x.png", "--quiet")
    assert status == 1 and "rerun-sdk" in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [dud]


def test_an_interrupted_film_is_not_written(
    run: Run, scans: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(recording: Path, out: Path, scene: Scene, steps: Any, on_picture: Callable[[], None]) -> list[str]:
        for _ in steps[:5]:
            on_picture()
        os.kill(os.getpid(), signal.SIGTERM)
        on_picture()
        raise AssertionError("went on")

    monkeypatch.setattr(film, "film", make)
    status, out, err = run("video", scans, tmp_path / "x.webm", "--quiet")
    assert (status, out) == (130, "")
    assert err == f"pfslam-viz: interrupted: {tmp_path / 'x.webm'} was not written\n"


@pytest.mark.slow
def test_a_picture_from_the_command_line(scans: Path, tmp_path: Path) -> None:
    """A recording without a layout has no tabs: that is said, and no traceback shown."""
    command = [sys.executable, "-m", "pfslam_viz", "video", str(scans), str(tmp_path / "x.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "Vulkan" in done.stderr:
        pytest.skip(done.stderr)
    assert (done.returncode, done.stdout) == (2, "")
    assert "no layout with tabs" in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
