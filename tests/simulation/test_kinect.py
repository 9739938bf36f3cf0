from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.config import load_robot
from pfslam_viz.robot import CameraGeometry, Intrinsics
from pfslam_viz.simulation.camera_errors import NO_READING
from pfslam_viz.simulation.floor import CHECKER
from pfslam_viz.simulation.kinect import eyes, render_color, render_disparity
from pfslam_viz.simulation.world import Plan, World

Colors = Callable[[World, NDArray[np.float64]], NDArray[np.float64]]


def room() -> World:
    plan = Plan()
    plan.room(-3.0, -2.0, 3.0, 2.0, CHECKER, (200, 180, 160))
    plan.box(2.0, 0.0, 0.4, 0.8, height=0.3, color=(10, 240, 30))
    return plan.build([(0, 0), (1, 0)])


def camera(pitch: float = 0.0) -> CameraGeometry:
    return CameraGeometry(position=(0.3, 0.0, 0.5), pitch=pitch)


def test_disparity_of_a_wall_straight_ahead() -> None:
    _, depth_eye = eyes(camera())
    disparity = render_disparity(depth_eye, room(), np.zeros(3))
    assert disparity.shape == (480, 640) and disparity.dtype == np.uint16
    # Row 0 looks up and over the low box: the wall at x = 3 is 2.7 m away. d = (3.31 - 1.03 / 2.7) / 0.00304 = 963.3.
    assert (disparity[0, 250:400] == 963).all()
    # Row 400 looks down: (400 - 242.94) / 585.05 = 0.26846, so the floor is 0.5 / 0.26846 = 1.8625 m away, but at
    # 1.5 m, 9.7 cm above it, stands the box: d = (3.31 - 1.03 / 1.5) / 0.00304 = 862.9.
    assert (disparity[400, 300:330] == 863).all()
    # To the side of the box it is the floor: d = (3.31 - 1.03 / 1.8625) / 0.00304 = 906.9.
    assert (disparity[400, 500:520] == 907).all()


def test_nothing_beyond_8_m() -> None:
    plan = Plan()
    plan.room(-1.0, -2.0, 20.0, 2.0)
    _, depth_eye = eyes(camera())
    disparity = render_disparity(depth_eye, plan.build([(0, 0), (1, 0)]), np.zeros(3))
    assert disparity[243, 316] == NO_READING and (disparity[479] < 1000).all()


def test_the_colour_of_a_depth_pixel_is_where_the_conversion_says(floor_colors: Colors) -> None:
    """Through DATA's printed map from depth to colour pixels, the floor's colour is found at every floor pixel."""
    robot_camera = load_robot("ece276a-paper").ground_camera()
    assert robot_camera is not None
    world, pose = room(), np.array([-1.0, 0.4, 0.3])
    color_eye, depth_eye = eyes(robot_camera)
    color, disparity = render_color(color_eye, world, pose), render_disparity(depth_eye, world, pose)
    v, u = np.mgrid[300:480:7, 20:620:7].reshape(2, -1)
    dd = -0.00304 * disparity[v, u] + 3.31
    u_color = np.rint((526.37 * u - 4.5 * 1750.46 * dd + 19276) / 585.051).astype(int)
    v_color = np.rint((526.37 * v + 16662) / 585.051).astype(int)
    depth = 1.03 / dd
    # Optical frame by (35), robot frame by (36, 37) written out for the robot's 18 degrees.
    right, down = (u - 315.83800193) / 585.05108211 * depth, (v - 242.94140713) / 585.05108211 * depth
    c, s = np.cos(np.radians(18)), np.sin(np.radians(18))
    ahead, height = 0.33276 + c * depth - s * down, 0.38001 + 0.127 - s * depth - c * down
    assert np.abs(height).max() < 0.01
    x = -1.0 + np.cos(0.3) * ahead + np.sin(0.3) * right
    y = 0.4 + np.sin(0.3) * ahead - np.cos(0.3) * right
    true = floor_colors(world, np.stack([x, y], -1)).astype(int)
    seen = color[v_color, u_color].astype(int)
    from_edge = np.minimum(
        np.abs((x / 0.5) % 1 - np.round((x / 0.5) % 1)), np.abs((y / 0.5) % 1 - np.round((y / 0.5) % 1))
    )
    inside = from_edge > 0.05  # 2.5 cm from a tile's edge
    assert inside.sum() > 1000
    assert np.abs(seen - true)[inside].max() <= 1


def test_walls_have_their_colour_and_the_floor_its_own() -> None:
    color_eye, _ = eyes(camera())
    image = render_color(color_eye, room(), np.zeros(3))
    assert image.shape == (480, 640, 3) and image.dtype == np.uint8
    wall, box = image[5, 320].astype(float), image[380, 320].astype(float)  # 12 cm up, above the dark skirting
    assert wall / wall[0] == pytest.approx(np.array([200, 180, 160]) / 200, abs=0.02) and wall[0] > 150
    assert box[1] > 150 and box[0] < 20


def test_the_camera_sees_ahead_of_the_robot_wherever_it_stands() -> None:
    """The same view of a square room from four headings, each a quarter turn on."""
    plan = Plan()
    plan.room(-2.0, -2.0, 2.0, 2.0)
    small = CameraGeometry(
        position=(0.3, 0.1, 0.5),
        pitch=0.2,
        intrinsics=Intrinsics(fx=60.0, fy=60.0, cx=31.5, cy=23.5, width=64, height=48),
    )
    _, depth_eye = eyes(small)
    views = [
        render_disparity(depth_eye, plan.build([(0, 0), (1, 0)]), np.array([0.0, 0.0, k * np.pi / 2])) for k in range(4)
    ]
    for view in views[1:]:
        assert np.abs(view.astype(int) - views[0]).max() <= 1
