"""Scan against scan: point-to-line ICP (Censi 2008) with correspondences looked up by bearing.

Scans keep the order of their beams, so the neighbours of a bearing are neighbours in the array, and a match costs a few
look-ups a point instead of a search. An end point's partner is the nearest point of the other scan, if it lies within
the gate: a greatest distance, wide at first and narrower with every iteration. The plain NumPy twin, which searches
among all points, is in ``tests/slam/graph/test_scan_matching.py``.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.graph.settings import ScanMatchingConfig

Array = NDArray[np.float64]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

CHORD = 0.95  # two points at bearings apart by b <= 0.5 rad and as far away are at least sin(b) >= 0.95 b apart
NEARLY = 1e-6  # rad from a beam, within which an approximate bearing does not tell on which side of it it is


class MatchingRules(NamedTuple):
    """What the kernels take of :class:`ScanMatchingConfig`, in the same units."""

    noise: float
    robust_noise: float
    robust_gate: float
    facing: float
    fewest_points: int
    settled_distance: float
    settled_angle: float

    @classmethod
    def of(cls, config: ScanMatchingConfig) -> "MatchingRules":
        """Those of a configuration."""
        return cls(**{name: getattr(config, name) for name in cls._fields})


def open_direction(information: Array) -> Array | None:
    """The unit direction (2,) of which a match's information (3, 3) has nothing, while it has of the other; or None."""
    values, vectors = np.linalg.eigh(information[:2, :2])
    return vectors[:, 0] if values[1] > 0.0 and values[0] < 1e-6 * values[1] else None


@kernel(error_model="numpy")
def approximate_bearing(x: float, y: float, ahead: float) -> float:
    """The bearing of (x, y) to 2e-8 rad, within pi of ``ahead``, without a branch.

    Abramowitz & Stegun (1964), 4.4.49: an arctangent over [0, 1].
    """
    ax, ay = abs(x), abs(y)
    t = min(ax, ay) / max(max(ax, ay), 1e-300)
    u = t * t
    a = 0.0429096138 + u * (-0.0161657367 + u * 0.0028662257)
    a = 0.1999355085 + u * (-0.1420889944 + u * (0.1065626393 + u * (-0.0752896400 + u * a)))
    a = t * (1.0 + u * (-0.3333314528 + u * a))
    a = 0.5 * math.pi - a if ay > ax else a
    a = math.pi - a if x < 0.0 else a
    a = -a if y < 0.0 else a
    return a - 2.0 * math.pi * math.floor((a - ahead) / (2.0 * math.pi) + 0.5)


@kernel()
def first_from(bearings: Floats | Singles, low: int, high: int, value: float, start: int) -> int:
    """The first of ``low`` to ``high`` whose bearing is at least ``value``, or ``high``, looked for from ``start``."""
    k = start
    while k > low and bearings[k - 1] >= value:
        k -= 1
    while k < high and bearings[k] < value:
        k += 1
    return k


@kernel()
def _forget_open_direction(h: Floats, g: Floats, share: float) -> None:
    """Take what a bare corridor seems to say about its own axis out of the information ``h`` and the gradient ``g``.

    A direction is open where the scans have less than ``share`` of their information on the position.

    The walls' roughness and the noise of their normals say a little in every direction; where that is all there is,
    it must not outvote the odometry (Zhang, Kaess & Singh 2016).
    """
    if h[2, 2] <= 0.0:
        return
    a = h[0, 0] - h[0, 2] * h[0, 2] / h[2, 2]
    b = h[0, 1] - h[0, 2] * h[1, 2] / h[2, 2]
    d = h[1, 1] - h[1, 2] * h[1, 2] / h[2, 2]
    half, root = 0.5 * (a + d), math.sqrt(0.25 * ((a - d) * (a - d)) + b * b)
    if half - root > share * (half + root):
        return
    angle = 0.5 * math.atan2(2.0 * b, a - d) + 0.5 * math.pi
    vx, vy = math.cos(angle), math.sin(angle)
    along = vx * g[0] + vy * g[1]
    g[0] -= along * vx
    g[1] -= along * vy
    for i in range(3):  # h <- P h P with P = 1 - v v'
        along = vx * h[i, 0] + vy * h[i, 1]
        h[i, 0] -= along * vx
        h[i, 1] -= along * vy
    for j in range(3):
        along = vx * h[0, j] + vy * h[1, j]
        h[0, j] -= along * vx
        h[1, j] -= along * vy


