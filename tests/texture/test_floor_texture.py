import math
from dataclasses import replace

import numpy as np
import pytest

from pfslam_viz.config import load_robot
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.settings import TextureConfig
from pfslam_viz.texture.floor_plane import FloorPlane
from pfslam_viz.texture.floor_texture import FloorTexture
from pfslam_viz.texture.kinect import depth_from_disparity

NOTHING = 2047


def camera() -> CameraGeometry:
    found = load_robot("ece276a-paper").ground_camera()
    assert found is not None
    return found


def texture(cell: float = 0.07, **options: object) -> FloorTexture:
    return FloorTexture(camera(), TextureConfig(**options), cell)  # type: ignore[arg-type]


def floor_disparity() -> np.ndarray:
    """What the camera sees of an endless empty floor; NOTHING above the horizon and beyond the sensor's range."""
    v = np.arange(480)
    c, s = math.cos(0.31415926535897931), math.sin(0.31415926535897931)
    down = s + c * (v - 242.94140713) / 585.05108211
    with np.errstate(divide="ignore"):
        d = np.rint((3.31 - 1.03 * down / (0.38001 + 0.127)) / 0.00304)
    row = np.where((down > 0) & (d < 1040), d, NOTHING).astype(np.uint16)
    return np.repeat(row[:, None], 640, axis=1)


def paint_pixel_by_pixel(
    disparity: np.ndarray, color: np.ndarray, pose: tuple[float, float, float], cell: float
) -> dict[tuple[int, int], list[np.ndarray]]:
    """Plain twin: the colours that fall into every cell (row, column from the origin's), (35) to (38), (24), (25)."""
    cells: dict[tuple[int, int], list[np.ndarray]] = {}
    transform = camera().robot_from_optical()
    world = np.array([
        [math.cos(pose[2]), -math.sin(pose[2]), 0, pose[0]], [math.sin(pose[2]), math.cos(pose[2]), 0, pose[1]],
        [0, 0, 1, 0], [0, 0, 0, 1],
    ])  # fmt: skip
    for v, u in np.argwhere(disparity < NOTHING):
        d = int(disparity[v, u])
        dd = -0.00304 * d + 3.31
        if dd <= 0:
            continue
        depth = float(depth_from_disparity(d))
        optical = [(u - 315.83800193) / 585.05108211 * depth, (v - 242.94140713) / 585.05108211 * depth, depth, 1.0]
        robot = transform @ optical
        if abs(robot[2]) > 0.05 or robot[0] - transform[0, 3] > 4.0:
            continue
        column = math.floor((526.37 * u - 4.5 * 1750.46 * dd + 19276) / 585.051 + 0.5)
        row = round((526.37 * v + 16662) / 585.051)
        if 0 <= column < 640 and 0 <= row < 480:
            x, y = (world @ robot)[:2]
            cells.setdefault((math.floor(-y / cell), math.floor(x / cell)), []).append(color[row, column])
    return cells


