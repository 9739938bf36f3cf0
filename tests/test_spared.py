"""Imports that are spared fail as if nothing were installed, and only meanwhile."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from pfslam_viz.simulation.recording import simulate
from pfslam_viz.spared import spared


def test_an_import_is_spared_for_a_while() -> None:
    with spared("wave"), pytest.raises(ImportError):
        import_module("wave")
    assert import_module("wave").open


def test_what_is_imported_stays() -> None:
    with spared("json"):
        assert import_module("json") is sys.modules["json"]
    assert sys.modules["json"] is not None


def test_a_replay_imports_no_pandas(tmp_path: Path) -> None:
    """Where a package of that name can be imported, which says so."""
    (tmp_path / "pandas.py").write_text("print('pandas was imported')")
    drive = simulate(tmp_path / "drive", seed=3, duration=8.0, frames=False)
    code = "import sys; from pfslam_viz.cli import main; sys.argv[0] = 'pfslam-viz'; main()"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); {code}",
         "replay", str(drive), "--config", "paper", "-q", "--save", str(tmp_path / "out.rrd")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout + done.stderr == "" and (tmp_path / "out.rrd").stat().st_size > 0


def test_where_others_share_the_process_pandas_is_not_refused(tmp_path: Path) -> None:
    """Pyarrow asks for it once and remembers the answer, so that others' nanoseconds could not be read any more."""
    pytest.importorskip("pandas")
    drive = simulate(tmp_path / "drive", seed=3, duration=8.0, frames=False)
    arguments = ["replay", str(drive), "--config", "paper", "-q", "--save", str(tmp_path / "out.rrd")]
    code = f"""
from pfslam_viz.cli import call
assert call({arguments!r}) == 0
import pyarrow
print(pyarrow.scalar(25547742, pyarrow.duration("ns")).as_py().value)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "25547742\n"
