"""The plane of the floor against images that are worked out from the scene's geometry, and the one real image."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.robot import CameraGeometry
from pfslam_viz.texture.floor_plane import down_of, fit_floor

FILED = CameraGeometry(position=(0.3, 0.0, 0.507), pitch=math.radians(18))


def seen(
    pitch: float, roll: float, height: float, *, wall: float = math.inf, table: float | None = None, noise: float = 0.0
) -> NDArray[np.uint16]:
    """What a camera sees that is turned by ``pitch``, ``roll`` (deg): floor, a wall so far ahead, a table beside it.

    In the robot's axes, by turning every ray: first about x (the roll), then about y (the pitch).
    """
    v, u = np.mgrid[:480, :640]
    x, y, z = np.ones(v.shape), -(u - 315.83800193) / 585.05108211, -(v - 242.94140713) / 585.05108211
    c, s = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    y, z = c * y - s * z, s * y + c * z
    c, s = math.cos(math.radians(pitch)), math.sin(math.radians(pitch))
    x, z = c * x + s * z, -s * x + c * z
    with np.errstate(divide="ignore"):
        depth = np.where(z < 0, -height / z, np.inf)
        depth = np.minimum(depth, np.where(x > 0, wall / x, np.inf))
        if table is not None:
            on = np.where(z < 0, (table - height) / z, np.inf)
            depth = np.where(on * y > 0.25, np.minimum(depth, on), depth)
    d = (3.31 - 1.03 / depth) / 0.00304 + noise * np.random.default_rng(2).standard_normal(v.shape)
    return np.where((depth < 8.0) & (d > 0), np.rint(d), 2047).astype(np.uint16)


@pytest.mark.parametrize(
    ("pitch", "roll", "height"), [(18, 0, 0.507), (23, 4, 0.55), (13, -5, 0.46), (22, 0, 0.507), (18, 2, 0.48)]
)
@pytest.mark.parametrize("noise", [0.0, 1.2])
def test_finds_the_camera_over_a_floor_with_a_wall(pitch: float, roll: float, height: float, noise: float) -> None:
    plane = fit_floor(seen(pitch, roll, height, wall=1.9, noise=noise), FILED)
    assert plane is not None
    assert math.degrees(plane.pitch) == pytest.approx(pitch, abs=0.1)
    assert math.degrees(plane.roll) == pytest.approx(roll, abs=0.1)
    assert plane.height == pytest.approx(height, abs=0.003)
    assert plane.noise == pytest.approx(math.hypot(noise, 12**-0.5), abs=0.15)  # rounding: a step over sqrt(12)


def test_a_table_beside_the_way_is_not_the_floor() -> None:
    plane = fit_floor(seen(20, 1, 0.51, wall=3.0, table=0.09, noise=1.0), FILED)
    assert plane is not None
    assert math.degrees(plane.pitch) == pytest.approx(20, abs=0.2)
    assert plane.height == pytest.approx(0.51, abs=0.005)


def test_planes_far_from_the_prior_are_no_floor() -> None:
    assert fit_floor(seen(30, 0, 0.507), FILED) is None  # 12 degrees off
    assert fit_floor(seen(18, 0, 0.70), FILED) is None  # 19 cm off
    assert fit_floor(seen(26, 0, 0.507), FILED) is not None
    assert fit_floor(seen(18, 0, 0.507, wall=0.55), FILED) is None  # a wall, and a strip of floor before it


def test_images_without_a_floor() -> None:
    assert fit_floor(np.full((480, 640), 2047, np.uint16), FILED) is None
    assert fit_floor(np.zeros((480, 640), np.uint16), FILED) is None
    noise = np.random.default_rng(1).integers(0, 2048, (480, 640), dtype=np.uint16)
    assert fit_floor(noise, FILED) is None


def test_down_is_the_direction_of_falling() -> None:
    """Against the transform that the texture uses."""
    camera = FILED.model_copy(update={"pitch": 0.3, "roll": -0.2, "yaw": 0.7})
    np.testing.assert_allclose(camera.robot_from_optical()[:3, :3] @ down_of(0.3, -0.2), [0, 0, -1], atol=1e-12)


def test_the_real_image(shared_data: Path) -> None:
    """Another program's fit (DATA.md): 20.70° down, roll 0.26°, 0.504 m, from priors up to 8° and 10 cm away."""
    image = cv2.imread(str(shared_data / "real" / "disparity.png"), cv2.IMREAD_UNCHANGED)
    assert image is not None
    for pitch, height in ((18, 0.507), (20.6, 0.507), (13, 0.6), (28, 0.41)):
        prior = FILED.model_copy(update={"pitch": math.radians(pitch), "position": (0.3, 0.0, height)})
        plane = fit_floor(image, prior)
        assert plane is not None
        assert math.degrees(plane.pitch) == pytest.approx(20.70, abs=0.1)
        assert math.degrees(plane.roll) == pytest.approx(0.26, abs=0.1)
        assert plane.height == pytest.approx(0.504, abs=0.002)
