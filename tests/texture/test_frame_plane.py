"""A frame's own floor: images worked out from the scene's geometry, and a drive on which the robot rocks."""

import io
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from rich.console import Console

import pfslam_viz as pf
from pfslam_viz.commands.summary import summary
from pfslam_viz.evaluation.metrics import metrics
from pfslam_viz.recordings.ece276a import load
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.settings import TextureConfig
from pfslam_viz.simulation.buildings import build
from pfslam_viz.simulation.camera_errors import CameraErrors
from pfslam_viz.simulation.drive import DriveConfig, drive_along
from pfslam_viz.simulation.recording import simulate
from pfslam_viz.simulation.world import World
from pfslam_viz.texture import frame_plane
from pfslam_viz.texture.floor_camera import FloorCamera
from pfslam_viz.texture.floor_plane import FloorPlane
from pfslam_viz.texture.frame_plane import own_plane
from pfslam_viz.texture.kinect import FloorView
from pfslam_viz.texture.painter import TexturePainter
from pfslam_viz.viewer.pages import about_page

Colors = Callable[[World, NDArray[np.float64]], NDArray[np.float64]]
CAMERA = CameraGeometry(position=(0.3, 0.0, 0.507), pitch=math.radians(20))
VIEW = FloorView.of(CAMERA, 0.03, 4.0)
CELL = 0.07
TOLD = math.degrees(0.36)


def seen(
    pitch: float, roll: float, height: float, wall: float = math.inf, step: float = 0.0, noise: float = 1.2
) -> NDArray[np.uint16]:
    """A floor ``step`` m above the common one, seen by a camera turned so (deg) and ``height`` m above the common one.

    And a wall so many metres ahead. Rays in the robot's axes: turned about x, then about y.
    """
    v, u = np.mgrid[:480, :640]
    x, y, z = np.ones(v.shape), -(u - 315.83800193) / 585.05108211, -(v - 242.94140713) / 585.05108211
    c, s = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    z = s * y + c * z
    c, s = math.cos(math.radians(pitch)), math.sin(math.radians(pitch))
    x, z = c * x + s * z, -s * x + c * z
    with np.errstate(divide="ignore"):
        depth = np.minimum(np.where(z < 0, (step - height) / z, np.inf), np.where(x > 0, wall / x, np.inf))
    d = (3.31 - 1.03 / depth) / 0.00304 + noise * np.random.default_rng(2).standard_normal(v.shape)
    return np.where((depth < 8.0) & (d > 0), np.rint(d), 2047).astype(np.uint16)


def own(image: NDArray[np.uint16]) -> FloorPlane | None:
    return own_plane(image[VIEW.first_row :], VIEW, CAMERA)


@pytest.mark.parametrize(
    ("pitch", "roll", "height"), [(22, 0, 0.507), (18, 0, 0.507), (20, 3, 0.507), (26, -2, 0.52), (14, 0, 0.48)]
)
@pytest.mark.parametrize("wall", [math.inf, 2.0])
def test_a_tilted_floor_has_its_own_plane(pitch: float, roll: float, height: float, wall: float) -> None:
    plane = own(seen(pitch, roll, height, wall))
    assert plane is not None
    assert math.degrees(plane.pitch) == pytest.approx(pitch, abs=0.1)
    assert math.degrees(plane.roll) == pytest.approx(roll, abs=0.1)
    assert plane.height == pytest.approx(height, abs=0.003)


@pytest.mark.parametrize("wall", [math.inf, 3.0, 2.0, 1.2, 0.7])
def test_the_common_floor_has_none(wall: float) -> None:
    assert own(seen(20, 0, 0.507, wall)) is None
    # 0.3° lift the floor by 2.1 cm at 4 m, which is within the tolerance of 3 cm.
    assert own(seen(20.3, 0, 0.507, wall)) is None


def test_what_is_no_tilted_floor_has_none() -> None:
    assert own(seen(20, 0, 0.507, step=0.08)) is None  # a step, or a table over the whole view
    assert own(seen(20, 0, 0.507, wall=0.5)) is None
    assert own(seen(33, 0, 0.507)) is None  # farther off than a fit believes
    assert own(np.full((480, 640), 2047, np.uint16)) is None
    assert own(np.random.default_rng(1).integers(0, 2048, (480, 640), dtype=np.uint16)) is None


