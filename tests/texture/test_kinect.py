import numpy as np
import pytest

from pfslam_viz.config import load_robot
from pfslam_viz.texture.kinect import FloorView, depth_from_disparity


def test_depth_from_disparity_by_hand() -> None:
    # dd = 3.31 - 0.00304 * 750 = 1.03 exactly: one metre.
    assert depth_from_disparity(750) == pytest.approx(1.0)
    assert depth_from_disparity([400, 1000]) == pytest.approx([1.03 / 2.094, 1.03 / 0.27])
    assert np.isinf(depth_from_disparity([1089, 2047])).all()
    assert depth_from_disparity(np.zeros((2, 3), np.uint16)).shape == (2, 3)


def test_floor_view_agrees_with_the_height_of_every_point() -> None:
    camera = load_robot().ground_camera()
    assert camera is not None
    view = FloorView.of(camera, 0.05, 4.0)
    disparity = np.arange(2048)
    rng = np.random.default_rng(0)
    pose = camera.robot_from_optical()
    for v, u in zip(rng.integers(0, 480, 300), rng.integers(0, 640, 300), strict=True):
        depth = depth_from_disparity(disparity)
        with np.errstate(invalid="ignore"):
            optical = np.stack(
                [(u - 315.83800193) / 585.05108211 * depth, (v - 242.94140713) / 585.05108211 * depth, depth]
            )
            robot = pose[:3, :3] @ optical + pose[:3, 3:]
            floor = (np.abs(robot[2]) <= 0.05) & (robot[0] - pose[0, 3] <= 4.0) & np.isfinite(depth)
        assert np.array_equal((view.low[v, u] <= disparity) & (disparity <= view.high[v, u]), floor)
    assert 4.0 < view.reach < 6.0


def test_a_camera_that_looks_up_sees_no_floor() -> None:
    camera = load_robot().ground_camera()
    assert camera is not None
    view = FloorView.of(camera.model_copy(update={"pitch": -0.9}), 0.05, 4.0)
    assert (view.low > view.high).all() and view.reach == 0.0
