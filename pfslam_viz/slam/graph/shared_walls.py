"""The walls that several key scans saw: their directions from the end points of all of them together.

Point-to-line matching is as good as the lines. One scan has few end points on a door frame, on the side of a box or far
down a corridor: too few for a line, so that they have no say, though they tell best where along it the robot is; and
ranging noise turns a line through few points. Once the poses of the scans about it are known to a centimetre or so,
their end points together are enough. The poses only choose whose end points are put together: no end point is moved, so
that a match remains one of two scans. (Surfaces from several scans are what local maps give to
scan-to-map matching, as in KISS-ICP, Vizzo et al. 2023.) The kernel's plain NumPy twin is in
``tests/slam/graph/test_shared_walls.py``.
"""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.graph.scan_matching import CHORD, first_from
from pfslam_viz.slam.graph.walls import line_normal

Array = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]


@kernel("f4[:, ::1], f4[:, ::1], i8[::1], f8[::1], f8[:, ::1], i8, i8, i8, f8, f8, i8")
def shared_normals(
    rows: Singles,
    own: Singles,
    first: Indices,
    lidar_position: Array,
    poses: Array,
    start: int,
    end: int,
    scans: int,
    reach: float,
    flatness: float,
    fewest: int,
) -> Singles:
    """Unit normals (m, 2), towards the lidar, of the walls that the m end points of scans ``start`` to ``end`` lie on.

    Scan k owns ``rows`` (p, 5), points, normals and bearings, from ``first[k]`` to ``first[k + 1]``, seen from its
    ``poses`` (k, 3); ``own`` (p, 2) are the normals by itself. The end points of so many ``scans`` before and after
    count that lie within ``reach`` m and not on the other side of a wall, as their own normals tell. Where they are
    less than the ``fewest``, or form no line by their covariance's ``flatness``, a normal is the scan's own: that
    they do not may be for poses that are not known well enough.
    """
    bearings, offset = rows[:, 4], first[start]
    out = np.empty((first[end] - offset, 2), np.float32)
    for k in range(start, end):
        low, high = max(k - scans, 0), min(k + scans + 1, len(poses))
        moments = np.zeros((first[k + 1] - first[k], 6))
        for j in range(low, high):
            j0, j1 = first[j], first[j + 1]
            if j1 == j0:
                continue
            turn = poses[k, 2] - poses[j, 2]
            c, s = math.cos(turn), math.sin(turn)
            cj, sj = math.cos(poses[j, 2]), math.sin(poses[j, 2])
            ahead_x, ahead_y = poses[k, 0] - poses[j, 0], poses[k, 1] - poses[j, 1]
            x, y = cj * ahead_x + sj * ahead_y, cj * ahead_y - sj * ahead_x
            ahead = 0.5 * (rows[j0, 4] + rows[j1 - 1, 4])
            middle = j0
            for b in range(first[k], first[k + 1]):
                px, py = x + c * rows[b, 0] - s * rows[b, 1], y + s * rows[b, 0] + c * rows[b, 1]
                nx, ny = c * own[b, 0] - s * own[b, 1], s * own[b, 0] + c * own[b, 1]
                lx, ly = px - lidar_position[0], py - lidar_position[1]
                far = math.sqrt(lx * lx + ly * ly)
                bearing = math.atan2(ly, lx)
                bearing -= 2.0 * math.pi * math.floor((bearing - ahead) / (2.0 * math.pi) + 0.5)
                middle = first_from(bearings, j0, j1, bearing, middle)
                at = b - first[k]
                for side in range(-1, 2, 2):
                    i = middle if side > 0 else middle - 1
                    while j0 <= i < j1:
                        if CHORD * far * min(abs(rows[i, 4] - bearing), 0.5) > reach:
                            break
                        dx, dy = rows[i, 0] - px, rows[i, 1] - py
                        facing = nx * own[i, 0] + ny * own[i, 1]
                        if dx * dx + dy * dy <= reach * reach and facing >= 0.0:
                            ox, oy = c * dx + s * dy, c * dy - s * dx  # in the frame of scan k
                            moments[at, 0] += 1.0
                            moments[at, 1] += ox
                            moments[at, 2] += oy
                            moments[at, 3] += ox * ox
                            moments[at, 4] += ox * oy
                            moments[at, 5] += oy * oy
                        i += side
        for b in range(first[k], first[k + 1]):
            at, to = b - first[k], b - offset
            n = moments[at, 0]
            out[to, 0], out[to, 1] = own[b, 0], own[b, 1]
            if n < fewest:
                continue
            mx, my = moments[at, 1] / n, moments[at, 2] / n
            xx, xy, yy = moments[at, 3] / n - mx * mx, moments[at, 4] / n - mx * my, moments[at, 5] / n - my * my
            to_lidar_x, to_lidar_y = lidar_position[0] - rows[b, 0], lidar_position[1] - rows[b, 1]
            wx, wy, _, _ = line_normal(xx, xy, yy, to_lidar_x, to_lidar_y, flatness)
            if wx != 0.0 or wy != 0.0:
                out[to, 0], out[to, 1] = wx, wy
    return out
