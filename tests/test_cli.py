"""The command line: options, exit statuses, what is printed where, and what is left on disk."""

import errno
import http.server
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pfslam_viz
from pfslam_viz.commands.choices import ConfigChoice, SinkChoice
from pfslam_viz.config import load_config
from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.slam.paper.settings import PaperConfig
from pfslam_viz.slam.worker import cores

ROOT = Path(__file__).resolve().parents[1]
SINKS = "--save --spawn --serve --web --bind --connect --stdout"
SCANS = "--data --robot --start --stop --stride --force"
OPTIONS = {
    "replay": f"{SINKS} {SCANS} --export --config --set --particles --seed --map-every --max-particles --max-beams"
    " --quiet",
    "recordings": "--data --json",
    "info": "--data --robot --verbose --json",
    "fetch": "--data --rgbd --every --base-url --connections --quiet",
    "simulate": "--seed --duration --building --frames --no-frames --wheel-scale --slip --gyro-bias",
    "evaluate": f"{SCANS} --config --set --particles --seeds --json --quiet",
    "compare": f"{SINKS} {SCANS} --config --set --particles --seed --map-every --max-particles --max-beams --quiet",
    "figures": f"{SCANS} --every --config --set --particles --seed --quiet",
    "video": "--view --from --to --speed --step --size --width --quiet",
    "sweep": f"{SCANS} --config --set --seeds --out --plan --by --scheduler --workers --redo-old --keep-old --quiet",
}
HEAVY = ("rerun", "cv2", "numba", "scipy", "numpy", "pydantic", "pooch", "dask", "distributed")

Run = Callable[..., tuple[int, str, str]]

pytestmark = pytest.mark.usefixtures("no_screen")


def one_line(text: str) -> str:
    """The error that a run ended with: one line, of the program's name."""
    lines = text.splitlines()
    assert lines[-1].startswith("pfslam-viz: ")
    assert sum(line.startswith("pfslam-viz: ") for line in lines) == 1
    assert "Traceback" not in text
    return lines[-1]


