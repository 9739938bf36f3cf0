"""The value that replay yields for every scan: all that viewer, evaluation and export may know."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import Estimate, Revision

if TYPE_CHECKING:
    from pfslam_viz.texture.floor_texture import FloorTexture

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Step:
    """One scan, after the filter has seen it. Arrays, not drawings; grids are live views, not copies.

    Attributes:
        index: scan index in the recording.
        stamp: s, the recording's clock.
        time: s since the first scan.
        estimate: the filter's belief (particles, weights, best, mean, ...).
        dead_reckoning: (3,) pose by odometry alone.
        end_points: (m, 2) the scan's end points in the world, from the best particle's pose.
        hits: (m,) bool, whether an end point fell on a cell occupied before this scan.
        dead_reckoning_end_points: (m, 2) the same scan from the dead-reckoned pose.
        grid: the filter's map.
        dead_reckoning_grid: the map that dead reckoning writes from the same scans.
        revision: what hindsight changed of all that came before, in a step that changed it.
        texture: the floor texture, in a step that changed it.
        color_frame: index into the recording's colour frames of the one painted in this step, if any.
        disparity_frame: the same for disparity.
        truth: (3,) the true pose in the frame of the first true pose, if known.
        seconds: time spent per phase: predict, update, map, resample, revise, dead_reckoning, texture.
    """

    index: int
    stamp: float
    time: float
    estimate: Estimate
    dead_reckoning: Array
    end_points: Array
    hits: NDArray[np.bool_]
    dead_reckoning_end_points: Array
    grid: OccupancyGrid
    dead_reckoning_grid: OccupancyGrid
    revision: Revision | None
    texture: "FloorTexture | None"
    color_frame: int | None
    disparity_frame: int | None
    truth: Array | None
    seconds: dict[str, float]
