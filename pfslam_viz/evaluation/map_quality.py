"""How good a map and a trajectory are when nobody knows the truth.

No single number is enough: a smeared map explains its own scans well, a sparse one has thin walls. Read them together.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.evaluation.revisits import revisit_error
from pfslam_viz.evaluation.scans import end_points, key_scans
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.slam.occupancy_grid import OccupancyGrid

Array = NDArray[np.float64]

WALL_RADIUS = 0.3  # m
WALL_POINTS = 100_000  # the cloud that thickness is measured in is thinned to this
WALL_PLACES = 2_000  # where in the cloud it is measured
FEWEST_NEIGHBOURS = 10
SCORE_SIGMA = 0.1  # m
SCORE_POINTS = 200_000
SCORE_REACH, SCORE_BLOCK = 2.0, 1024  # m, beyond which a wall counts nothing; cells along a block looked at at once


@dataclass(frozen=True, slots=True)
class MapQuality:
    """What can be said of a trajectory and its map without truth; None where there is nothing to measure.

    Attributes:
        end_to_start_gap: m from the first to the last position; 0 is right only for a drive that ends where it began.
        path_ratio: length of the path over the length of the wheels' path; a jittering estimate is longer than 1.
        occupied_area: m² of cells above the threshold, (29); doubled walls make it larger.
        wall_thickness: m; the median over end points of 2 √λ, with λ the smaller eigenvalue of the covariance of the
            end points within 0.3 m.
        scan_to_map_score: in [0, 1]; the mean over end points of exp(-d²/2σ²), with d the distance to the nearest
            occupied cell of the final map and σ = 0.1 m.
        revisit_error: m, and ``revisit_rotation`` deg; see :mod:`pfslam_viz.evaluation.revisits`.
        revisits: how many revisits these are the median of.
    """

    end_to_start_gap: float
    path_ratio: float | None
    occupied_area: float
    wall_thickness: float | None
    scan_to_map_score: float | None
    revisit_error: float | None
    revisit_rotation: float | None
    revisits: int

    def as_dict(self) -> dict[str, float | None]:
        """Plain numbers under names that carry their units."""
        return {
            "end_to_start_gap_m": self.end_to_start_gap,
            "path_ratio": self.path_ratio,
            "occupied_area_m2": self.occupied_area,
            "wall_thickness_m": self.wall_thickness,
            "scan_to_map_score": self.scan_to_map_score,
            "revisit_error_m": self.revisit_error,
            "revisit_rotation_deg": self.revisit_rotation,
            "revisits": self.revisits,
        }


def map_quality(recording: Recording, poses: Array, grid: OccupancyGrid) -> MapQuality:
    """Judge ``poses`` (n, 3), one for each of the recording's first n scans, n > 0, and the ``grid`` made from them."""
    scans = key_scans(recording)
    scans = scans[scans < len(poses)]
    wheels = geometry.path_length(recording.dead_reckoning()[: len(poses)])
    revisit = revisit_error(recording, poses)
    return MapQuality(
        end_to_start_gap=end_to_start_gap(poses),
        path_ratio=geometry.path_length(poses) / wheels if wheels > 0 else None,
        occupied_area=occupied_area(grid),
        wall_thickness=wall_thickness(end_points(recording, scans, WALL_POINTS).at(poses)),
        scan_to_map_score=scan_to_map_score(end_points(recording, scans, SCORE_POINTS).at(poses), grid),
        revisit_error=revisit.translation if revisit else None,
        revisit_rotation=revisit.rotation if revisit else None,
        revisits=revisit.count if revisit else 0,
    )


def end_to_start_gap(poses: Array) -> float:
    """Distance in m between the first and the last position of ``poses`` (n, 3), n > 0."""
    return float(np.hypot(*(poses[-1, :2] - poses[0, :2])))


def occupied_area(grid: OccupancyGrid) -> float:
    """m² of cells above the threshold, (29)."""
    return float(len(grid.occupied_cells())) * grid.cell**2


def wall_thickness(points: Array) -> float | None:
    """Median thickness in m of the walls that end points (m, 2) in the world form; None if there are too few.

    At evenly picked points, twice the square root of the smaller eigenvalue of the covariance of all points within
    0.3 m: two standard deviations across the wall. Places with fewer than ten points are left out.
    """
    from scipy.spatial import cKDTree

    if len(points) < FEWEST_NEIGHBOURS:
        return None
    places = points[np.linspace(0, len(points) - 1, min(WALL_PLACES, len(points))).round().astype(np.intp)]
    tree = cKDTree(points)
    found = tree.query_ball_point(places, WALL_RADIUS)
    counts = np.array([len(f) for f in found])
    owner = np.repeat(np.arange(len(places)), counts)
    offset = points[np.concatenate([np.asarray(f, dtype=np.intp) for f in found])] - places[owner]
    x, y = offset.T

    def mean(values: Array) -> Array:
        means: Array = np.bincount(owner, values, len(places)) / counts
        return means

    mx, my = mean(x), mean(y)
    xx, yy, xy = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
    smaller = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    dense = counts >= FEWEST_NEIGHBOURS
    if not dense.any():
        return None
    return float(np.median(2 * np.sqrt(np.maximum(smaller[dense], 0))))


def scan_to_map_score(points: Array, grid: OccupancyGrid) -> float | None:
    """Mean agreement in [0, 1] of end points (m, 2) in the world with the map; 0 for a point outside the grid."""
    import cv2

    if len(points) == 0:
        return None
    if not grid.has_walls:
        return 0.0
    tiled, halo = grid.tiled(), math.ceil(SCORE_REACH / grid.cell)
    top, left, bottom, right = grid.box()
    cells = np.floor(np.stack([-points[:, 1], points[:, 0]], axis=-1) / grid.cell).astype(np.int64)
    cells = cells[((cells >= (top, left)) & (cells <= (bottom, right))).all(axis=1)]
    blocks, owner = np.unique(cells // SCORE_BLOCK, axis=0, return_inverse=True)
    d = np.full(len(cells), np.inf, np.float32)
    for k, (row, column) in enumerate((blocks * SCORE_BLOCK).tolist()):
        low = max(row - halo, top), max(column - halo, left)
        high = min(row + SCORE_BLOCK - 1 + halo, bottom), min(column + SCORE_BLOCK - 1 + halo, right)
        walls = tiled.dense((*low, *high)) > grid.threshold
        if walls.any():
            distance = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * grid.cell
            mine = owner.ravel() == k
            i, j = (cells[mine] - low).T
            d[mine] = distance[i, j]
    return float(np.exp(-0.5 * (d / SCORE_SIGMA) ** 2).sum() / len(points))
