"""The walls in a scan: the direction of the one that each end point lies on, from its neighbours.

Scans keep the order of their beams, so the neighbours of an end point are neighbours in the array. The kernels' plain
NumPy twins are in ``tests/slam/graph/test_walls.py``.
"""

import math

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@kernel("f8[:, ::1], f8[::1], f8")
def within(points: Floats, center: Floats, distance: float) -> Floats:
    """Those of the points (m, 2) that lie at most ``distance`` from ``center`` (2,), (k, 2)."""
    out = np.empty(points.shape)
    k = 0
    for b in range(len(points)):
        x, y = points[b, 0] - center[0], points[b, 1] - center[1]
        if x * x + y * y <= distance * distance:
            out[k, 0], out[k, 1] = points[b, 0], points[b, 1]
            k += 1
    return out[:k]


@kernel("f8[:, ::1], i8, f8")
def thinned(points: Floats, most: int, sparse: float) -> Floats:
    """Every so many of the end points (m, 2) that ``most`` are left, and all that lie ``sparse`` m from the last one.

    The far end of a corridor has few end points, and they alone tell how far along it the robot is.
    """
    stride = 1 + max(len(points) - 1, 0) // most
    out = np.empty(points.shape)
    k, last = 0, -stride
    for b in range(len(points)):
        if b - last < stride:
            dx, dy = points[b, 0] - points[last, 0], points[b, 1] - points[last, 1]
            if dx * dx + dy * dy < sparse * sparse:
                continue
        out[k, 0], out[k, 1] = points[b, 0], points[b, 1]
        k, last = k + 1, b
    return out[:k]


@kernel()
def beam_increment(points: Floats, lidar_position: Floats) -> float:
    """The median angle between successive end points (m, 2) as seen from the lidar, rad; 0 for fewer than two."""
    if len(points) < 2:
        return 0.0
    turns = np.empty(len(points) - 1)
    for b in range(len(points) - 1):
        ax, ay = points[b, 0] - lidar_position[0], points[b, 1] - lidar_position[1]
        bx, by = points[b + 1, 0] - lidar_position[0], points[b + 1, 1] - lidar_position[1]
        turns[b] = abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
    middle = len(turns) // 2
    upper: float = _select(turns, middle)
    if len(turns) % 2 == 1:
        return upper
    lower: float = turns[0]
    for b in range(1, middle):
        lower = max(lower, turns[b])
    return (lower + upper) / 2.0


@kernel()
def _select(values: Floats, k: int) -> float:
    """The k-th smallest of the values, from 0; it ends at its place, with smaller ones before it (Hoare 1961)."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    found: float = values[k]
    return found


@kernel()
def line_normal(
    xx: float, xy: float, yy: float, to_lidar_x: float, to_lidar_y: float, flatness: float
) -> tuple[float, float, float, float]:
    """The unit normal, towards the lidar, of the line through points of this covariance (m²), and its eigenvalues.

    Zero where they do not form a line: where the smaller eigenvalue is more than ``flatness`` of the larger.
    """
    half, root = 0.5 * (xx + yy), math.sqrt(0.25 * ((xx - yy) * (xx - yy)) + xy * xy)
    small, large = half - root, half + root
    if large < 1e-6 or small > flatness * large:
        return 0.0, 0.0, small, large
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)  # along the wall
    nx, ny = -math.sin(angle), math.cos(angle)
    if nx * to_lidar_x + ny * to_lidar_y < 0.0:
        nx, ny = -nx, -ny
    return nx, ny, small, large


@kernel()
def wall_normals(
    points: Floats, lidar_position: Floats, reach: float, spacings: float, neighbours: int, flatness: float
) -> tuple[Floats, float]:
    """Unit normals (m, 2), towards the lidar, of the wall through each end point and its neighbours, and their noise.

    Those within ``reach`` m count, or within ``spacings`` times the distance between beams there if that is more, since
    far walls have their end points far apart. At most so many ``neighbours`` to either side count. Zero where fewer
    than two lie there, or where they do not form a line: where the smaller eigenvalue of their covariance is more than
    ``flatness`` of the larger.

    The noise is the normals' mean variance, rad²: that of a straight line's direction fitted to n points is their
    smaller eigenvalue over the larger and over n - 2. Uneven walls count as noisy ones.
    """
    m = len(points)
    out = np.zeros((m, 2))
    noise, walls = 0.0, 0
    increment = beam_increment(points, lidar_position)
    for b in range(m):
        away = math.hypot(points[b, 0] - lidar_position[0], points[b, 1] - lidar_position[1])
        near = max(reach, spacings * away * increment)
        n = 1
        sx, sy = points[b, 0], points[b, 1]
        sxx, sxy, syy = sx * sx, sx * sy, sy * sy
        for side in range(-1, 2, 2):
            k = b + side
            reached = 0
            while 0 <= k < m and reached < neighbours:
                dx, dy = points[k, 0] - points[b, 0], points[k, 1] - points[b, 1]
                if dx * dx + dy * dy > near * near:
                    break
                sx += points[k, 0]
                sy += points[k, 1]
                sxx += points[k, 0] * points[k, 0]
                sxy += points[k, 0] * points[k, 1]
                syy += points[k, 1] * points[k, 1]
                n += 1
                reached += 1
                k += side
        if n < 3:
            continue
        mx, my = sx / n, sy / n
        a, d, c = sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my
        to_lidar_x, to_lidar_y = lidar_position[0] - points[b, 0], lidar_position[1] - points[b, 1]
        nx, ny, small, large = line_normal(a, d, c, to_lidar_x, to_lidar_y, flatness)
        if nx == 0.0 and ny == 0.0:
            continue
        noise += max(small, 0.0) / (large * (n - 2))
        walls += 1
        out[b, 0], out[b, 1] = nx, ny
    return out, noise / max(walls, 1)


@kernel("f8[:, ::1], f8[::1], f8, f8, i8, f8, f4[:, ::1]")
def describe(
    points: Floats,
    lidar_position: Floats,
    reach: float,
    spacings: float,
    neighbours: int,
    flatness: float,
    rows: Singles,
) -> float:
    """Fill a scan's ``rows`` (m, 5): its end points, their :func:`wall_normals`, and their bearings from the lidar.

    Bearings are those of successive beams, in [-pi, pi] at first and continued beyond pi; beams may lie more than pi
    apart. Returns the normals' noise, rad².
    """
    normals, noise = wall_normals(points, lidar_position, reach, spacings, neighbours, flatness)
    turns, last = 0.0, 0.0
    for b in range(len(points)):
        bearing = math.atan2(points[b, 1] - lidar_position[1], points[b, 0] - lidar_position[0])
        if b > 0 and bearing - last < -0.1:
            turns += 2.0 * math.pi
        last = bearing
        rows[b, 0], rows[b, 1] = points[b, 0], points[b, 1]
        rows[b, 2], rows[b, 3] = normals[b, 0], normals[b, 1]
        rows[b, 4] = bearing + turns
    return noise