def test_one_pixel_by_hand() -> None:
    """Pixel (400, 316): almost straight ahead; its floor point and its colour's pixel worked out on paper."""
    disparity = np.full((480, 640), NOTHING, np.uint16)
    # down = sin 18° + cos 18° * 157.0586 / 585.0511 = 0.30902 + 0.25531 = 0.56433; depth = 0.50701 / 0.56433 = 0.89843;
    # d = (3.31 - 1.03 / 0.89843) / 0.00304 = 711.7.
    disparity[400, 316] = 712
    color = np.zeros((480, 640, 3), np.uint8)
    # dd = 1.14552, depth = 0.89916; u = (166332.9 - 9023.4 + 19276) / 585.051 = 301.8; v = 227210 / 585.051 = 388.4.
    color[388, 302] = (10, 200, 90)
    floor = texture()
    # x = 0.33276 + 0.89916 * (cos 18° - sin 18° * 0.26845) = 1.1133 ahead; sideways 0.2 mm: turned to the left by 90°
    # from (2, 3) that is the point (2.000, 4.1133): row floor(-4.1133 / 0.07) = -59, column floor(2.0002 / 0.07) = 28.
    assert floor.add(disparity, color, (2.0, 3.0, math.pi / 2)) == 1
    (cell,) = np.argwhere(floor.weight)
    assert tuple(cell - floor.origin) == (-59, 28)
    assert floor.color[tuple(cell)].tolist() == [10, 200, 90] and floor.weight[tuple(cell)] == 1.0


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (-12.3, 7.7, 2.2)])
def test_matches_the_plain_twin(pose: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(1)
    disparity = np.full((480, 640), NOTHING, np.uint16)
    kept = rng.random((480, 640)) < 0.01
    noisy = floor_disparity().astype(int) + rng.integers(-12, 13, (480, 640))
    disparity[kept] = np.clip(noisy, 0, NOTHING)[kept]
    color = rng.integers(0, 256, (480, 640, 3), dtype=np.uint8)
    floor = texture()
    expected = paint_pixel_by_pixel(disparity, color, pose, 0.07)
    assert floor.add(disparity, color, pose) == pytest.approx(len(expected), abs=2)
    wrong = 0
    for (row, column), colors in expected.items():
        at = row + floor.origin[0], column + floor.origin[1]
        same = floor.weight[at] == len(colors) and np.abs(floor.color[at] - np.mean(colors, axis=0)).max() <= 0.51
        wrong += not same
    assert len(expected) > 500
    assert wrong <= 0.02 * len(expected)  # single precision: a point on a cell's edge may fall to either side


def test_as_a_mean_colour_is_that_of_all_pixels() -> None:
    floor, disparity = texture(blend="mean"), floor_disparity()
    for value, count in ((30, 3), (90, 1)):
        for _ in range(count):
            floor.add(disparity, np.full((480, 640, 3), value, np.uint8), (0.0, 0.0, 0.0))
    seen = floor.weight > 0
    assert seen.sum() > 1000 and (floor.color[seen] == 45).all() and (floor.color[~seen] == 0).all()
    assert floor.frames == 4


def tiles(pose: tuple[float, float, float], exposure: float, other: float = 1.0) -> np.ndarray:
    """The colours (480, 640, 3) that the camera sees of a floor of grey tiles 0.35 m wide, from its own equations.

    A spot 1.4 to 2.1 m ahead of the world's origin and 0.6 m wide is seen ``other`` times as bright.
    """
    rays = np.array(camera().robot_from_optical()[:3, :3])
    v, u = np.mgrid[:480, :640]
    # The depth pixel whose colour pixel (u, v) is: its row first, which alone gives the floor's depth.
    row = (585.051 * v - 16662) / 526.37
    down = math.sin(math.pi / 10) + math.cos(math.pi / 10) * (row - 242.94140713) / 585.05108211
    depth = np.where(down > 0.05, 0.50701 / np.maximum(down, 0.05), 20.0)
    column = (585.051 * u - 19276 + 4.5 * 1750.46 * 1.03 / depth) / 526.37
    optical = np.stack([(column - 315.83800193) / 585.05108211, (row - 242.94140713) / 585.05108211, np.ones_like(row)])
    x, y, _ = np.einsum("ij,jvu->ivu", rays, optical) * depth + np.array([0.33276, 0.0, 0.0])[:, None, None]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    x, y = pose[0] + c * x - s * y, pose[1] + s * x + c * y
    grey = np.where((np.floor(x / 0.35) + np.floor(y / 0.35)) % 2 == 0, 70.0, 130.0)
    grey = np.where((x > 1.4) & (x < 2.1) & (np.abs(y) < 0.3), other * grey, grey)
    image: np.ndarray = np.repeat(np.clip(np.rint(exposure * grey), 0, 255).astype(np.uint8)[..., None], 3, axis=-1)
    return image


def test_frames_are_brought_to_one_exposure() -> None:
    """A drive of 4 m over tiles of 70 and 130, each frame of another exposure, from 0.7 to 1.4 of the first one's."""
    poses = [(0.2 * k, 0.0, 0.05 * k) for k in range(20)]
    exposures = np.concatenate([[1.0], np.random.default_rng(4).uniform(0.7, 1.4, 19)])
    off = {}
    for blend in ("finest", "mean"):
        floor = texture(blend=blend)
        for pose, exposure in zip(poses, exposures, strict=True):
            floor.add(floor_disparity(), tiles(pose, exposure), pose)
        grey = floor.color[..., 0][floor.weight > 8].astype(float)
        # Cells in a tile's middle have its colour; those over an edge have any between.
        off[blend] = float(np.percentile(np.minimum(abs(grey - 70) / 70, abs(grey - 130) / 130), 70))
    assert off["finest"] < 0.04 and off["mean"] > 0.08


@pytest.mark.parametrize("far_first", [False, True])
def test_a_close_view_is_not_overruled_by_far_ones(far_first: bool) -> None:
    """From 2 m back, sixty times, a spot on the floor looks twice as bright as from near.

    Between the two the texture grows in every direction.
    """
    near, back = (0.6, 0.0, 0.0), (-1.4, 0.0, 0.0)
    off = {}
    for blend in ("finest", "mean"):
        floor = texture(blend=blend)
        for step in ("far", "grow", "near") if far_first else ("near", "grow", "far"):
            for _ in range(60 if step == "far" else 1):
                if step == "near":
                    floor.add(floor_disparity(), tiles(near, 1.0), near)
                elif step == "far":
                    floor.add(floor_disparity(), tiles(back, 1.0, other=1.9), back)
                else:
                    for pose in ((9.0, 9.0, 1.0), (-9.0, -9.0, 4.0)):
                        floor.add(floor_disparity(), tiles(pose, 1.0), pose)
        # The row of cells straight ahead, 1.5 to 2 m from the origin: 0.6 to 1.1 m ahead of the near camera, 2.6 to
        # 3.1 m ahead of the far one.
        at = floor.origin[0] - 1, slice(floor.origin[1] + 22, floor.origin[1] + 29)
        grey = floor.color[at][:, 0].astype(float)
        off[blend] = float(np.max(np.where(grey > 131, grey - 130, 0.0)))
    assert off["finest"] < 3.0 and off["mean"] > 15.0


def test_a_frame_may_have_a_plane_of_its_own() -> None:
    """Pixel (400, 316) as above, but for this frame the camera looks 21° down from 0.52 m."""
    disparity = np.full((480, 640), NOTHING, np.uint16)
    # down = sin 21° + cos 21° * 0.26845 = 0.35837 + 0.25062 = 0.60899; depth = 0.52 / 0.60899 = 0.85388;
    # d = (3.31 - 1.03 / 0.85388) / 0.00304 = 692.0.
    disparity[400, 316] = 692
    color = np.full((480, 640, 3), 50, np.uint8)
    floor = texture(floor_tolerance=0.01)
    cropped = floor.view.crop(disparity, color)
    # As the common plane has it, the point is 0.507 - 0.85388 * 0.56433 = 2.5 cm above the floor.
    assert floor.add_cropped(*cropped, (0.0, 0.0, 0.0)) == 0 and floor.tilted == 0
    plane = FloorPlane(math.radians(21), 0.0, 0.52, 0.5, 1.0)
    assert floor.add_cropped(*cropped, (0.02, 0.03, 0.0), plane) == 1
    # x = 0.02 + 0.33276 + 0.85388 * (cos 21° - sin 21° * 0.26845) = 1.0678: column 15; y = 0.03 - 0.0002: row -1.
    (cell,) = np.argwhere(floor.weight)
    assert tuple(cell - floor.origin) == (-1, 15)
    assert (floor.frames, floor.tilted) == (2, 1)

    # Pixel (400, 516), a = 0.34212, b = 0.26845, of a camera that also leans by 10°. To the left: -a cos 10° +
    # b sin 10° = -0.29031; up: -a sin 10° - b cos 10° = -0.32378, and tilted -sin 21° - cos 21° * 0.32378 = -0.66064;
    # depth = 0.52 / 0.66064 = 0.78711, d = 658.4; x = 0.35276 + 0.78711 * (cos 21° - sin 21° * 0.32378) = 0.996.
    disparity = np.full((480, 640), NOTHING, np.uint16)
    disparity[400, 516] = 658
    leaning, pose = texture(floor_tolerance=0.01), (0.02, 0.03, 0.0)
    assert leaning.add_cropped(*leaning.view.crop(disparity, color), pose, replace(plane, roll=math.radians(10))) == 1
    (cell,) = np.argwhere(leaning.weight)
    assert tuple(cell - leaning.origin) == (2, 14)  # y = 0.03 - 0.78711 * 0.29031 = -0.199
    assert floor.tilted_text == "tilted in 1 of 2 frames, painted with planes of their own"


def test_only_the_floor_is_painted() -> None:
    color = np.full((480, 640, 3), 255, np.uint8)
    for tolerance in (0.05, 0.6):  # also where the camera itself would count as floor
        nothing = np.full((480, 640), NOTHING, np.uint16)
        nothing[::2], nothing[1::4] = 2048 + 712, 65535  # more than a Kinect delivers
        assert texture(floor_tolerance=tolerance).add(nothing, color, (0, 0, 0)) == 0
    # A wall that fills the image, 0.6 m away: nothing of it is below 5 cm (the lowest ray is 40° down: 0.5 m at 0.6 m).
    near = round((3.31 - 1.03 / 0.5) / 0.00304)
    assert texture().add(np.full((480, 640), near, np.uint16), color, (0, 0, 0)) == 0
    wide, narrow = (
        texture(floor_tolerance=t).add(floor_disparity() + np.uint16(8), color, (0, 0, 0)) for t in (0.5, 0.02)
    )
    assert narrow < 0.5 * wide


def test_floor_is_told_by_the_height_of_every_point() -> None:
    """All pixels of one disparity, worked out in double precision: as many are painted as are floor.

    But for those within 0.01 mm of a limit, which in single precision may be either.
    """
    v, u = np.mgrid[:480, :640]
    optical = np.stack([(u - 315.83800193) / 585.05108211, (v - 242.94140713) / 585.05108211, np.ones((480, 640))])
    pose, color = camera().robot_from_optical(), np.zeros((480, 640, 3), np.uint8)
    rays = np.einsum("ij,jvu->ivu", pose[:3, :3], optical)
    painted = 0
    for d in (*range(0, 600, 100), *range(600, 1089, 8), 1089, 2046, 2047):
        dd = -0.00304 * d + 3.31
        least = most = 0
        if dd > 0:
            ahead, _, height = 1.03 / dd * rays
            column = (526.37 * u - 4.5 * 1750.46 * dd + 19276) / 585.051
            beyond = np.maximum(np.abs(height + pose[2, 3]) - 0.05, ahead - 4.0)
            least = np.sum((beyond < -1e-5) & (column > -0.499))
            most = np.sum((beyond < 1e-5) & (column > -0.501))
        floor = texture()
        floor.add(np.full((480, 640), d, np.uint16), color, (0.0, 0.0, 0.0))
        assert least <= floor.weight.sum() <= most
        painted += most
    assert painted > 100_000


def test_max_range_is_ahead_of_the_camera() -> None:
    color = np.full((480, 640, 3), 255, np.uint8)
    for limit in (1.5, 3.0):
        floor = texture(max_range=limit)
        floor.add(floor_disparity(), color, (0.0, 0.0, 0.0))
        columns = np.flatnonzero(floor.weight.any(axis=0)) - floor.origin[1]
        assert columns.max() * 0.07 == pytest.approx(0.33276 + limit, abs=0.1)


def test_grows_in_every_direction_and_keeps_its_frame() -> None:
    disparity, color = floor_disparity(), np.full((480, 640, 3), 200, np.uint8)
    poses = [(0.0, 0.0, 0.0), (30.0, 2.0, 1.0), (-25.0, -18.0, 3.0), (3.0, 22.0, -1.0)]
    grown = texture()
    for pose in poses:
        grown.add(disparity, color, pose)
    alone = np.zeros(grown.shape, np.float32)
    for pose in poses:
        single = texture()
        single.add(disparity, color, pose)
        row, column = grown.origin[0] - single.origin[0], grown.origin[1] - single.origin[1]
        alone[row : row + single.shape[0], column : column + single.shape[1]] += single.weight
    assert np.array_equal(alone, grown.weight) and alone.sum() > 0
    x, y = grown.lower_left
    assert x == pytest.approx(-grown.origin[1] * 0.07) and x < -25.0
    assert y == pytest.approx((grown.origin[0] - grown.shape[0]) * 0.07) and y < -18.0


@pytest.mark.parametrize(
    ("disparity", "color", "message"),
    [
        (np.zeros((480, 640), np.uint8), np.zeros((480, 640, 3), np.uint8), "disparity image is 480 x 640 uint8"),
        (np.zeros((240, 320), np.uint16), np.zeros((480, 640, 3), np.uint8), "disparity image is 240 x 320"),
        (np.zeros((480, 640), np.uint16), np.zeros((480, 640), np.uint8), "colour image is 480 x 640 uint8, not"),
    ],
)
def test_wrong_images(disparity: np.ndarray, color: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        texture().add(disparity, color, (0.0, 0.0, 0.0))
