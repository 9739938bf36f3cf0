"""The plane of the floor in one disparity image, and the camera's pitch, roll and height that follow from it.

A plane n . X = h (n: the unit vector down, in the optical frame; h: the camera's height above the plane) is seen at
depth Z by the ray (a, b, 1), a = (u - cx) / fx, b = (v - cy) / fy, where Z n . (a, b, 1) = h. With Z = 1.03 / dd,

    dd = 1.03 / h * (n_x a + n_y b + n_z)

is linear in the pixel (u, v). The sensor's noise and its steps are those of the disparity, and dd is linear in it too,
so in dd they are the same all over the image; in metres they grow with the square of the depth, and a fit there would
believe the far end of the floor, which is the least certain. Hence the plane is fitted to dd: least squares over
those pixels that agree (their spread measured by the median absolute deviation, MAD), started from the best of many
planes through three pixels each (RANSAC: Fischler and Bolles, 1981; truncated squares as score: Torr and Zisserman,
MLESAC, 2000).
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.robot import CameraGeometry, Intrinsics
from pfslam_viz.texture.kinect import DISPARITIES, INVERSE_STEP, SCALE, inverse_depth

Array = NDArray[np.float64]

STEP = -INVERSE_STEP  # of dd for one disparity
EVERY = 8  # pixels: every eighth of every eighth row is looked at
FARTHEST = 5.0  # m of depth: the noise of farther floor is larger than its height above the next thing
TRIALS = 120  # planes through three pixels; with a third of the pixels floor, all would miss once in 400 images
SCORED = 600  # pixels that vote on them
NEAR = 4.0  # disparities: a pixel this close to a plane votes for it
LEAST_SHARE = 0.08  # of the pixels looked at must be floor,
LEAST_ROWS, LEAST_COLUMNS = 50, 150  # pixels that it must extend over, as standard deviations times sqrt(12)
PRIOR_ANGLE = math.radians(10.0)  # a plane more tilted than this against the robot file's floor is another thing,
PRIOR_HEIGHT = 0.15  # m; and so is one that is higher or lower by more


@dataclass(frozen=True, slots=True)
class FloorPlane:
    """The camera over the floor of one image.

    Attributes:
        pitch: rad, positive looks down.
        roll: rad, positive leans to the right.
        height: m of the camera above the floor.
        share: of the pixels looked at, those on the plane.
        noise: their standard deviation about it, disparities, by the MAD.
    """

    pitch: float
    roll: float
    height: float
    share: float
    noise: float

    @property
    def down(self) -> Array:
        """(3,) the unit vector down, in the optical frame (x right, y down, z ahead)."""
        return down_of(self.pitch, self.roll)


def down_of(pitch: float, roll: float) -> Array:
    """(3,) the vector down in the optical frame of a camera with that ``pitch`` and ``roll``, rad: (36), (37)."""
    return np.array([math.sin(roll) * math.cos(pitch), math.cos(roll) * math.cos(pitch), math.sin(pitch)])


def fit_floor(disparity: NDArray[Any], camera: CameraGeometry) -> FloorPlane | None:
    """The floor in a raw ``disparity`` image (rows, columns); None where there is no floor to be told.

    ``camera``, its height counted from the floor, says where floor is expected: planes that are off it by more than
    10° or 15 cm are other things. The same image gives the same answer.
    """
    rays, dd = sampled_pixels(disparity, camera)
    looked_at = len(dd)
    down, height = down_of(camera.pitch, camera.roll), camera.position[2]
    with np.errstate(divide="ignore"):
        depth = SCALE / np.maximum(dd, 0.0)
    # Where a floor within the prior's limits can be at all.
    off = np.abs(depth * (rays @ down) - height)
    near = (depth < FARTHEST) & (off < PRIOR_HEIGHT + math.tan(PRIOR_ANGLE) * depth)
    rays, dd = rays[near], dd[near]
    least = max(LEAST_SHARE * looked_at, 50.0)
    if len(dd) < least:
        return None
    plane = _best_trial(rays, dd, down, height)
    if plane is None:
        return None
    found = _refine(plane, rays, dd)
    if found is None:
        return None
    plane, on, noise = found
    extent = math.sqrt(12.0) * rays[on].std(axis=0) * (camera.intrinsics.fx, camera.intrinsics.fy, 1.0)
    if on.sum() < least or extent[0] < LEAST_COLUMNS or extent[1] < LEAST_ROWS:
        return None
    if not _allowed(plane[None], down, height)[0]:
        return None
    length = float(np.linalg.norm(plane))
    x, y, z = plane / length
    return FloorPlane(math.asin(z), math.atan2(x, y), SCALE / length, float(on.sum() / looked_at), noise / STEP)


def sampled_pixels(disparity: NDArray[Any], camera: CameraGeometry) -> tuple[Array, Array]:
    """Rays (n, 3) at 1 m of depth, and dd (n,), of every EVERY-th pixel; dd is 0 without a reading."""
    flat = disparity[EVERY // 2 :: EVERY, EVERY // 2 :: EVERY].reshape(-1)
    known = (flat > 0) & (flat < DISPARITIES - 1)
    return _rays(disparity.shape, camera.intrinsics), np.where(known, inverse_depth(flat), 0.0)


@lru_cache(maxsize=4)
def _rays(shape: tuple[int, ...], k: Intrinsics) -> Array:
    v, u = np.mgrid[EVERY // 2 : shape[0] : EVERY, EVERY // 2 : shape[1] : EVERY].reshape(2, -1)
    rays = np.column_stack([(u - k.cx) / k.fx, (v - k.cy) / k.fy, np.ones(len(u))])
    rays.flags.writeable = False
    return rays


def _best_trial(rays: Array, dd: Array, down: Array, height: float) -> Array | None:
    """The plane (3,) of dd = plane . ray with the most pixels near it, among those through three random pixels."""
    rng = np.random.default_rng(len(dd))
    picked = rng.integers(0, len(dd), (TRIALS, 3))
    picked = picked[np.abs(np.linalg.det(rays[picked])) > 1e-3]  # three in a row span no plane
    if len(picked) == 0:
        return None
    planes: Array = np.linalg.solve(rays[picked], dd[picked][..., None])[..., 0]
    planes = planes[_allowed(planes, down, height)]
    if len(planes) == 0:
        return None
    voters = rng.integers(0, len(dd), SCORED)
    misfit = (rays[voters] @ planes.T - dd[voters, None]) / (NEAR * STEP)
    best: Array = planes[int(np.minimum(misfit * misfit, 1.0).sum(axis=0).argmin())]
    return best


def _allowed(planes: Array, down: Array, height: float) -> NDArray[np.bool_]:
    """(n,) whether planes (n, 3) are within the prior's limits."""
    length = np.maximum(np.linalg.norm(planes, axis=1), 1e-9)
    near = planes @ down > math.cos(PRIOR_ANGLE) * length
    allowed: NDArray[np.bool_] = near & (np.abs(SCALE / length - height) < PRIOR_HEIGHT)
    return allowed


def _refine(plane: Array, rays: Array, dd: Array) -> tuple[Array, NDArray[np.bool_], float] | None:
    """Least squares over the pixels within three standard deviations, again and again: plane, which pixels, spread."""
    limit = NEAR * STEP
    on: NDArray[np.bool_] = np.zeros(len(dd), np.bool_)
    noise = 0.0
    for _ in range(8):
        misfit = np.abs(rays @ plane - dd)
        before, on = on, misfit <= limit
        if on.sum() < 30:
            return None
        if np.array_equal(before, on):
            break
        a = rays[on]
        try:
            plane = np.asarray(np.linalg.solve(a.T @ a, a.T @ dd[on]), np.float64)
        except np.linalg.LinAlgError:
            return None
        noise = 1.4826 * float(np.median(np.abs(a @ plane - dd[on])))
        limit = max(3.0 * noise, 1.5 * STEP)  # no less than the steps of the sensor
    return plane, on, noise
