"""Whole drives with another camera than their robot file tells: it is found, told, and the floor is where it is."""

import io
import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

import pfslam_viz as pf
from pfslam_viz.commands.summary import summary
from pfslam_viz.evaluation.metrics import metrics
from pfslam_viz.recordings.ece276a import load
from pfslam_viz.recordings.info import describe
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.settings import TextureConfig
from pfslam_viz.simulation.buildings import build
from pfslam_viz.simulation.camera_errors import CameraErrors
from pfslam_viz.simulation.drive import DriveConfig, drive_along
from pfslam_viz.simulation.recording import simulate
from pfslam_viz.simulation.world import World
from pfslam_viz.texture.floor_camera import find_camera
from pfslam_viz.texture.painter import TexturePainter
from pfslam_viz.viewer.pages import about_page

Colors = Callable[[World, NDArray[np.float64]], NDArray[np.float64]]
CELL = 0.07
TOLD = math.degrees(0.36)
REAL = {"noise": 1.25, "holes": 0.01}  # as measured on the real image


def office(folder: Path, camera: CameraErrors, duration: float = 10.0) -> tuple[Recording, World]:
    recording = load(simulate(folder / "drive", seed=9, duration=duration, camera=camera))
    plan_rng, drive_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(9).spawn(6)[:2])
    world = build("office", plan_rng)
    return recording, world.seen_from(drive_along(world.route, drive_rng, DriveConfig(), duration).poses[0])


@pytest.mark.parametrize(
    ("pitch", "roll", "height"), [(5.0, 0.0, 0.05), (-5.0, 3.0, -0.05), (2.0, -5.0, 0.0), (0.0, 0.0, 0.0)]
)
def test_the_camera_is_found(pitch: float, roll: float, height: float, tmp_path: Path) -> None:
    errors = CameraErrors(TOLD + pitch, roll, 0.507 + height, **REAL)
    recording, _ = office(tmp_path, errors, 8.0)
    assert recording.frames is not None
    camera = find_camera(recording.frames)
    assert camera.source == "fitted" and camera.frames > 6
    assert math.degrees(camera.geometry.pitch) == pytest.approx(TOLD + pitch, abs=0.2)
    assert math.degrees(camera.geometry.roll) == pytest.approx(roll, abs=0.2)
    assert camera.geometry.position[2] == pytest.approx(0.507 + height, abs=0.005)
    assert (camera.note is None) == (pitch == roll == height == 0.0)


@pytest.fixture(scope="module")
def tilted(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, World]:
    """Three degrees and three centimetres off."""
    return office(tmp_path_factory.mktemp("tilted"), CameraErrors(TOLD + 3.0, 1.0, 0.477, **REAL), 14.0)


def painted(recording: Recording, config: TextureConfig) -> TexturePainter:
    assert recording.frames is not None and recording.truth is not None
    painter = TexturePainter(recording.frames, config, CELL)
    for stamp, pose in zip(recording.truth.stamps, recording.truth.poses, strict=True):
        painter.add_pose(stamp, pose)
    painter.finish()
    return painter


def test_the_floor_is_painted_within_a_cell(tilted: tuple[Recording, World], floor_colors: Colors) -> None:
    """The colours fit the simulated floor best where they are: shifts by a cell along any axis fit worse."""
    recording, world = tilted
    texture = painted(recording, TextureConfig()).texture
    cells = np.argwhere(texture.weight > 20)
    assert len(cells) > 2000

    def misfit(down: float, right: float) -> float:
        x = (cells[:, 1] + 0.5 + right - texture.origin[1]) * CELL
        y = (texture.origin[0] - cells[:, 0] - 0.5 - down) * CELL
        true = floor_colors(world, np.stack([x, y], axis=-1))
        return float(np.mean(np.abs(texture.color[cells[:, 0], cells[:, 1]] - true)))

    here = misfit(0, 0)
    beside = [misfit(*shift) for shift in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    assert here < 12.0  # of 255, tile edges and the feet of walls among them
    assert min(beside) > here + 3.0


def test_as_filed_much_less_is_painted(tilted: tuple[Recording, World]) -> None:
    recording, _ = tilted
    fitted, filed = (painted(recording, TextureConfig(camera=which)) for which in ("fitted", "filed"))
    assert filed.camera.source == "filed" and filed.camera.geometry == recording.frames.camera  # type: ignore[union-attr]
    assert (filed.texture.weight > 0).sum() < 0.8 * (fitted.texture.weight > 0).sum()


def test_everybody_is_told(tilted: tuple[Recording, World]) -> None:
    recording = tilted[0].select(0, 250)
    for name, source, pitch in (("default", "fitted", TOLD + 3.0), ("paper", "filed", TOLD)):
        config = pf.load_config(name, ["particles=2"])
        result = pf.run(recording, config)
        values = json.loads(json.dumps(metrics(result)))
        keys = {"source", "pitch_deg", "roll_deg", "height_m", "frames", "spread_deg", "own_plane_frames"}
        assert set(values["camera"]) == keys and values["camera"]["own_plane_frames"] == 0
        assert values["camera"]["source"] == source
        assert values["camera"]["pitch_deg"] == pytest.approx(pitch, abs=0.2)
        assert values["camera"]["frames"] > 10 and values["camera"]["spread_deg"] < 0.3
        assert [f["severity"] for f in values["findings"] if f["what"] == "camera"] == ["note"]
        page = about_page(recording, [config])
        assert "## Camera" in page and "20.63°" in page and f"{math.degrees(result.camera.found[0]):.2f}°" in page  # type: ignore[union-attr,index]
        console = Console(width=300, record=True, file=io.StringIO())
        console.print(summary(result, 1.0))
        assert ("fitted to" if source == "fitted" else "as filed: 20.63° down") in console.export_text()
    about = describe(recording)
    assert about["camera"]["source"] == "fitted"  # type: ignore[index]
    assert about["camera"]["pitch_deg"] == pytest.approx(TOLD + 3.0, abs=0.2)  # type: ignore[index]
    assert [f["severity"] for f in about["findings"] if f["what"] == "camera"] == ["note"]  # type: ignore[attr-defined]


def test_the_filter_does_not_care(tilted: tuple[Recording, World]) -> None:
    recording = tilted[0].select(0, 120)
    runs = [
        pf.run(recording, pf.load_config("default", ["particles=2", f"texture.camera={which}"]))
        for which in ("fitted", "filed")
    ]
    np.testing.assert_array_equal(runs[0].estimate, runs[1].estimate)
    np.testing.assert_array_equal(runs[0].grid.log_odds, runs[1].grid.log_odds)
    assert runs[0].texture is not None and runs[1].texture is not None
    assert runs[0].texture.shape != runs[1].texture.shape or (runs[0].texture.color != runs[1].texture.color).any()


def test_the_camera_is_described_without_the_kernels(tilted: tuple[Recording, World]) -> None:
    code = (
        "import sys; from pfslam_viz.recordings.info import describe_path\n"
        f"about = describe_path({str(tilted[0].path)!r})\n"
        "print(about['camera']['source'], [m for m in ('numba', 'scipy', 'rerun') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "fitted []"
