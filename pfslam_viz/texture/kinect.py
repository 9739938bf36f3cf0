"""What a Kinect's disparity means: depth, the colour pixel that belongs to it, and whether it shows the floor."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz.robot import CameraGeometry

Array = NDArray[np.float64]

DISPARITIES = 2048  # an 11-bit sensor; its last value means that there was no reading
INVERSE_AT_0, INVERSE_STEP = 3.31, -0.00304  # of the inverse depth
SCALE = 1.03  # m times inverse depth
COLOR_FOCAL = 526.37  # pixels
COLOR_SCALE = 585.051


def inverse_depth(disparity: ArrayLike) -> Array:
    """dd of the course's conversion, -0.00304 d + 3.31: 1.03 over the depth in m. Not positive: no depth."""
    inverse: Array = INVERSE_STEP * np.asarray(disparity, dtype=np.float64) + INVERSE_AT_0
    return inverse


def depth_from_disparity(disparity: ArrayLike) -> Array:
    """Depth in m along the optical axis of raw disparities of any shape; inf where they mean no depth."""
    dd = inverse_depth(disparity)
    depth: Array = np.divide(SCALE, dd, out=np.full(np.shape(dd), np.inf), where=dd > 0)
    return depth


@dataclass(frozen=True, slots=True)
class FloorView:
    """Where a camera's pixels look, worked out once, for telling which of them show the floor.

    Attributes:
        shape: rows and columns of both images.
        first_row: of the depth image; above it no pixel can show floor. Only rows from there on are used, m of them,
        first_color_row: and those of the colour image from here on.
        by_row: (m, 3) float32, and
        by_column: (3, columns) float32: the sum of a pixel's two is the point at 1 m depth, from the camera, in the
            robot's axes.
        position: (3,) the camera's in the robot's frame, m, z from the floor.
        tolerance: m, floor is as far as this from z = 0,
        max_range: and at most so far ahead of the camera, m.
        reach: m, the farthest floor point from the robot's origin.
        color_columns: (columns,) float32 and
        color_rows: (m,) int32: the colour pixel of a depth pixel, its row from first_color_row on, its column less
        color_shift: (2,) float32, what the column moves by at disparity 0, and with each one more.
    """

    shape: tuple[int, int]
    first_row: int
    first_color_row: int
    by_row: NDArray[np.float32]
    by_column: NDArray[np.float32]
    position: Array
    tolerance: float
    max_range: float
    reach: float
    color_columns: NDArray[np.float32]
    color_rows: NDArray[np.int32]
    color_shift: NDArray[np.float32]

    @classmethod
    def of(cls, camera: CameraGeometry, tolerance: float, max_range: float) -> "FloorView":
        """The view of a ``camera`` whose height counts from the floor; equations (35) to (37)."""
        k = camera.intrinsics
        u, v = np.arange(k.width, dtype=np.float64), np.arange(k.height, dtype=np.float64)
        by_row, by_column, position = _rays(camera)
        nearest = float(depth_from_disparity(0))
        ahead, side, up = by_row.T[:, :, None] + by_column[:, None, :]
        looks_down = up < -1e-9
        down = np.where(looks_down, -up, 1.0)
        farthest = (position[2] + tolerance) / down
        farthest = np.where(ahead > 1e-9, np.minimum(farthest, max_range / np.maximum(ahead, 1e-9)), farthest)
        shown = looks_down & (farthest >= np.maximum((position[2] - tolerance) / down, nearest))
        ends = np.hypot(ahead * farthest + position[0], side * farthest + position[1])
        shift = 4.5 * 1750.46 * inverse_depth([0.0, 1.0]) / COLOR_SCALE
        first = int(np.argmax(shown.any(axis=1)))
        color_rows = np.rint((COLOR_FOCAL * v + 16662.0) / COLOR_SCALE).astype(np.int32)[first:]
        first_color_row = min(max(int(color_rows[0]), 0), k.height - 1)
        return cls(
            shape=(k.height, k.width),
            first_row=first,
            first_color_row=first_color_row,
            by_row=by_row[first:].astype(np.float32),
            by_column=by_column.astype(np.float32),
            position=position,
            tolerance=tolerance,
            max_range=max_range,
            reach=float(ends[shown].max(initial=0.0)),
            color_columns=((COLOR_FOCAL * u + 19276.0) / COLOR_SCALE).astype(np.float32),
            color_rows=color_rows - np.int32(first_color_row),
            color_shift=np.array([shift[0], shift[1] - shift[0]], np.float32),
        )

    def over(self, camera: CameraGeometry, pitch: float, roll: float, height: float) -> "FloorView":
        """The view of the same images where ``camera``, whose view this is, is turned and lifted for one of them.

        rad and m. The rows that are used stay, and so do the limits.
        """
        x, y, _ = camera.position
        turned = camera.model_copy(update={"pitch": pitch, "roll": roll, "position": (x, y, height)})
        by_row, by_column, position = _rays(turned)
        return replace(
            self,
            by_row=by_row[self.first_row :].astype(np.float32),
            by_column=by_column.astype(np.float32),
            position=position,
        )

    def crop(self, disparity: NDArray[Any], color: NDArray[Any]) -> tuple[NDArray[np.uint16], NDArray[np.uint8]]:
        """The rows that are used of both images, as views.

        Raises ValueError, which says what is wrong, unless both are what a Kinect of that shape delivers.
        """
        for name, image, want, dtype in (
            ("disparity", disparity, self.shape, np.uint16),
            ("colour", color, (*self.shape, 3), np.uint8),
        ):
            if image.shape != want or image.dtype != dtype:
                size = " x ".join(str(n) for n in image.shape)
                raise ValueError(
                    f"the {name} image is {size} {image.dtype}, not {' x '.join(map(str, want))} {dtype.__name__}"
                )
        return disparity[self.first_row :], color[self.first_color_row :]


def _rays(camera: CameraGeometry) -> tuple[Array, Array, Array]:
    """(rows, 3) and (3, columns), the sum of which is a pixel's point at 1 m depth, and the camera's position (3,)."""
    k = camera.intrinsics
    u, v = np.arange(k.width, dtype=np.float64), np.arange(k.height, dtype=np.float64)
    pose = camera.robot_from_optical()
    rotation = pose[:3, :3]
    by_column = rotation[:, :1] * (u - k.cx) / k.fx
    by_row = np.outer((v - k.cy) / k.fy, rotation[:, 1]) + rotation[:, 2]
    return by_row, by_column, pose[:3, 3].copy()
