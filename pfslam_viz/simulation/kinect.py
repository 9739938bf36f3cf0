"""Colour and disparity images of a simulated building, through the exact inverse of the Kinect's conversion.

The conversion of real images, depth = 1.03 / (3.31 - 0.00304 d) and its linear map from a depth
pixel to a colour pixel, says that the colour camera is a pinhole of its own, a little to the right of the depth camera.
So each camera's picture is made with one ray a pixel, at its own time.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.errors import PfslamError
from pfslam_viz.robot import CameraGeometry, Robot
from pfslam_viz.simulation.camera_errors import NO_READING, CameraErrors
from pfslam_viz.simulation.drive import Drive
from pfslam_viz.simulation.floor import floor_color
from pfslam_viz.simulation.world import Array, World

FRAME_PERIOD = 0.4  # s: every 12th of a 30 Hz stream
FARTHEST = 8.0  # m; the sensor sees no farther

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
    depth, hit = _see(eye, world, pose)
    on_plan = geometry.between(world.plan, pose)
    along = np.arctan2(world.walls[:, 3] - world.walls[:, 1], world.walls[:, 2] - world.walls[:, 0])
    light = 0.80 + 0.20 * np.abs(np.cos(along - 0.6))
    image: NDArray[np.uint8] = _paint(
        eye.rays, eye.position, on_plan, world.zones, world.floors, world.colors * light[:, None], depth, hit
    )
    return image


def render_disparity(
    eye: Eye, world: World, pose: Array, errors: CameraErrors | None = None, rng: np.random.Generator | None = None
) -> NDArray[np.uint16]:
    """The (rows, columns) disparity image from the robot's ``pose`` (3,), in whole steps as the sensor's.

    With ``errors`` it has their noise and holes, drawn from ``rng``.
    """
    depth, _ = _see(eye, world, pose)
    disparity = np.where(depth <= FARTHEST, (3.31 - 1.03 / depth) / 0.00304, NO_READING)
    if errors is not None:
        disparity = errors.disturb(disparity, rng or np.random.default_rng())
    disparity = np.round(disparity)
    return np.where((disparity >= 0) & (disparity < NO_READING), disparity, NO_READING).astype(np.uint16)


def _see(eye: Eye, world: World, pose: Array) -> tuple[Array, NDArray[np.int32]]:
    """Optical depth (rows, columns) m of what every pixel sees, inf for nothing, and its wall, -1 floor, -2 nothing."""
    view = geometry.inverse(pose)
    a, b = (geometry.transform(view, world.walls[:, k : k + 2]) - eye.position[:2] for k in (0, 2))
    # The directions a wall spans, and how near it comes: it is looked at only where it can be seen, the nearest first.
    start = np.arctan2(a[:, 1], a[:, 0])
    span = geometry.wrap(np.arctan2(b[:, 1], b[:, 0]) - start)
    start, span = np.where(span < 0.0, start + span, start), np.abs(span)
    d = b - a
    t = np.clip(-(a * d).sum(1) / (d * d).sum(1), 0.0, 1.0)
    nearest = np.hypot(*(a + t[:, None] * d).T)
    order = np.argsort(nearest, kind="stable")
    walls = np.column_stack([a, d, world.heights, nearest, start, span])[order]
    # All rays of a column lie between the directions of its first and last one.
    low = np.arctan2(eye.rays[0, :, 1], eye.rays[0, :, 0])
    width = geometry.wrap(np.arctan2(eye.rays[-1, :, 1], eye.rays[-1, :, 0]) - low)
    low, width = np.where(width < 0.0, low + width, low) - 1e-6, np.abs(width) + 2e-6
    depth, hit = _cast(eye.rays, eye.position[2], walls, order, low, width)
    return depth, hit


def film(
    folder: Path,
    number: int,
    world: World,
    drive: Drive,
    robot: Robot,
    rng: np.random.Generator,
    errors: CameraErrors | None = None,
) -> tuple[Array, Array]:
    """Write ``RGB<number>/`` and ``Disparity<number>/`` of a drive; the colour (a,) and disparity (b,) times in s.

    Each image is what its camera sees at its own time; the two cameras are up to 10 ms apart. The camera is the
    robot's but for its ``errors``. Raises PfslamError if the robot has no camera.
    """
    camera = robot.ground_camera()
    if camera is None:
        raise PfslamError("the robot has no camera to film with")
    errors = errors or CameraErrors()
    color_eye, depth_eye = eyes(errors.mounted(camera))
    late = drive.duration - 0.5 * drive.still_after
    disparity_times = np.arange(0.5 * drive.still_before, late, FRAME_PERIOD)
    disparity_times = disparity_times + rng.uniform(-0.01, 0.01, len(disparity_times))
    color_times = disparity_times[:-1] + rng.uniform(-0.01, 0.01, len(disparity_times) - 1)
    seeds = rng.integers(0, 2**63, len(disparity_times) + 1)  # of each image's own noise: two threads draw it

    def write(what: str, index: int, time: float) -> None:
        image: NDArray[np.uint8] | NDArray[np.uint16]
        if what == "RGB":
            parts = [render_color(color_eye, world, pose) for pose in drive.at(errors.shutter(time))]
            rgb = parts[0] if len(parts) == 1 else np.mean(parts, axis=0)
            if (gain := errors.gain(time)) != 1.0 or len(parts) > 1:
                rgb = np.clip(np.rint(gain * rgb), 0, 255).astype(np.uint8)
            image = np.ascontiguousarray(rgb[..., ::-1])
        else:
            noise = np.random.default_rng(seeds[index])
            image = render_disparity(depth_eye, world, drive.at(np.array([time]))[0], errors, noise)
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

    options = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    if hasattr(cv2, "IMWRITE_PNG_FILTER"):  # one filter for all rows is three times as quick as choosing one for each
        options += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
    done, data = cv2.imencode(".png", image, options)
    if not done:
        raise PfslamError(f"{path}: the image could not be encoded")
    path.write_bytes(data.tobytes())


@kernel("f8[:, :, ::1], f8, f8[:, ::1], i8[::1], f8[::1], f8[::1]")
def _cast(  # type: ignore[no-untyped-def]
    rays: Array, height: float, walls: Array, names: NDArray[np.int64], low: Array, width: Array
):
    """What :func:`_see` answers; ``walls`` (m, 8): start x, y, extent x, y, height, distance, direction, span."""
    rows, columns = rays.shape[:2]
    depth = np.full((rows, columns), np.inf)
    hit = np.full((rows, columns), -2, np.int32)
    turn = 2.0 * np.pi
    near = np.empty(len(walls), np.int64)
    for u in range(columns):
        kept = 0
        for m in range(len(walls)):
            if (low[u] - walls[m, 6]) % turn <= walls[m, 7] or (walls[m, 6] - low[u]) % turn <= width[u]:
                near[kept] = m
                kept += 1
        for v in range(rows):
            rx, ry, rz = rays[v, u, 0], rays[v, u, 1], rays[v, u, 2]
            length = np.sqrt(rx * rx + ry * ry)
            best, what = np.inf, -2
            if rz < 0.0:
                best, what = -height / rz, -1
            for n in range(kept):
                m = near[n]
                if walls[m, 5] > best * length:
                    break
                ax, ay, dx, dy = walls[m, 0], walls[m, 1], walls[m, 2], walls[m, 3]
                denominator = rx * dy - ry * dx
                if denominator == 0.0:
                    continue
                t = (ax * dy - ay * dx) / denominator
                along = (ax * ry - ay * rx) / denominator
                if 0.0 < t < best and 0.0 <= along <= 1.0 and height + t * rz <= walls[m, 4]:
                    best, what = t, names[m]
            depth[v, u] = best
            hit[v, u] = what
    return depth, hit


@kernel("f8[:, :, ::1], f8[::1], f8[::1], f8[:, ::1], i8[::1], f8[:, ::1], f8[:, ::1], i4[:, ::1]")
def _paint(  # type: ignore[no-untyped-def]
    rays: Array,
    position: Array,
    pose: Array,
    zones: Array,
    floors: NDArray[np.int64],
    paints: Array,
    depth: Array,
    hit: NDArray[np.int32],
):
    """The colours (rows, columns, 3) of what :func:`_cast` found. A pixel of far floor is the mean of 2 x 2 rays."""
    rows, columns = hit.shape
    image = np.zeros((rows, columns, 3), np.uint8)
    c, s = np.cos(pose[2]), np.sin(pose[2])
    for v in range(rows):
        for u in range(columns):
            m = hit[v, u]
            if m >= 0:
                skirting = position[2] + depth[v, u] * rays[v, u, 2] < 0.08
                for k in range(3):
                    image[v, u, k] = np.uint8(paints[m, k] * (0.45 if skirting else 1.0))
            elif m == -1:
                right, below = min(u + 1, columns - 1), min(v + 1, rows - 1)
                red, green, blue = 0.0, 0.0, 0.0
                parts = 4 if depth[v, u] > 1.5 else 1
                for k in range(parts):
                    e, f = 0.0, 0.0
                    if parts == 4:
                        e, f = (0.25 if k % 2 else -0.25), (0.25 if k // 2 else -0.25)
                    rx = rays[v, u, 0] + e * (rays[v, right, 0] - rays[v, right - 1, 0])
                    ry = rays[v, u, 1] + e * (rays[v, right, 1] - rays[v, right - 1, 1])
                    rz = rays[v, u, 2] + e * (rays[v, right, 2] - rays[v, right - 1, 2])
                    rx += f * (rays[below, u, 0] - rays[below - 1, u, 0])
                    ry += f * (rays[below, u, 1] - rays[below - 1, u, 1])
                    rz += f * (rays[below, u, 2] - rays[below - 1, u, 2])
                    t = -position[2] / min(rz, -1e-6)
                    x, y = position[0] + t * rx, position[1] + t * ry
                    r, g, b = floor_color(pose[0] + c * x - s * y, pose[1] + s * x + c * y, zones, floors)
                    red, green, blue = red + r, green + g, blue + b
                image[v, u, 0] = np.uint8(red / parts)
                image[v, u, 1] = np.uint8(green / parts)
                image[v, u, 2] = np.uint8(blue / parts)
    return image