@kernel()
def _solve(a: Floats, b: Floats) -> None:
    """Solve ``a`` (n, n) x = ``b`` (n,), in place: x ends in ``b``. Gauss's elimination, with the greatest pivots."""
    n = len(b)
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[pivot, k]):
                pivot = i
        if pivot != k:
            b[k], b[pivot] = b[pivot], b[k]
            for j in range(k, n):
                a[k, j], a[pivot, j] = a[pivot, j], a[k, j]
        for i in range(k + 1, n):
            share = a[i, k] / a[k, k]
            b[i] -= share * b[k]
            for j in range(k + 1, n):
                a[i, j] -= share * a[k, j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= a[i, j] * b[j]
        b[i] /= a[i, i]


@kernel(
    "f4[:, :], f4[:, :], f4[:], i8[::1], f8[::1], f8[::1], i8[::1], i8[::1], f8[:, ::1], f8[::1],"
    " i8, i8, f8[::1], MatchingRules",
    error_model="numpy",
)
def match_pairs(
    points: Singles,
    normals: Singles,
    bearings: Singles,
    first: Indices,
    lidar_position: Floats,
    open_shares: Floats,
    references: Indices,
    others: Indices,
    guesses: Floats,
    gates: Floats,
    iterations: int,
    stride: int,
    prior: Floats,
    rules: MatchingRules,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Match scan ``others[k]`` against scan ``references[k]``, from ``guesses`` (k, 3) in the reference's frame.

    ``gates`` (g,) m are the greatest distances of correspondences, used in turn over the ``iterations``. ``prior`` (3,)
    is the information that holds the result to the guess. ``open_shares`` (scans,) is the share of a reference's
    information under which it says nothing in a direction. Returns poses (k, 3), the information of the scans alone
    (k, 3, 3), the share of points that found a partner within the last gate (k,) and their mean |distance| m (k,).
    """
    count = len(references)
    poses, information = np.empty((count, 3)), np.empty((count, 3, 3))
    overlap, distance = np.empty(count), np.empty(count)
    h, g, held = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    most = 0
    for k in range(count):
        for scan in (references[k], others[k]):
            most = max(most, first[scan + 1] - first[scan])
    bearing_of, rx, ry = np.empty(most), np.empty(most), np.empty(most)
    qx, qy, far_of, seen_at = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    partner = np.empty(most, np.int64)
    for k in range(count):
        x, y, heading = guesses[k, 0], guesses[k, 1], guesses[k, 2]
        overlap[k], distance[k] = 0.0, 0.0
        for i in range(3):
            poses[k, i] = guesses[k, i]
            for j in range(3):
                information[k, i, j] = 0.0
        r0, r1 = first[references[k]], first[references[k] + 1]
        q0, q1 = first[others[k]], first[others[k] + 1]
        if r1 - r0 < rules.fewest_points or q1 - q0 < rules.fewest_points:
            continue
        ahead = 0.5 * (bearings[r0] + bearings[r1 - 1])
        n, m = r1 - r0, (q1 - q0 + stride - 1) // stride
        for i in range(n):
            bearing_of[i], rx[i], ry[i] = bearings[r0 + i], points[r0 + i, 0], points[r0 + i, 1]
        for b in range(m):
            qx[b], qy[b], partner[b] = points[q0 + b * stride, 0], points[q0 + b * stride, 1], -1
        for iteration in range(iterations + 1):
            gate = gates[min(iteration, len(gates) - 1)]
            width = max(rules.robust_noise * rules.noise, gate / rules.robust_gate)  # of the robust weight (Cauchy's)
            c, s = math.cos(heading), math.sin(heading)
            hxx = hxy = hxt = hyy = hyt = htt = 0.0  # information and gradient of the scans: one Gauss-Newton step
            gx = gy = gt = 0.0
            partners, sum_distance, middle = 0, 0.0, 0
            for b in range(m):  # in a loop of its own, which the compiler makes do several at once
                lx = x + (c * qx[b] - s * qy[b]) - lidar_position[0]
                ly = y + (s * qx[b] + c * qy[b]) - lidar_position[1]
                far_of[b] = math.sqrt(lx * lx + ly * ly)
                seen_at[b] = approximate_bearing(lx, ly, ahead)
            for b in range(m):
                ox, oy = c * qx[b] - s * qy[b], s * qx[b] + c * qy[b]
                px, py = x + ox, y + oy
                far, bearing = CHORD * far_of[b], seen_at[b]
                best, at = gate * gate, partner[b]
                if at >= 0:  # the partner of the iteration before is mostly near, and leaves little to look at
                    dx, dy = rx[at] - px, ry[at] - py
                    d = dx * dx + dy * dy
                    away = far * min(abs(bearing_of[at] - bearing), 0.5)
                    if d < best and away * away < d:
                        best = d
                    else:
                        at = -1
                middle = first_from(bearing_of, 0, n, bearing, middle)
                for side in range(-1, 2, 2):  # outwards, as long as a point at that bearing can still be nearer
                    i = middle if side > 0 else middle - 1
                    while 0 <= i < n:
                        away = far * min(abs(bearing_of[i] - bearing), 0.5)
                        if away * away >= best:
                            break
                        dx, dy = rx[i] - px, ry[i] - py
                        d = dx * dx + dy * dy
                        if d < best:
                            best, at = d, i
                        i += side
                partner[b] = at
                if at < 0:
                    continue
                nx, ny = normals[r0 + at, 0], normals[r0 + at, 1]
                if nx == 0.0 and ny == 0.0:
                    continue  # the partner lies on no wall
                mx, my = normals[q0 + b * stride, 0], normals[q0 + b * stride, 1]
                if (mx != 0.0 or my != 0.0) and nx * (c * mx - s * my) + ny * (s * mx + c * my) < rules.facing:
                    continue  # the other side of a wall, or another wall
                # The distance from the partner's wall, its robust weight, and how it changes with the heading
                e = nx * (px - rx[at]) + ny * (py - ry[at])
                off = e / width
                w = 1.0 / (1.0 + off * off) / (rules.noise * rules.noise)
                jt = -nx * oy + ny * ox
                partners += 1
                sum_distance += abs(e)
                hxx += w * nx * nx
                hxy += w * nx * ny
                hxt += w * nx * jt
                hyy += w * ny * ny
                hyt += w * ny * jt
                htt += w * jt * jt
                gx += w * nx * e
                gy += w * ny * e
                gt += w * jt * e
            h[0, 0], h[0, 1], h[0, 2], g[0] = hxx, hxy, hxt, gx
            h[1, 0], h[1, 1], h[1, 2], g[1] = hxy, hyy, hyt, gy
            h[2, 0], h[2, 1], h[2, 2], g[2] = hxt, hyt, htt, gt
            _forget_open_direction(h, g, open_shares[references[k]])
            overlap[k] = partners / max(m, 1)
            distance[k] = sum_distance / max(partners, 1)
            for i in range(3):
                for j in range(3):
                    information[k, i, j] = held[i, j] = h[i, j]
            if iteration == iterations or partners < rules.fewest_points:
                break
            g[0] += prior[0] * (x - guesses[k, 0])  # information and gradient with the prior's
            g[1] += prior[1] * (y - guesses[k, 1])
            g[2] += prior[2] * (heading - guesses[k, 2])
            for axis in range(3):
                held[axis, axis] += prior[axis]
            _solve(held, g)
            x -= g[0]
            y -= g[1]
            heading -= g[2]
            settled = abs(g[0]) + abs(g[1]) < rules.settled_distance and abs(g[2]) < rules.settled_angle
            if settled and iteration >= len(gates) - 1:
                break
        poses[k, 0], poses[k, 1], poses[k, 2] = x, y, heading
    return poses, information, overlap, distance
