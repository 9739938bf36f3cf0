"""Many frames' floors make one camera, or none."""

import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from pfslam_viz.config import load_robot
from pfslam_viz.recordings.recording import Frames
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.settings import TextureConfig
from pfslam_viz.texture.floor_camera import find_camera, settle
from pfslam_viz.texture.floor_plane import FloorPlane
from pfslam_viz.texture.floor_texture import FloorTexture
from pfslam_viz.texture.painter import TexturePainter

FILED = CameraGeometry(position=(0.3, 0.01, 0.507), pitch=math.radians(18), yaw=0.02)


def planes(count: int, tremor: float = 0.0, heights: float = 0.0) -> list[FloorPlane]:
    """21° down, roll 1°, 0.52 m; ``tremor`` (deg, each axis) and ``heights`` (m) are their standard deviations."""
    rng = np.random.default_rng(0)
    return [
        FloorPlane(
            math.radians(21 + tremor * rng.standard_normal()),
            math.radians(1 + tremor * rng.standard_normal()),
            0.52 + heights * rng.standard_normal(),
            0.4,
            1.0,
        )
        for _ in range(count)
    ]


def test_the_median_of_frames_that_agree() -> None:
    given = planes(30, 0.1, 0.002)
    given[3:8] = [replace(p, pitch=0.25, height=0.6) for p in given[3:8]]  # a step in some of them
    camera = settle(given, 32, FILED, "fitted")
    assert camera.source == "fitted" and camera.why_not == "" and camera.frames == 30
    assert math.degrees(camera.geometry.pitch) == pytest.approx(21, abs=0.08)
    assert math.degrees(camera.geometry.roll) == pytest.approx(1, abs=0.08)
    assert camera.geometry.position == pytest.approx((0.3, 0.01, 0.52), abs=0.002)
    assert camera.geometry.yaw == 0.02 and camera.filed is FILED
    assert math.degrees(camera.spread) == pytest.approx(0.1, abs=0.06)
    assert camera.as_dict()["spread_deg"] == pytest.approx(math.degrees(camera.spread), abs=1e-3)
    assert camera.note is not None and "18.00°" in camera.note and "with the former" in camera.note


def test_a_filed_camera_stays_and_the_note_says_what_was_seen() -> None:
    camera = settle(planes(30, 0.1), 32, FILED, "filed")
    assert camera.geometry is FILED and camera.source == "filed" and camera.found is not None
    assert camera.as_dict()["pitch_deg"] == 18.0
    assert camera.note is not None and "texture.camera=fitted" in camera.note


@pytest.mark.parametrize(
    ("given", "looked_at", "why"),
    [
        ([], 32, "in no disparity frame"),
        ([], 0, "no disparity frames"),
        (planes(2), 4, "2 of 4"),
        (planes(8), 32, "8 of 32"),
        (planes(30, 1.5), 32, "do not agree"),
        (planes(30, 0.05, 0.05), 32, "do not agree"),
    ],
)
def test_the_file_is_used_where_frames_do_not_agree(given: list[FloorPlane], looked_at: int, why: str) -> None:
    camera = settle(given, looked_at, FILED, "fitted")
    assert camera.geometry is FILED and camera.source == "filed" and camera.found is None
    assert why in camera.why_not and why in str(camera.note) and why in camera.text


def test_a_file_that_is_right_needs_no_note() -> None:
    near = [replace(p, pitch=math.radians(18.9), roll=0.0, height=0.525) for p in planes(5)]
    assert settle(near, 5, FILED, "fitted").note is None
    assert settle([replace(p, pitch=math.radians(19.1)) for p in near], 5, FILED, "fitted").note is not None
    assert settle([replace(p, height=0.53) for p in near], 5, FILED, "fitted").note is not None


