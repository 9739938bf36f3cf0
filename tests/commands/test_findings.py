"""What a user is told of a recording that is wrong or doubtful: when, where, and with which exit status."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import pfslam_viz as pf
from pfslam_viz.evaluation.metrics import metrics
from pfslam_viz.viewer.pages import about_page

Run = Callable[..., tuple[int, str, str]]
pytestmark = pytest.mark.usefixtures("no_screen")
PAPER = ("--config", "paper", "--particles", "20")


def log(path: Path, jump: float = 0.0, reading: float | None = None) -> Path:
    """A robot that goes 2 m along a room of 6 x 4 m in 40 scans; the odometry jumps at scan 20."""
    angles = np.radians(np.arange(-90.0, 91.0))
    lines = []
    for k in range(40):
        x = 0.05 * k
        with np.errstate(divide="ignore"):
            ranges = np.minimum((4 - x) / np.cos(angles).clip(1e-9), 2 / np.abs(np.sin(angles)).clip(1e-9))
        beams = " ".join(f"{reading or r:.3f}" for r in ranges)
        pose = f"{x + jump * (k >= 20):.4f} 0 0"
        lines.append(f"FLASER 181 {beams} {pose} {pose} {100 + 0.2 * k:.2f} host {100 + 0.2 * k:.2f}\n")
    path.write_text("".join(lines))
    return path


@pytest.fixture
def blind(tmp_path: Path) -> Path:
    return log(tmp_path / "blind.log", reading=81.83)


@pytest.fixture
def jumping(tmp_path: Path) -> Path:
    return log(tmp_path / "jumping.log", jump=30.0)


@pytest.mark.parametrize("command", ["replay", "evaluate", "compare", "figures"])
def test_what_is_wrong_is_refused(run: Run, blind: Path, tmp_path: Path, command: str) -> None:
    out = tmp_path / "out"
    options: dict[str, list[object]] = {
        "replay": ["--export", out],
        "evaluate": [],
        "compare": ["--config", "paper", "--config", "default", "--save", out / "x.rrd"],
        "figures": [out],
    }
    status, shown, err = run(command, blind, *options[command], "-q")
    assert (status, shown) == (2, "")
    (line,) = err.splitlines()
    assert line.startswith(f"pfslam-viz: {blind}: lidar: no scan has a return")
    assert line.endswith("; --force replays it anyway")
    assert not out.exists()


@pytest.mark.parametrize("command", ["replay", "compare", "figures", "evaluate"])
def test_a_forced_run_that_comes_out_empty_fails_and_leaves_no_file(
    run: Run, blind: Path, tmp_path: Path, command: str
) -> None:
    options: dict[str, list[object]] = {
        "replay": ["--export", tmp_path / "out", "--save", tmp_path / "x.rrd", *PAPER],
        "compare": ["--config", "paper,particles=20", "--config", "paper", "--save", tmp_path / "x.rrd"],
        "figures": [tmp_path / "figures", *PAPER],
        "evaluate": [*PAPER],
    }
    status, shown, err = run(command, blind, "--force", *options[command], "-q")
    assert (status, shown) == (1, "")
    first, last = err.splitlines()
    assert first.startswith("wrong: lidar: no scan has a return")
    assert "came out empty: no cell of the map is occupied" in last and last.startswith(f"pfslam-viz: {blind}")
    assert list(tmp_path.iterdir()) == [blind]


@pytest.mark.parametrize("quiet", [[], ["-q"]])
def test_what_is_doubtful_is_told_before_and_after(run: Run, jumping: Path, tmp_path: Path, quiet: list[str]) -> None:
    status, _, err = run("replay", jumping, "--export", tmp_path / "out", *PAPER, *quiet)
    assert status == 0
    lines = [line for line in err.splitlines() if "30.05 m" in line]
    assert len(lines) == 2
    assert all(line.startswith("doubtful: odometry: jumps") and "at scan 20" in line for line in lines)
    written = json.loads((tmp_path / "out" / "metrics.json").read_text())
    (finding,) = written["findings"]
    assert (finding["severity"], finding["what"], finding["scan"]) == ("doubtful", "odometry_jump", 20)
    assert finding["message"] in lines[0] and finding["advice"] in lines[0]
    assert written["path_length_m"]["dead_reckoning"] == pytest.approx(1.95, abs=1e-3)


def test_evaluate_tells_doubts_on_stderr_alone(run: Run, jumping: Path) -> None:
    status, out, err = run("evaluate", jumping, *PAPER, "--no-paper", "--json", "-q")
    assert status == 0
    assert json.loads(out)["scans"] == 40
    assert [line.split(":")[0] for line in err.splitlines()] == ["doubtful", "doubtful"]


def test_a_name_that_does_not_exist_comes_before_a_missing_screen(run: Run, jumping: Path, tmp_path: Path) -> None:
    for arguments in (["replay", "nowhere"], ["compare", "nowhere", "--config", "paper", "--config", "default"]):
        status, _, err = run(*arguments, "--data", tmp_path)
        assert status == 2
        assert "no recording 'nowhere'" in err and "screen" not in err
    assert "screen" in run("replay", jumping)[2]


def test_info_is_a_page(run: Run, jumping: Path, blind: Path) -> None:
    status, page, err = run("info", jumping)
    assert (status, err) == (0, "")
    lines = page.splitlines()
    assert lines[0] == "jumping: 1 doubt"
    assert any(line.startswith("lidar     181 beams over 180°, 5 Hz, 0.05 to 80 m, 0.0 %") for line in lines)
    assert any(line.startswith("doubtful  odometry: jumps, 30.05 m") for line in lines)
    assert any("→ look whether the map is whole there" in line for line in lines)
    assert "longest gap" not in page
    assert "longest gap" in run("info", jumping, "--verbose")[1]
    status, page, _ = run("info", blind)
    assert status == 0
    assert page.startswith("blind: cannot be replayed: lidar: no scan has a return")


def test_info_as_json(run: Run, jumping: Path, tmp_path: Path) -> None:
    about = json.loads(run("info", jumping, "--json")[1])
    assert about["verdict"] == "1 doubt"
    assert [finding["what"] for finding in about["findings"]] == ["odometry_jump"]
    assert json.loads(run("info", log(tmp_path / "good.log"), "--json")[1])["verdict"] == "good"


def test_the_recordings_page_and_the_metrics(jumping: Path) -> None:
    recording = pf.load_recording(jumping)
    page = about_page(recording, [pf.load_config("paper")])
    assert "## Doubtful\n\n- odometry: jumps, 30.05 m" in page
    result = pf.run(recording, pf.load_config("paper", ["particles=20"]))
    assert [finding["what"] for finding in metrics(result)["findings"]] == ["odometry_jump"]


def test_arrays_are_checked_as_files_are(jumping: Path) -> None:
    drive = pf.load_recording(log(jumping.with_name("good.log")))
    odometry = drive.odometry.copy()
    odometry[7] += (30.0, 0, 0)
    paper = pf.load_config("paper", ["particles=20"])

    def arrays(ranges: object) -> pf.Recording:
        return pf.Recording.from_arrays(drive.stamps, ranges, drive.lidar.angles, odometry, range_max=80)  # type: ignore[arg-type]

    for result in (pf.run(arrays(drive.ranges), paper), pf.Replay(arrays(drive.ranges), paper).result()):
        assert [finding.what for finding in result.recording.findings] == ["odometry_jump"]
        assert result.recording.odometry[7, 0] == pytest.approx(0.05)
    nothing = np.zeros_like(drive.ranges)
    for run_it in (pf.run, pf.Replay):
        with pytest.raises(pf.InputError, match="no scan has a return"):
            run_it(arrays(nothing), paper)
    assert pf.run(arrays(nothing), paper, force=True).hollow == "no cell of the map is occupied"
