"""Colour and disparity images of a simulated building, through the exact inverse of the Kinect's conversion.

The conversion of real images, depth = 1.03 / (3.31 - 0.00304 d) and its linear map from a depth
pixel to a colour pixel, says that the colour camera is a pinhole of its own, a little to the right of the depth camera.
So each camera's picture is made with one ray a pixel, at its own time.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz.errors import PfslamError
from pfslam_viz.robot import CameraGeometry, Robot
from pfslam_viz.simulation.drive import Drive
from pfslam_viz.simulation.floor import floor_color
from pfslam_viz.simulation.world import Array, World

FRAME_PERIOD = 0.4  # s: every 12th of a 30 Hz stream
FARTHEST = 8.0  # m; the sensor sees no farther
NO_READING = 2047  # the Kinect's own code

# The colour pixel of a depth pixel is ((526.37 u - 4.5 * 1750.46 dd + 19276) / 585.051, (526.37 v + 16662) / 585.051).
# With u = fx X / Z + cx, fx = 585.051 and dd = 1.03 / Z that is 526.37 (X - BASELINE) / Z + a constant.
COLOR_FOCAL = 526.37  # pixels
BASELINE = 4.5 * 1750.46 * 1.03 / 585.051 / COLOR_FOCAL  # m, along the optical x axis


@dataclass(frozen=True, slots=True)
class Eye:
    """One pinhole: ``position`` (3,) and ``rays`` (rows, columns, 3) in the robot's frame, z = 0 on the ground.

    A ray is as long as one metre of optical depth.
    """

    position: Array
    rays: Array


def eyes(camera: CameraGeometry) -> tuple[Eye, Eye]:
    """The colour and the depth pinhole of a camera whose height counts from the ground."""
    k = camera.intrinsics
    u, v = np.meshgrid(np.arange(k.width, dtype=np.float64), np.arange(k.height, dtype=np.float64))
    pose = camera.robot_from_optical()
    depth = np.stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones_like(u)], axis=-1)
    center_u, center_v = (COLOR_FOCAL * k.cx + 19276.0) / 585.051, (COLOR_FOCAL * k.cy + 16662.0) / 585.051
    color = np.stack([(u - center_u) / COLOR_FOCAL, (v - center_v) / COLOR_FOCAL, np.ones_like(u)], axis=-1)
    return (
        Eye(pose[:3, 3] + BASELINE * pose[:3, 0], color @ pose[:3, :3].T),
        Eye(pose[:3, 3].copy(), depth @ pose[:3, :3].T),
    )


def render_color(eye: Eye, world: World, pose: Array) -> NDArray[np.uint8]:
    """The (rows, columns, 3) RGB image from the robot's ``pose`` (3,)."""
    depth, hit = _cast(eye.rays, eye.position, pose, world.walls, world.heights)
    image: NDArray[np.uint8] = _paint(
        eye.rays, eye.position, pose, world.walls, world.colors, world.plan, world.zones, world.floors, depth, hit
    )
    return image


def render_disparity(eye: Eye, world: World, pose: Array) -> NDArray[np.uint16]:
    """The (rows, columns) disparity image from the robot's ``pose`` (3,)."""
    depth, _ = _cast(eye.rays, eye.position, pose, world.walls, world.heights)
    disparity = np.round((3.31 - 1.03 / depth) / 0.00304)
    return np.where((depth <= FARTHEST) & (disparity >= 0), disparity, NO_READING).astype(np.uint16)