def test_frames_that_cannot_be_read_do_not_matter(tmp_path: Path, shared_data: Path) -> None:
    good = shared_data / "real" / "disparity.png"
    small, broken = tmp_path / "small.png", tmp_path / "broken.png"
    assert cv2.imwrite(str(small), np.zeros((240, 320), np.uint16))
    broken.write_bytes(b"PNG")
    paths = (good, None, small, broken, tmp_path / "none.png", good, good)
    frames = Frames(np.zeros(0), (), np.arange(7.0), paths, FILED)
    camera = find_camera(frames)
    assert (camera.looked_at, camera.frames, camera.source) == (6, 3, "fitted")
    assert camera.as_dict() == {
        "source": "fitted",
        "pitch_deg": pytest.approx(20.7, abs=0.1),
        "roll_deg": pytest.approx(0.26, abs=0.1),
        "height_m": pytest.approx(0.504, abs=0.002),
        "frames": 3,
        "spread_deg": 0.0,
    }


def test_twin21_was_rendered_with_18_degrees(shared_data: Path) -> None:
    from pfslam_viz.recordings.ece276a import load

    frames = load(shared_data / "twin21").frames
    assert frames is not None
    camera = find_camera(replace(frames, camera=frames.camera.model_copy(update={"pitch": 0.36})))
    assert camera.source == "fitted" and math.degrees(camera.geometry.pitch) == pytest.approx(18, abs=0.03)
    assert camera.geometry.position[2] == pytest.approx(0.507, abs=0.001)


def test_a_fitted_camera_needs_half_the_tolerance() -> None:
    """A spread of 0.1° and 1 mm lets the floor 2 m ahead vary by 3.5 + 1 mm; twice that is added."""
    camera = replace(settle(planes(5), 5, FILED, "fitted"), spread=math.radians(0.1), height_spread=0.001)
    assert camera.tolerance(0.05) == pytest.approx(0.025 + 2 * (0.00349 + 0.001), abs=1e-4)
    assert replace(camera, spread=0.1).tolerance(0.05) == 0.05
    assert settle(planes(5), 5, FILED, "filed").tolerance(0.05) == 0.05


@pytest.mark.parametrize("robot", ["ece276a", "ece276a-paper"])
def test_the_floor_of_the_real_image_is_painted_and_little_else(robot: str, shared_data: Path) -> None:
    """Floor is what is within 6 disparities of the plane of DATA.md (20.70°, 0.26°, 0.504 m): 61 % of the image."""
    path = shared_data / "real" / "disparity.png"
    filed = load_robot(robot).ground_camera()
    assert filed is not None
    frames = Frames(np.arange(3.0), (path,) * 3, np.arange(3.0), (path,) * 3, filed)
    painter = TexturePainter(frames, TextureConfig(), 0.05)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None and painter.camera.source == "fitted"
    narrowed = TextureConfig(floor_tolerance=painter.texture.view.tolerance)
    v, u = np.mgrid[:480, :640]
    pitch, roll = math.radians(20.70), math.radians(0.26)
    down = math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch), math.sin(pitch)
    toward = down[0] * (u - 315.838) / 585.051 + down[1] * (v - 242.941) / 585.051 + down[2]
    expected = (3.31 - 1.03 * toward / 0.504) / 0.00304
    known = image < 1089
    floor = known & (np.abs(image - expected) < 6.0)
    assert floor.mean() == pytest.approx(0.61, abs=0.02)

    def painted(mask: np.ndarray) -> float:
        """Share of these pixels that are painted; every colour's pixel is in the image but for some at its left."""
        only = np.where(mask, image, 2047).astype(np.uint16)
        texture = FloorTexture(painter.camera.geometry, narrowed, 0.05)
        texture.add(only, np.zeros((480, 640, 3), np.uint8), (0.0, 0.0, 0.0))
        return float(texture.weight.sum() / mask.sum())

    inside = (526.37 * u - 4.5 * 1750.46 * (3.31 - 0.00304 * image) + 19276) / 585.051 >= 0.0
    assert painted(floor & inside) > 0.99
    assert painted(known & ~floor) < 0.03
