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
from pfslam_viz.slam.graph.scan_matching import CHORD, NEARLY, approximate_bearing, first_from
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
    offset, longest = first[start], 0
    for j in range(max(start - scans, 0), min(end + scans, len(poses))):
        longest = max(longest, first[j + 1] - first[j])
    here, there = np.empty((4, longest)), np.empty((5, longest))  # of the one scan's end points, and of the other's
    px, py, away, bearing_of = here[0], here[1], here[2], here[3]
    xs, ys, own_x, own_y, bearings = there[0], there[1], there[2], there[3], there[4]
    out = np.empty((first[end] - offset, 2), np.float32)
    for k in range(start, end):
        k0, count = first[k], first[k + 1] - first[k]
        low, high = max(k - scans, 0), min(k + scans + 1, len(poses))
        moments = np.zeros((count, 6))
        for j in range(low, high):
            j0, m = first[j], first[j + 1] - first[j]
            if m == 0:
                continue
            for i in range(m):
                xs[i], ys[i], bearings[i] = rows[j0 + i, 0], rows[j0 + i, 1], rows[j0 + i, 4]
                own_x[i], own_y[i] = own[j0 + i, 0], own[j0 + i, 1]
            turn = poses[k, 2] - poses[j, 2]
            c, s = math.cos(turn), math.sin(turn)
            cj, sj = math.cos(poses[j, 2]), math.sin(poses[j, 2])
            ahead_x, ahead_y = poses[k, 0] - poses[j, 0], poses[k, 1] - poses[j, 1]
            x, y = cj * ahead_x + sj * ahead_y, cj * ahead_y - sj * ahead_x
            ahead = 0.5 * (bearings[0] + bearings[m - 1])
            for b in range(count):  # several at a time: there is no branch in it
                rx, ry = rows[k0 + b, 0], rows[k0 + b, 1]
                px[b], py[b] = x + c * rx - s * ry, y + s * rx + c * ry
                lx, ly = px[b] - lidar_position[0], py[b] - lidar_position[1]
                away[b], bearing_of[b] = math.sqrt(lx * lx + ly * ly), approximate_bearing(lx, ly, ahead)
            middle = 0
            for b in range(count):
                bx, by, bearing = px[b], py[b], bearing_of[b]
                middle = first_from(bearings, 0, m, bearing, middle)
                if (middle < m and bearings[middle] - bearing < NEARLY) or (
                    middle > 0 and bearing - bearings[middle - 1] < NEARLY
                ):
                    bearing = math.atan2(by - lidar_position[1], bx - lidar_position[0])
                    bearing -= 2.0 * math.pi * math.floor((bearing - ahead) / (2.0 * math.pi) + 0.5)
                    middle = first_from(bearings, 0, m, bearing, middle)
                limit = reach / max(CHORD * away[b], 1e-9)  # rad, beyond which nothing is within reach
                if limit >= 0.5:
                    limit = math.inf
                ox, oy = own[k0 + b, 0], own[k0 + b, 1]
                nx, ny = c * ox - s * oy, s * ox + c * oy
                n, sx, sy = moments[b, 0], moments[b, 1], moments[b, 2]
                sxx, sxy, syy = moments[b, 3], moments[b, 4], moments[b, 5]
                for side in range(-1, 2, 2):
                    i = middle if side > 0 else middle - 1
                    while 0 <= i < m and abs(bearings[i] - bearing) <= limit:
                        dx, dy = xs[i] - bx, ys[i] - by
                        facing = nx * own_x[i] + ny * own_y[i]
                        w = 1.0 if (dx * dx + dy * dy <= reach * reach) & (facing >= 0.0) else 0.0
                        tx, ty = w * (c * dx + s * dy), w * (c * dy - s * dx)  # in the frame of scan k
                        n += w
                        sx += tx
                        sy += ty
                        sxx += tx * tx
                        sxy += tx * ty
                        syy += ty * ty
                        i += side
                moments[b, 0], moments[b, 1], moments[b, 2] = n, sx, sy
                moments[b, 3], moments[b, 4], moments[b, 5] = sxx, sxy, syy
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
