import numpy as np
import pytest

from pfslam_viz.config import load_robot
from pfslam_viz.settings import TextureConfig
from pfslam_viz.texture.floor_texture import FloorTexture
from pfslam_viz.texture.kinect import FloorView, depth_from_disparity


def test_depth_from_disparity_by_hand() -> None:
    # dd = 3.31 - 0.00304 * 750 = 1.03 exactly: one metre.
    assert depth_from_disparity(750) == pytest.approx(1.0)
    assert depth_from_disparity([400, 1000]) == pytest.approx([1.03 / 2.094, 1.03 / 0.27])
    assert np.isinf(depth_from_disparity([1089, 2047])).all()
    assert depth_from_disparity(np.zeros((2, 3), np.uint16)).shape == (2, 3)


def test_a_view_has_the_ray_of_every_pixel() -> None:
    camera = load_robot("ece276a-paper").ground_camera()
    assert camera is not None
    view = FloorView.of(camera, 0.05, 4.0)
    pose = camera.robot_from_optical()
    rng = np.random.default_rng(0)
    for v, u in zip(rng.integers(125, 480, 300), rng.integers(0, 640, 300), strict=True):
        optical = [(u - 315.83800193) / 585.05108211, (v - 242.94140713) / 585.05108211, 1.0]
        np.testing.assert_allclose(view.by_row[v - 125] + view.by_column[:, u], pose[:3, :3] @ optical, atol=1e-6)
    np.testing.assert_array_equal(view.position, pose[:3, 3])


def test_first_row_and_reach_by_hand() -> None:
    """With the camera 18 degrees down and 0.507 m high; 4 m ahead of it floor within 5 cm begins at atan(0.457 / 4)."""
    camera = load_robot("ece276a-paper").ground_camera()
    assert camera is not None
    view = FloorView.of(camera, 0.05, 4.0)
    # 6.518 degrees down are 11.482 above the optical axis: 585.051 * tan(11.482 deg) = 118.84 rows above 242.94.
    assert view.first_row == 125 and view.by_row.shape == (355, 3)
    # Its colours are (526.37 * 125 + 16662) / 585.051 = 140.9 rows down.
    assert view.first_color_row == 141 and view.color_rows[0] == 0
    disparity, color = np.arange(480 * 640, dtype=np.uint16).reshape(480, 640), np.zeros((480, 640, 3), np.uint8)
    color[141] = 7
    below, colors = view.crop(disparity, color)
    np.testing.assert_array_equal(below, disparity[125:])
    assert colors.shape == (339, 640, 3) and (colors[0] == 7).all()
    # The farthest point is in the image's corner column 639, 4 m ahead: per metre of depth that ray goes 0.5524 to the
    # side and cos(18 deg) + sin(18 deg) * 118/585 = 1.0133 ahead: 2.18 m aside, 4.333 ahead of the robot's origin.
    assert view.reach == pytest.approx(np.hypot(4.0 + 0.33276, 4.0 * 0.5524 / 1.0133), abs=0.02)


def test_a_camera_that_looks_up_sees_no_floor() -> None:
    camera = load_robot("ece276a-paper").ground_camera()
    assert camera is not None
    view = FloorView.of(camera.model_copy(update={"pitch": -0.9}), 0.05, 4.0)
    assert view.reach == 0.0
    texture = FloorTexture(camera.model_copy(update={"pitch": -0.9}), TextureConfig(), 0.05)
    for disparity in (
        np.full((480, 640), 750, np.uint16),
        np.arange(480 * 640, dtype=np.uint16).reshape(480, 640) % 1089,
    ):
        assert texture.add(disparity, np.zeros((480, 640, 3), np.uint8), (0.0, 0.0, 0.0)) == 0
