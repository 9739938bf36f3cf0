"""The examples run, and show what they say."""

import importlib.util
import json
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import pfslam_viz as pf

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_own_arrays(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    example("own_arrays").main([str(tmp_path / "room.rrd")])
    reckoned, filtered = (float(number) for number in re.findall(r"([\d.]+) m", capsys.readouterr().out))
    assert reckoned > 0.1  # 5 % of 12.6 m and 3 % of a turn
    assert filtered < 0.01  # the noise of one range
    assert (tmp_path / "room.rrd").read_bytes()[:4] == b"RRF2"


def test_the_room_is_measured_right() -> None:
    module = example("own_arrays")
    first = module.drive().ranges[0]  # at (0, -2), looking along x, in a room of 10 x 8 m
    assert first[120] == pytest.approx(5.0, abs=0.05)  # ahead
    assert first[210] == pytest.approx(6.0, abs=0.05)  # 90 degrees to the left
    assert first[30] == pytest.approx(2.0, abs=0.05)  # to the right


def test_read_recording(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    room = example("own_arrays").drive(40)
    steps: list[pf.Step] = []
    config = pf.load_config("paper", ["particles=20"])
    pf.run(room, config, on_step=steps.append)
    pf.save(room, config, tmp_path / "room.rrd")
    module = example("read_recording")
    table = module.curves(tmp_path / "room.rrd").to_pydict()
    assert set(table) == {"step", "seconds", "n_eff/filter", "error/filter", "error/dead_reckoning"}
    assert table["step"] == list(range(40))
    np.testing.assert_allclose(table["seconds"], 0.1 * np.arange(40), atol=1e-6)
    np.testing.assert_allclose(table["n_eff/filter"], [step.estimate.n_eff for step in steps], rtol=1e-6)
    truth = np.array([step.truth for step in steps])
    reckoned = [step.dead_reckoning for step in steps]
    for name, poses in (("filter", [step.estimate.best for step in steps]), ("dead_reckoning", reckoned)):
        error = np.hypot(*(np.array(poses) - truth)[:, :2].T)
        np.testing.assert_allclose(table[f"error/{name}"], error, atol=1e-5)
    module.main([str(tmp_path / "room.rrd"), str(tmp_path / "room.csv")])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "40 scans in 3.9 s"
    worst = max(table["error/dead_reckoning"])
    assert re.search(rf"error/dead_reckoning .* highest +{worst:.3f} at scan \d+", lines[1])
    assert len((tmp_path / "room.csv").read_text().splitlines()) == 41


def test_compare_two_configs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    room = example("own_arrays").drive(40)
    module = example("compare_two_configs")
    read: list[str] = []

    def load(name: str) -> object:
        read.append(name)
        return room

    monkeypatch.setattr(module.pf, "load_recording", load)
    module.main([])
    module.main(["room", "default"])
    lines = capsys.readouterr().out.splitlines()
    assert read == ["demo", "room"]
    assert [line.split()[0] for line in lines] == ["room,", "paper", "default", "room,", "default", "default"]
    assert lines[4].split()[:5] == lines[5].split()[:5]  # the same run twice
    assert lines[1].split()[1] != lines[2].split()[1]


def test_the_notebook_was_executed_and_its_code_is_whole() -> None:
    """It is not executed here: that takes Jupyter."""
    cells = json.loads((EXAMPLES / "notebook.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    kinds = {output["output_type"] for cell in code for output in cell["outputs"]}
    assert kinds == {"stream", "execute_result", "display_data"}  # and no error
    source = "\n".join(line for cell in code for line in "".join(cell["source"]).splitlines() if line[0:1] != "!")
    compile(source, "notebook", "exec")
    commands = [line[1:].split() for cell in code for line in "".join(cell["source"]).splitlines() if line[0:1] == "!"]
    assert [command[:2] for command in commands] == [["pfslam-viz", "video"]]
