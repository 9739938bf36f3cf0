"""sweep.rrd read back: what is in it, and where the curves' points lie."""

import io
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.sweep.extremes import extremes
from pfslam_viz.sweep.page import write_page
from pfslam_viz.sweep.plan import Block, Cell, Plan, make_plan
from pfslam_viz.sweep.rerun_recording import BOX, write_recording
from pfslam_viz.sweep.results import Results
from pfslam_viz.sweep.summary import rankings
from pfslam_viz.viewer.connections import viewer_binary

ERRORS = {10: (0.4, 0.8), 100: (0.2, 0.4), 1000: (0.1, 0.3)}


def trace_of(cell: Cell) -> bytes:
    """A straight line to the east, as long as the error is large, on a map of 3 x 4 cells."""
    poses = np.zeros((5, 3), np.float32)
    poses[:, 0] = np.linspace(0, ERRORS[cell.config.particles][cell.seed], 5)
    buffer = io.BytesIO()
    image, corner = np.full((3, 4), 250, np.uint8), np.array([-1.0, 2.0])
    np.savez(buffer, estimate=poses, dead_reckoning=poses * 2, truth=poses * 0, image=image, cell=0.5, corner=corner)
    return buffer.getvalue()


@pytest.fixture
def study(tmp_path: Path) -> tuple[Plan, list[Cell], Results]:
    block = Block(("paper",), (("particles", tuple(str(n) for n in ERRORS)),))
    plan = make_plan([("a b/c", RecordingChoice("/a"))], [block], range(2))
    cells = plan.cells({"a b/c": "1"})
    results = Results(tmp_path, plan.keys)
    results.start(cells, "c1")
    for cell in cells:
        results.add(cell, {"position_rmse_m": ERRORS[cell.config.particles][cell.seed], "code": "c1"}, trace_of(cell))
    results.finish(cells)
    return plan, cells, results


def test_best_and_worst(study: tuple[Plan, list[Cell], Results]) -> None:
    plan, cells, results = study
    (ranking,) = rankings(plan, cells, results.of(cells))
    best, worst = extremes(plan, ranking, cells, results)
    assert best.title == "best: particles 1000, seed 0: position_rmse_m 0.1"
    assert worst.title == "worst: particles 10, seed 1: position_rmse_m 0.8"
    assert worst.trace.estimate[-1, 0] == pytest.approx(0.8)


def test_the_recording(study: tuple[Plan, list[Cell], Results], tmp_path: Path) -> None:
    plan, cells, results = study
    path = tmp_path / "sweep.rrd"
    write_recording(path, plan, rankings(plan, cells, results.of(cells)), cells, results)
    checked = subprocess.run([viewer_binary(), "rrd", "verify", path], capture_output=True, text=True, check=True)
    assert "1 file verified" in checked.stdout + checked.stderr
    found: dict[str, dict[str, Any]] = {}
    for chunk in RrdReader(str(path)).stream():
        rows = chunk.to_record_batch().to_pylist()
        found.setdefault(chunk.entity_path, {}).update({k.split(":")[-1]: v for k, v in rows[-1].items()})
    runs = [name for name in found if name.startswith("/0/runs/") and not name.endswith("truth")]
    assert len(runs) == len(cells)  # an entity each, to be switched on and off
    assert BOX == (160.0, 100.0)
    dots = np.array(found["/0/curves/particles/all/runs"]["positions"])
    np.testing.assert_allclose(dots[::2, 0], [0, 80, 160], atol=1e-4)
    np.testing.assert_allclose(dots[:2, 1], [-50, -100], atol=1e-4)  # up is smaller in 2-D views
    line = np.array(found["/0/worst/trajectory"]["strips"][0])
    np.testing.assert_allclose(line[[0, -1]], [[2.0, 4.0], [3.6, 4.0]], atol=1e-4)  # cells from the upper left
    assert "/0/best/map" in found and "/table" in found


def test_the_page(study: tuple[Plan, list[Cell], Results], tmp_path: Path) -> None:
    plan, cells, results = study
    found = rankings(plan, cells, results.of(cells))
    page = write_page(tmp_path, plan, found, [extremes(plan, found[0], cells, results)])
    text = page.read_text()
    for name in ("curves-0.png", "maps-0.png"):
        assert f'src="{name}"' in text
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert "<td>0.2 [0.1, 0.3]</td>" in text and "a b/c" in text