def python(code: str) -> str:
    """What a fresh interpreter prints."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


def loaded_by(arguments: list[str], modules: Sequence[str]) -> list[str]:
    """The exit status of a command in a fresh interpreter, and which of ``modules`` it imported."""
    shown = python(
        f"import sys\nfrom pfslam_viz.cli import call\nstatus = call({arguments})\n"
        f"print('\\nLOADED', status, *[m for m in {tuple(modules)} if m in sys.modules])"
    )
    return shown.splitlines()[-1].split()[1:]


# Help and imports


@pytest.mark.parametrize("statement", ["import pfslam_viz", "from pfslam_viz.cli import call; call(['--help'])"])
def test_start_up_imports_nothing_heavy(statement: str) -> None:
    loaded = python(f"{statement}\nimport sys\nprint('LOADED', *[m for m in {HEAVY} if m in sys.modules])")
    assert loaded.splitlines()[-1].split() == ["LOADED"]


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        (["recordings"], 0),
        (["info", "{drive}"], 0),
        (["fetch", "intel", "--quiet", "--base-url", "{empty}"], 1),
    ],
)
def test_commands_about_recordings_load_no_filter_and_no_viewer(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], status: int
) -> None:
    monkeypatch.setenv("PFSLAM_RECORDINGS", str(tmp_path))
    empty_folder = partial(http.server.SimpleHTTPRequestHandler, directory=tmp_path)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), empty_folder) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        line = [argument.format(drive=drive, empty=f"http://127.0.0.1:{server.server_port}") for argument in arguments]
        loaded = loaded_by(line, ("rerun", "cv2", "numba", "scipy", "matplotlib"))
        server.shutdown()
    assert loaded == [str(status)]


def test_a_replay_loads_no_dask(drive: Path, tmp_path: Path) -> None:
    line = ["replay", str(drive), "--stop", "5", "--save", str(tmp_path / "out.rrd"), "--config", "paper", "--quiet"]
    assert loaded_by(line, ("dask", "distributed")) == ["0"]


def test_the_demo_is_looked_up_without_its_simulator(drive: Path, tmp_path: Path) -> None:
    """A copy of the drive stands in for a demo that was made before: its manifest says so."""
    demo = tmp_path / "demo"
    shutil.copytree(drive, demo)
    manifest = json.loads((demo / "simulation.json").read_text())
    (demo / "simulation.json").write_text(json.dumps(manifest | {"building": "office", "seed": 9}))
    assert loaded_by(["info", "demo", "--data", str(tmp_path)], ("cv2", "numba")) == ["0"]


def test_kernels_load_without_scipys_linear_algebra_which_can_be_imported_later() -> None:
    loaded = python(
        "import sys\nfrom pfslam_viz.compiling.compile import compile_all\n"
        "from pfslam_viz.compiling.needed import Needed\ncompile_all(Needed(('slam.kernels.compose',)))\n"
        "print('scipy.linalg' in sys.modules)\nimport scipy.linalg.cython_blas as blas\nprint(blas.__name__)"
    )
    assert loaded.split() == ["False", "scipy.linalg.cython_blas"]


@pytest.mark.skipif(not Path("/proc/self/task").is_dir() or cores() == 1, reason="no threads to be counted")
def test_numpys_own_threads_are_left_out() -> None:
    start = (
        "import os, sys\nfrom pfslam_viz import cli\nsys.argv[1:] = ['--version']\n"
        "for who in ('OPENBLAS', 'OMP', 'MKL'): os.environ.pop(f'{who}_NUM_THREADS', None)\n"
    )
    main = "try: cli.main()\nexcept SystemExit: pass\n"
    count = "import numpy\nprint(len(os.listdir('/proc/self/task')))"
    assert python(start + main + count).split()[-1] == "1"
    assert python(start + count).split()[-1] != "1"  # there are some to be left out


def test_a_request_to_terminate_is_an_interruption() -> None:
    lines = (
        "import os, signal, sys, typer",
        "from pfslam_viz import cli",
        "cli.app.command('wait')(lambda: os.kill(os.getpid(), signal.SIGTERM))",
        "sys.argv[1:] = ['wait']",
        "cli.main()",
    )
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "pfslam-viz: interrupted\n")


def test_help_names_every_command(run: Run) -> None:
    status, out, err = run("--help")
    assert status == 0, err
    assert all(command in out for command in OPTIONS)


@pytest.mark.parametrize("command", OPTIONS)
def test_help_of_a_command_has_its_options_and_an_example(run: Run, command: str) -> None:
    status, out, err = run(command, "--help")
    assert status == 0, err
    assert set(OPTIONS[command].split()) <= set(re.findall(r"--[a-z-]+", out))
    assert f"pfslam-viz {command}" in out.partition("Examples")[2]


def test_version(run: Run) -> None:
    assert run("--version")[:2] == (0, f"pfslam-viz {pfslam_viz.__version__}\n")


def test_no_command_shows_the_help_and_is_wrong_use(run: Run) -> None:
    status, out, err = run()
    assert status == 2
    assert "replay" in out + err


# Errors


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("replay", "RECORDING"),
        ("replay x --sve y", "--sve"),
        ("replai x", "replai"),
        ("replay x --particles 0", "--particles"),
        ("replay x --particles many", "--particles"),
        ("replay x --stride 0", "--stride"),
        ("replay nowhere --save x.rrd", "nowhere"),
        ("replay nowhere/at.clf --save x.rrd", r"nowhere/at\.clf"),
        ("replay x --save x.rrd --config nonesuch", "nonesuch"),
        ("replay x --save x.rrd --set map.cell=-1", r"map\.cell"),
        ("replay x --save x.rrd --spawn --connect rerun+http://127.0.0.1:1/proxy", "exclude each other"),
        ("replay x --save x.rrd --stdout", "--stdout goes alone"),
        ("replay x --save x.mp4", r"pass --save x\.rrd, and then pfslam-viz video x\.rrd x\.mp4"),
        ("info nowhere", "nowhere"),
        ("compare x --config paper --save x.rrd", "two configurations"),
        ("simulate . --duration 0.1", "duration"),
    ],
)
def test_wrong_use_is_status_2_and_one_line(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*line.split())
    assert status == 2
    assert out == ""
    assert re.search(message, one_line(err))
    assert not list(tmp_path.rglob("*.rrd"))


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (InputError("odd: file"), 2, "odd: file"),
        (PfslamError("broke"), 1, "broke"),
        (OSError(errno.ENOSPC, "No space left on device", "out.rrd"), 1, "out.rrd: No space left on device"),
        (MemoryError(), 1, "out of memory"),
        (ValueError("two\nlines"), 1, "ValueError: two lines; --debug shows where"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_goes_wrong_inside_a_command(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: BaseException, status: int, message: str
) -> None:
    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr("pfslam_viz.commands.recordings.run_list", fail)
    assert run("recordings") == (status, "", f"pfslam-viz: {message}\n")


@pytest.mark.parametrize("line", ["--debug recordings", "recordings --debug"])
def test_debug_shows_the_traceback_wherever_it_stands(run: Run, monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    def fail(*_: object) -> None:
        raise ValueError("deep")

    monkeypatch.setattr("pfslam_viz.commands.recordings.run_list", fail)
    status, _, err = run(*line.split())
    assert status == 1
    assert "Traceback" in err
    assert err.endswith("pfslam-viz: ValueError: deep\n")


# Replay


def test_replay_writes_a_recording_and_a_summary(run: Run, drive: Path, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    out = tmp_path / "new" / "out.rrd"
    status, shown, err = run("replay", drive, "--save", out, "--config", "paper", "--particles", "40", "--stop", "60")
    assert status == 0, err
    assert list(out.parent.iterdir()) == [out]
    paths = {str(path) for path in RrdReader(str(out)).store().schema().entity_paths()}
    assert any("particles" in path for path in paths)
    for word in ("path length", "end-to-start gap", "error against truth", "ms a scan", "resampled", "out.rrd"):
        assert word in shown
    assert "60 scans, 40 particles, seed 0" in shown


def test_the_summary_tells_the_trajectorys_length_and_gap(run: Run, drive: Path, tmp_path: Path) -> None:
    status, shown, err = run("replay", drive, "--export", tmp_path, "--config", "paper", "--particles", "30")
    assert status == 0, err
    row = {line.split("│")[1].strip(): line.split("│")[2:4] for line in shown.splitlines() if line.startswith("│")}
    for column, name in enumerate(("estimate", "dead_reckoning")):
        x, y = np.loadtxt(tmp_path / f"{name}.tum")[:, 1:3].T
        length, gap = np.hypot(np.diff(x), np.diff(y)).sum(), np.hypot(x[-1] - x[0], y[-1] - y[0])
        assert row["path length"][column].strip() == f"{length:.2f} m"
        assert row["end-to-start gap"][column].strip() == f"{gap:.2f} m"


def test_export_goes_without_a_recording_and_follows_every_choice(run: Run, drive: Path, tmp_path: Path) -> None:
    choices = "--config paper --particles 30 --seed 7 --set map.cell=0.1 --start 10 --stop 70 --stride 2 --quiet"
    assert run("replay", drive, "--export", tmp_path, *choices.split()) == (0, "", "")
    config = json.loads((tmp_path / "metrics.json").read_text())["config"]
    assert (config["name"], config["particles"], config["seed"], config["map"]["cell"]) == ("paper", 30, 7, 0.1)
    assert len((tmp_path / "estimate.tum").read_text().splitlines()) == 30
    assert {p.name for p in tmp_path.iterdir()} >= {"online.tum", "dead_reckoning.tum", "map.pgm", "map.yaml"}


def test_the_same_seed_gives_the_same_trajectory(run: Run, drive: Path, tmp_path: Path) -> None:
    options = "--config paper --particles 30 --stop 60 --quiet --seed"
    for folder, seed in (("a", 1), ("b", 1), ("c", 2)):
        assert run("replay", drive, "--export", tmp_path / folder, *options.split(), seed)[0] == 0
    a, b, c = ((tmp_path / folder / "estimate.tum").read_bytes() for folder in "abc")
    assert a == b
    assert a != c


def test_stdout_holds_the_recording_and_nothing_else(drive: Path) -> None:
    command = [sys.executable, "-m", "pfslam_viz", "replay", str(drive), "--stdout", "--config", "paper"]
    done = subprocess.run([*command, "--particles", "20", "--stop", "20"], capture_output=True, check=True)
    assert done.stdout[:4] == b"RRF2"
    assert b"path length" not in done.stdout
    assert b"path length" in done.stderr


@pytest.mark.parametrize("options", [[], ["--spawn"]])
def test_without_a_place_to_go_and_without_a_screen(run: Run, drive: Path, options: list[str]) -> None:
    status, out, err = run("replay", drive, *options)
    assert (status, out) == (2, "")
    assert "--save" in one_line(err)


def test_without_a_place_to_go_the_viewer_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pfslam_viz.commands.choices.has_screen", lambda: True)
    assert SinkChoice().or_viewer() == SinkChoice(spawn=True)
    assert SinkChoice(save=Path("x")).or_viewer() == SinkChoice(save=Path("x"))


@pytest.mark.parametrize("target", ["folder", "file/out.rrd"])
def test_an_output_that_cannot_be_written_ends_before_anything_is_read(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, target: str
) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("pfslam_viz.recordings.catalog.load_recording", lambda *_: pytest.fail("was read"))
    status, out, err = run("replay", "demo", "--save", tmp_path / target)
    assert (status, out) == (2, "")
    assert target.split("/")[0] in one_line(err)


@pytest.mark.parametrize("option", ["--start", "--stop"])
def test_no_scan_is_left(run: Run, drive: Path, tmp_path: Path, option: str) -> None:
    scans = {"--start": ["--start", 9999], "--stop": ["--start", 5, "--stop", 5]}[option]
    status, _, err = run("replay", drive, "--export", tmp_path / "out", *scans)
    assert status == 2
    assert "no scan is left" in one_line(err)
    assert not (tmp_path / "out").exists()


def at_scan(number: int, action: Callable[[], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """Do something while scan ``number`` is logged."""
    from pfslam_viz.viewer.stream import ReplayStream

    plain = ReplayStream.log

    def log(self: ReplayStream, step: Any) -> None:
        if step.index == number:
            action()
        plain(self, step)

    monkeypatch.setattr(ReplayStream, "log", log)


def replay_to(path: Path, drive: Path) -> list[object]:
    return ["replay", drive, "--save", path, "--config", "paper", "--particles", 20]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_keeps_what_it_has(
    run: Run, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
) -> None:
    from rerun.chunk import RrdReader

    at_scan(25, lambda: os.kill(os.getpid(), number), monkeypatch)
    before = signal.getsignal(number)
    status, shown, err = run(*replay_to(tmp_path / "out.rrd", drive))
    assert status == 130
    assert re.search(r"interrupted after scan 26 of \d+; .*out\.rrd holds them", one_line(err))
    assert "after 26 of" in shown
    assert list(tmp_path.iterdir()) == [tmp_path / "out.rrd"]
    assert RrdReader(str(tmp_path / "out.rrd")).store().schema().entity_paths()
    assert signal.getsignal(number) == before


@pytest.mark.parametrize(
    ("error", "message"),
    [(OSError(errno.ENOSPC, "No space left on device"), "No space left"), (RuntimeError("odd"), "RuntimeError: odd")],
)
def test_a_failing_run_leaves_no_file(
    run: Run, drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception, message: str
) -> None:
    def fail() -> None:
        raise error

    (tmp_path / "out.rrd").write_text("RRF2 an older recording of pfslam-viz")
    at_scan(25, fail, monkeypatch)
    status, out, err = run(*replay_to(tmp_path / "out.rrd", drive))
    assert (status, out) == (1, "")
    assert message in one_line(err)
    assert (tmp_path / "out.rrd").read_text() == "RRF2 an older recording of pfslam-viz"
    assert list(tmp_path.iterdir()) == [tmp_path / "out.rrd"]


# The other commands


def test_recordings_and_info_as_json(run: Run, drive: Path) -> None:
    status, out, err = run("recordings", "--data", drive.parent, "--json")
    assert status == 0, err
    names = {entry["name"]: entry["status"] for entry in json.loads(out)}
    assert names["drive"] == "here"
    assert {"demo", "20", "21", "23", "intel", "fr079"} <= names.keys()
    status, out, err = run("info", drive, "--json")
    assert status == 0, err
    assert json.loads(out)["lidar"]["beams"] == 1081


def test_recordings_and_info_as_tables(run: Run, drive: Path) -> None:
    assert "drive" in run("recordings", "--data", drive.parent)[1]
    page = run("info", "drive", "--data", drive.parent)[1]
    assert page.startswith("drive: good\n")
    assert re.search(r"^lidar +1,081 beams over 270°, 40\.1 Hz", page, re.MULTILINE)
    assert re.search(r"lidar · beams +1,081", run("info", "drive", "--data", drive.parent, "--verbose")[1])


def test_simulate_does_not_overwrite_other_files(run: Run, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    status, _, err = run("simulate", tmp_path, "--no-frames")
    assert status == 2
    one_line(err)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


def test_evaluate_as_json(run: Run, drive: Path) -> None:
    options = "--config paper,particles=20 --seeds 2 --stop 60 --no-paper --json --quiet"
    status, out, err = run("evaluate", drive, *options.split())
    assert (status, err) == (0, "")
    methods = {method["name"]: method for method in json.loads(out)["methods"]}
    assert methods.keys() == {"dead reckoning", "paper,particles=20"}
    assert [r["seed"] for r in methods["paper,particles=20"]["runs"]] == [0, 1]
    assert methods["paper,particles=20"]["runs"][0]["truth"]["position_rmse_m"] < 0.5


def test_evaluate_runs_the_paper_beside_it(run: Run, drive: Path) -> None:
    status, out, err = run("evaluate", drive, "--config", "paper,particles=20", "--stop", 30, "--quiet")
    assert status == 0, err
    assert all(name in out for name in ("dead reckoning", "paper,particles=20", "position rmse"))


def test_compare_puts_runs_into_one_file(run: Run, drive: Path, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    configs = ["--config", "paper,particles=10", "--config", "paper,particles=40"]
    status, out, err = run("compare", drive, *configs, "--stop", 40, "--save", tmp_path / "cmp.rrd")
    assert status == 0, err
    assert "paper,particles=10" in out
    paths = [str(path) for path in RrdReader(str(tmp_path / "cmp.rrd")).store().schema().entity_paths()]
    assert len([path for path in paths if path.endswith("/particles")]) == 2


def test_figures(run: Run, drive: Path, tmp_path: Path) -> None:
    options = ["--config", "paper", "--particles", 20, "--stop", 60, "--every", 30]
    assert run("figures", drive, tmp_path / "out", *options)[0] == 0
    pictures = re.findall(r'src="([^"]+)"', (tmp_path / "out" / "index.html").read_text())
    assert pictures
    assert all((tmp_path / "out" / picture).is_file() for picture in pictures)


# Choices


def test_a_configuration_with_settings_of_its_own() -> None:
    choice = ConfigChoice.parse("paper,particles=50,motion.variance=[0.1,0.2,0.3]", ("map.cell=0.1",), 99, 3)
    config = choice.load()
    assert config.name == "paper,particles=50,motion.variance=[0.1,0.2,0.3]"
    assert (config.particles, config.seed, config.map.cell) == (50, 3, 0.1)
    assert isinstance(config, PaperConfig) and config.motion.variance == (0.1, 0.2, 0.3)
    assert ConfigChoice.parse("paper", (), 99).load().particles == 99


def test_a_mistake_is_blamed_on_the_option_that_made_it() -> None:
    with pytest.raises(InputError, match=r"^--particles 1000000: 'particles' = 1000000"):
        ConfigChoice.parse("paper", (), 1_000_000).load()
    with pytest.raises(InputError, match=r"^--set map.cell=9: 'map.cell' = 9"):
        ConfigChoice.parse("paper,map.cell=9").load()
    assert ConfigChoice().load() == load_config("default")


# The README


def readme_commands() -> list[str]:
    """Every pfslam-viz command line in the code blocks of the README and of the documents."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    text = "".join(page.read_text(encoding="utf-8") for page in pages)
    blocks = re.findall(r"```(?:bash|sh)\n(.*?)```", text, re.DOTALL)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    parts = [part.strip() for line in lines for part in re.split(r"&&|\|", line.partition(" #")[0])]
    return [part for part in parts if part.startswith("pfslam-viz ")]


@pytest.mark.parametrize("line", readme_commands())
def test_the_readmes_commands_exist(run: Run, line: str) -> None:
    _, command, *arguments = shlex.split(line)
    status, out, _ = run(command, "--help")
    assert status == 0
    assert set(re.findall(r"--[a-z-]+", " ".join(arguments))) <= set(re.findall(r"--[a-z-]+", out))


def test_the_readme_names_the_test_command_where_ci_looks_for_it() -> None:
    found = re.findall(r"<!-- test command -->\n```bash\n(.+)\n```", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert found == ["pip install -e '.[dev]' && python -m pytest -n 2 --dist loadfile"]
