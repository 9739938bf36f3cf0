"""The plane of one frame's floor where it is not the camera's: the robot rocks, or there is a ramp."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.robot import CameraGeometry
from pfslam_viz.texture.floor_plane import EVERY, PRIOR_ANGLE, FloorPlane, down_of, fit_floor, sampled_pixels
from pfslam_viz.texture.kernels import off_plane
from pfslam_viz.texture.kinect import DISPARITIES, SCALE, FloorView

NO_READING = DISPARITIES - 1
MOST_LOST = 0.1  # of a frame's own floor may be off the common one before the frame gets a plane of its own
LEAST_ON = 0.4  # of what is about the floor is on it, unless the frame is worth a fit: walls are the rest
LEAST_TILT = math.radians(0.5)  # with less it is no tilted floor but a step or a table
SLOPE = math.tan(PRIOR_ANGLE)


def own_plane(disparity: NDArray[Any], view: FloorView, camera: CameraGeometry) -> FloorPlane | None:
    """The plane of a frame's floor, if more than a tenth of it is off the common plane by more than the tolerance.

    ``disparity`` is raw, cropped as ``view`` does, which is ``camera``'s. None where the floor is on the common plane,
    where no plane can be told, and where it is one without a tilt: the top of a step or of a table is no floor.

    Most frames are waved through by a count of every eighth pixel of every eighth row, which takes a thirtieth of a
    fit; a fit decides about the others.
    """
    on, near, about = off_plane(
        disparity, view.by_row, view.by_column, view.position[2], view.max_range, view.tolerance, SLOPE, EVERY
    )
    if on >= (1.0 - MOST_LOST) * near and on >= LEAST_ON * about:
        return None
    whole = np.full(view.shape, NO_READING, np.uint16)
    whole[view.first_row :] = disparity
    plane = fit_floor(whole, camera)
    if plane is None:
        return None
    common = down_of(camera.pitch, camera.roll)
    if plane.down @ common > math.cos(LEAST_TILT) or _lost(whole, view, camera, plane) <= MOST_LOST:
        return None
    return plane


def _lost(disparity: NDArray[Any], view: FloorView, camera: CameraGeometry, plane: FloorPlane) -> float:
    """The share of the pixels on ``plane`` that are off the common one."""
    rays, inverse = sampled_pixels(disparity, camera)
    rays, depth = rays[inverse > 0], SCALE / inverse[inverse > 0]
    own = np.abs(depth * (rays @ plane.down) - plane.height) <= view.tolerance
    common = np.abs(depth * (rays @ down_of(camera.pitch, camera.roll)) - camera.position[2]) <= view.tolerance
    within = own & (depth <= view.max_range)
    return float((within & ~common).sum() / max(int(within.sum()), 1))