def film(
    folder: Path, number: int, world: World, drive: Drive, robot: Robot, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Write ``RGB<number>/`` and ``Disparity<number>/`` of a drive; the colour (a,) and disparity (b,) times in s.

    Each image is what its camera sees at its own time; the two cameras are up to 10 ms apart. Raises PfslamError if
    the robot has no camera.
    """
    camera = robot.ground_camera()
    if camera is None:
        raise PfslamError("the robot has no camera to film with")
    color_eye, depth_eye = eyes(camera)
    late = drive.duration - 0.5 * drive.still_after
    disparity_times = np.arange(0.5 * drive.still_before, late, FRAME_PERIOD)
    disparity_times = disparity_times + rng.uniform(-0.01, 0.01, len(disparity_times))
    color_times = disparity_times[:-1] + rng.uniform(-0.01, 0.01, len(disparity_times) - 1)

    def write(what: str, index: int, time: float) -> None:
        pose = drive.at(np.array([time]))[0]
        image: NDArray[np.uint8] | NDArray[np.uint16]
        if what == "RGB":
            image = np.ascontiguousarray(render_color(color_eye, world, pose)[..., ::-1])
        else:
            image = render_disparity(depth_eye, world, pose)
        _write_png(folder / f"{what}{number}" / f"{what.lower()}{number}_{index}.png", image)

    for what in ("RGB", "Disparity"):
        (folder / f"{what}{number}").mkdir(parents=True)
    jobs = [("RGB", k, t) for k, t in enumerate(color_times, 1)]
    jobs += [("Disparity", k, t) for k, t in enumerate(disparity_times, 1)]
    with ThreadPoolExecutor(max_workers=2) as pool:  # rendering and PNG both leave the interpreter's lock
        for job in [pool.submit(write, *job) for job in jobs]:
            job.result()
    return color_times, disparity_times


def _write_png(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    import cv2

    done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise PfslamError(f"{path}: the image could not be encoded")
    path.write_bytes(data.tobytes())


@njit(cache=True, nogil=True)
def _cast(  # type: ignore[no-untyped-def]
    rays: Array, position: Array, pose: Array, walls: Array, heights: Array
):
    """Optical depth (rows, columns) m of what every pixel sees, inf for nothing, and its wall, -1 floor, -2 nothing."""
    rows, columns = rays.shape[:2]
    depth = np.full((rows, columns), np.inf)
    hit = np.full((rows, columns), -2, np.int32)
    turn = 2.0 * np.pi
    # Walls in the robot's frame about the camera, the nearest first.
    count = len(walls)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    local = np.empty((count, 4))
    start, span, nearest = np.empty(count), np.empty(count), np.empty(count)
    for m in range(count):
        for e in range(2):
            x, y = walls[m, 2 * e] - pose[0], walls[m, 2 * e + 1] - pose[1]
            local[m, 2 * e] = c * x + s * y - position[0]
            local[m, 2 * e + 1] = -s * x + c * y - position[1]
        ax, ay, bx, by = local[m]
        a = np.arctan2(ay, ax)
        d = (np.arctan2(by, bx) - a + np.pi) % turn - np.pi
        start[m], span[m] = (a, d) if d >= 0.0 else (a + d, -d)
        dx, dy = bx - ax, by - ay
        t = min(max(-(ax * dx + ay * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        nearest[m] = np.hypot(ax + t * dx, ay + t * dy)
    order = np.argsort(nearest)
    near = np.empty(count, np.int64)
    for u in range(columns):
        # All rays of a column lie between the directions of its first and last one: keep the walls that those meet.
        a = np.arctan2(rays[0, u, 1], rays[0, u, 0])
        d = (np.arctan2(rays[rows - 1, u, 1], rays[rows - 1, u, 0]) - a + np.pi) % turn - np.pi
        low, width = (a, d) if d >= 0.0 else (a + d, -d)
        low, width = low - 1e-6, width + 2e-6
        kept = 0
        for m in order:
            if (low - start[m]) % turn <= span[m] or (start[m] - low) % turn <= width:
                near[kept] = m
                kept += 1
        for v in range(rows):
            rx, ry, rz = rays[v, u]
            length = np.hypot(rx, ry)
            best, what = np.inf, -2
            if rz < 0.0:
                best, what = -position[2] / rz, -1
            for n in range(kept):
                m = near[n]
                if nearest[m] > best * length:
                    break
                ax, ay, bx, by = local[m]
                dx, dy = bx - ax, by - ay
                denominator = rx * dy - ry * dx
                if denominator == 0.0:
                    continue
                t = (ax * dy - ay * dx) / denominator
                along = (ax * ry - ay * rx) / denominator
                if 0.0 < t < best and 0.0 <= along <= 1.0 and position[2] + t * rz <= heights[m]:
                    best, what = t, m
            depth[v, u] = best
            hit[v, u] = what
    return depth, hit


@njit(cache=True, nogil=True)
def _paint(  # type: ignore[no-untyped-def]
    rays: Array,
    position: Array,
    pose: Array,
    walls: Array,
    colors: NDArray[np.uint8],
    plan: Array,
    zones: Array,
    floors: NDArray[np.int64],
    depth: Array,
    hit: NDArray[np.int32],
):
    """The colours (rows, columns, 3) of what :func:`_cast` found; a floor pixel is the mean of 2 x 2 rays."""
    rows, columns = hit.shape
    image = np.zeros((rows, columns, 3), np.uint8)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for v in range(rows):
        for u in range(columns):
            m = hit[v, u]
            if m >= 0:
                dx, dy = walls[m, 2] - walls[m, 0], walls[m, 3] - walls[m, 1]
                bright = 0.80 + 0.20 * abs(dx * np.cos(0.6) + dy * np.sin(0.6)) / np.hypot(dx, dy)
                if position[2] + depth[v, u] * rays[v, u, 2] < 0.08:
                    bright *= 0.45  # skirting board
                for k in range(3):
                    image[v, u, k] = np.uint8(colors[m, k] * bright)
            elif m == -1:
                right, below = min(u + 1, columns - 1), min(v + 1, rows - 1)
                step_u = rays[v, right] - rays[v, right - 1]
                step_v = rays[below, u] - rays[below - 1, u]
                red, green, blue = 0.0, 0.0, 0.0
                for k in range(4):
                    ray = rays[v, u] + (0.25 if k % 2 else -0.25) * step_u + (0.25 if k // 2 else -0.25) * step_v
                    t = -position[2] / min(ray[2], -1e-6)
                    x, y = position[0] + t * ray[0], position[1] + t * ray[1]
                    r, g, b = floor_color(pose[0] + c * x - s * y, pose[1] + s * x + c * y, plan, zones, floors)
                    red, green, blue = red + r, green + g, blue + b
                image[v, u, 0] = np.uint8(red / 4.0)
                image[v, u, 1] = np.uint8(green / 4.0)
                image[v, u, 2] = np.uint8(blue / 4.0)
    return image
