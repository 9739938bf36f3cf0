"""What a Kinect's disparity means: depth, the colour pixel that belongs to it, and whether it shows the floor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz.robot import CameraGeometry

Array = NDArray[np.float64]

DISPARITIES = 2048  # an 11-bit sensor; its last value means that there was no reading
COLOR_FOCAL = 526.37  # pixels
COLOR_SCALE = 585.051


def inverse_depth(disparity: ArrayLike) -> Array:
    """dd of the course's conversion, -0.00304 d + 3.31: 1.03 over the depth in m. Not positive: no depth."""
    return -0.00304 * np.asarray(disparity, dtype=np.float64) + 3.31


def depth_from_disparity(disparity: ArrayLike) -> Array:
    """Depth in m along the optical axis of raw disparities of any shape; inf where they mean no depth."""
    dd = inverse_depth(disparity)
    return np.divide(1.03, dd, out=np.full(np.shape(dd), np.inf), where=dd > 0)


@dataclass(frozen=True, slots=True)
class FloorView:
    """What of a depth image can be floor, worked out once for a camera: arrays over its (rows, columns) pixels.

    Attributes:
        rays: (rows, columns, 2) float32 x and y, in the robot's frame, of a point at 1 m depth, from the camera.
        position: (2,) x and y of the camera in the robot's frame, m.
        low, high: (rows, columns) int32: a pixel shows floor when low <= disparity <= high.
        depths: (2048,) float32 m by disparity.
        color_columns: (columns,) float32 and ``color_rows`` (rows,) int32: the colour pixel of a depth pixel, less
        color_shifts: (2048,) float32, by which its column moves with the disparity.
        reach: m, the farthest floor point from the robot's origin.
    """

    rays: NDArray[np.float32]
    position: Array
    low: NDArray[np.int32]
    high: NDArray[np.int32]
    depths: NDArray[np.float32]
    color_columns: NDArray[np.float32]
    color_rows: NDArray[np.int32]
    color_shifts: NDArray[np.float32]
    reach: float

    @classmethod
    def of(cls, camera: CameraGeometry, tolerance: float, max_range: float) -> "FloorView":
        """The view of a ``camera`` whose height counts from the floor.

        Floor is what lies within ``tolerance`` m of z = 0 and at most ``max_range`` m ahead of the camera. Whether a
        point does depends only on pixel and disparity: equations (35) to (37), solved for the disparity.
        """
        k = camera.intrinsics
        u, v = np.arange(k.width, dtype=np.float64), np.arange(k.height, dtype=np.float64)
        optical = np.stack([*np.meshgrid((u - k.cx) / k.fx, (v - k.cy) / k.fy), np.ones((k.height, k.width))], axis=-1)
        pose = camera.robot_from_optical()
        rays = optical @ pose[:3, :3].T
        down, height = -rays[..., 2], float(pose[2, 3])
        looks_down = down > 1e-9
        down = np.where(looks_down, down, 1.0)
        nearest, farthest = (height - tolerance) / down, (height + tolerance) / down
        ahead = rays[..., 0]
        farthest = np.where(ahead > 1e-9, np.minimum(farthest, max_range / np.maximum(ahead, 1e-9)), farthest)
        # Depth grows with disparity.
        low = np.ceil((3.31 - 1.03 / np.maximum(nearest, 1e-3)) / 0.00304)
        high = np.floor((3.31 - 1.03 / np.maximum(farthest, 1e-3)) / 0.00304)
        low = np.where(looks_down & (nearest > 0), np.maximum(low, 0), DISPARITIES).astype(np.int32)
        high = np.where(farthest > 0, np.minimum(high, DISPARITIES - 2), -1).astype(np.int32)
        shown = low <= high
        disparity = np.arange(DISPARITIES)
        depths = depth_from_disparity(disparity)
        ends = rays[..., :2] * depths[np.clip(high, 0, DISPARITIES - 1)][..., None] + pose[:2, 3]
        return cls(
            rays=np.ascontiguousarray(rays[..., :2], dtype=np.float32),
            position=pose[:2, 3].copy(),
            low=low,
            high=high,
            depths=depths.astype(np.float32),
            color_columns=((COLOR_FOCAL * u + 19276.0) / COLOR_SCALE).astype(np.float32),
            color_rows=np.rint((COLOR_FOCAL * v + 16662.0) / COLOR_SCALE).astype(np.int32),
            color_shifts=(4.5 * 1750.46 * inverse_depth(disparity) / COLOR_SCALE).astype(np.float32),
            reach=float(np.hypot(ends[..., 0], ends[..., 1])[shown].max(initial=0.0)),
        )
