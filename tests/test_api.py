"""``import pfslam_viz``: what it offers, and what it costs."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pfslam_viz as pf


@pytest.fixture
def rest() -> pf.Recording:
    """Six scans of a robot at rest in a room."""
    angles = np.linspace(-1.5, 1.5, 61)
    ranges = np.tile(3.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles))), (6, 1))
    return pf.Recording.from_arrays(0.1 * np.arange(6), ranges, angles, np.zeros((6, 3)), name="rest")


def test_importing_the_package_imports_nothing_of_it() -> None:
    code = (
        "import sys; import pfslam_viz; print([m for m in sys.modules if m.startswith('pfslam_viz.')],"
        " 'numpy' in sys.modules); pfslam_viz.load_recording;"
        "print([m for m in ('numba', 'scipy', 'rerun', 'cv2') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split("\n")[:2] == ["[] False", "[]"]


def test_names() -> None:
    for name in pf.__all__:
        assert getattr(pf, name) is not None
        assert name in dir(pf)
    with pytest.raises(AttributeError, match="has no attribute 'walk'"):
        pf.walk  # noqa: B018


def test_run(rest: pf.Recording) -> None:
    steps: list[int] = []
    result = pf.run(rest, pf.load_config("paper", ["particles=20"]), on_step=lambda step: steps.append(step.index))
    assert steps == [0, 1, 2, 3, 4, 5]
    assert result.recording.checked and result.recording.stamps is rest.stamps
    assert result.config.particles == 20 and not result.interrupted
    assert result.estimate.shape == (6, 3)


def test_run_takes_names_and_paths(tmp_path: Path) -> None:
    log = tmp_path / "x.log"
    log.write_text("".join(f"FLASER 5 1 2 3 2 1 0 0 0 0 0 0 {k}.0 host {k}.0\n" for k in range(3)))
    assert pf.run(log, "paper").config.name == "paper"
    with pytest.raises(pf.InputError, match="no configuration"):
        pf.run(log, "nonsense")


def test_save(rest: pf.Recording, tmp_path: Path) -> None:
    from rerun.chunk import RrdReader

    path = tmp_path / "new" / "rest.rrd"
    result = pf.save(rest, pf.load_config("paper", ["particles=20"]), path)
    assert len(result.stamps) == 6
    assert "/world/filter/map" in RrdReader(str(path)).store().schema().entity_paths()
    assert [file.name for file in path.parent.iterdir()] == ["rest.rrd"]


@pytest.mark.parametrize("ending", [KeyboardInterrupt, RuntimeError])
def test_what_ends_a_run_early_leaves_no_file_and_the_old_one(
    rest: pf.Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: type[BaseException]
) -> None:
    from pfslam_viz.viewer.stream import ReplayStream

    def stop(*_: object) -> None:
        raise ending

    monkeypatch.setattr(ReplayStream, "log", stop)
    (tmp_path / "old.rrd").write_text("RRF2 pfslam-viz, old")
    for name in ("old.rrd", "new.rrd"):
        with pytest.raises(ending):
            pf.save(rest, pf.load_config("paper", ["particles=20"]), tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == ["old.rrd"]
    assert (tmp_path / "old.rrd").read_text() == "RRF2 pfslam-viz, old"