def test_floors_that_are_where_they_should_be_are_not_fitted(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr(frame_plane, "fit_floor", lambda *_: calls.append(1))
    assert own(seen(20, 0, 0.507)) is own(seen(20, 0, 0.507, wall=3.0)) is None
    assert calls == []
    own(seen(23, 0, 0.507))
    assert calls == [1]


@pytest.fixture(scope="module")
def rocking(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, World, list[int]]:
    """A drive of 14 s whose frames 12 to 19, which are counted from 1, look 3° farther down and lean by 1.5°."""
    folder, rocked = tmp_path_factory.mktemp("rocking"), list(range(12, 20))
    level, tilted = (CameraErrors(TOLD + more, lean, noise=1.25, holes=0.01) for more, lean in ((0.0, 0.0), (3.0, 1.5)))
    path = simulate(folder / "drive", seed=9, duration=14.0, camera=level)
    other = simulate(folder / "other", seed=9, duration=14.0, camera=tilted)
    for k in rocked:
        for name in (f"dataRGBD/RGB1/rgb1_{k}.png", f"dataRGBD/Disparity1/disparity1_{k}.png"):
            shutil.copyfile(other / name, path / name)
    plan_rng, drive_rng = (np.random.default_rng(s) for s in np.random.SeedSequence(9).spawn(6)[:2])
    world = build("office", plan_rng)
    return load(path), world.seen_from(drive_along(world.route, drive_rng, DriveConfig(), 14.0).poses[0]), rocked


def painted(
    recording: Recording, config: TextureConfig, only: list[int] | None = None, camera: FloorCamera | None = None
) -> TexturePainter:
    """Along the true poses; ``only`` the colour frames of these numbers."""
    frames = recording.frames
    assert frames is not None and recording.truth is not None
    if only is not None:
        k = np.array(only) - 1
        frames = replace(
            frames, color_stamps=frames.color_stamps[k], color_paths=tuple(frames.color_paths[i] for i in k)
        )
    painter = TexturePainter(frames, config, CELL, camera=camera)
    for stamp, pose in zip(recording.truth.stamps, recording.truth.poses, strict=True):
        painter.add_pose(stamp, pose)
    painter.finish()
    return painter


def test_frames_of_a_robot_that_rocks(
    rocking: tuple[Recording, World, list[int]], floor_colors: Colors, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They alone have planes of their own, and with these they fall where the floor is, within a cell.

    With the common plane, most of what they show is left out.
    """
    recording, world, rocked = rocking
    assert recording.frames is not None and recording.truth is not None
    painter = painted(recording, TextureConfig())
    assert painter.camera.source == "fitted" and painter.camera.geometry.pitch == pytest.approx(0.36, abs=0.002)
    assert painter.texture.tilted == len(rocked) == 8 and painter.texture.frames == painter.painted > 25
    again = painter.repaint(recording.truth.stamps, recording.truth.poses)
    assert again.tilted == 8 and np.array_equal(again.color, painter.texture.color)

    alone = painted(recording, TextureConfig(), rocked, painter.camera).texture
    assert alone.frames == alone.tilted == 8
    cells = np.argwhere(alone.weight > 20)
    assert len(cells) > 1000

    def misfit(down: float, right: float) -> float:
        x = (cells[:, 1] + 0.5 + right - alone.origin[1]) * CELL
        y = (alone.origin[0] - cells[:, 0] - 0.5 - down) * CELL
        true = floor_colors(world, np.stack([x, y], axis=-1))
        return float(np.mean(np.abs(alone.color[cells[:, 0], cells[:, 1]] - true)))

    here = misfit(0, 0)
    beside = [misfit(*shift) for shift in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    assert here < 12.0 and min(beside) > here + 3.0

    monkeypatch.setattr("pfslam_viz.texture.painter.own_plane", lambda *_: None)
    common = painted(recording, TextureConfig()).texture
    assert common.tilted == 0
    assert (common.weight > 0).sum() < 0.85 * (painter.texture.weight > 0).sum()


def test_nothing_rocks_on_a_steady_drive(shared_data: Path) -> None:
    recording = load(shared_data / "twin21")
    assert recording.truth is not None and recording.frames is not None
    painter = painted(recording.select(0, 1200), TextureConfig())
    assert painter.painted > 30 and painter.texture.tilted == 0


def test_everybody_is_told_of_the_tilt(rocking: tuple[Recording, World, list[int]]) -> None:
    recording = rocking[0]
    for name, tilted in (("default", 8), ("paper", 0)):
        config = pf.load_config(name, ["particles=2"])
        result = pf.run(recording, config)
        assert result.texture is not None
        assert json.loads(json.dumps(metrics(result)))["camera"]["own_plane_frames"] == tilted
        said = f"tilted in {tilted} of {result.texture.frames} frames"
        console = Console(width=300, record=True, file=io.StringIO())
        console.print(summary(result, 1.0))
        assert (said in console.export_text()) == (said in about_page(recording, [config], results={name: result}))
        assert (said in about_page(recording, [config], results={name: result})) == (tilted > 0)
