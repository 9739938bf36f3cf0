"""Scan against scan: point-to-line ICP (Censi 2008) with correspondences looked up by bearing.

Scans keep the order of their beams, so the neighbours of a bearing are neighbours in the array, and a match costs a few
look-ups a point instead of a search.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz.slam.pose_graph import Array, Indices

Floats = NDArray[np.float64]


@dataclass(slots=True)
class ScanStore:
    """Key scans, one after the other: points in the robot's frame with the normals of the walls they lie on.

    Scan k owns rows ``first[k]`` to ``first[k + 1]``; ``bearing`` is increasing in a scan, seen from the lidar.
    """

    sensor: Array
    points: Array  # (p, 2) m
    normals: Array  # (p, 2), zero where no wall could be fitted
    bearings: Array  # (p,) rad
    first: Indices  # (scans + 1,)

    @classmethod
    def empty(cls, sensor: Array) -> "ScanStore":
        """No scans yet; ``sensor`` (2,) is the lidar in the robot's frame."""
        return cls(sensor, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(1, np.intp))


@njit(cache=True, nogil=True)
def wall_normals(points: Floats, sensor: Floats, reach: float) -> Floats:
    """Unit normals (m, 2), towards the lidar, of the wall through each end point and its neighbours in ``reach`` m.

    Zero where fewer than three neighbours lie there, or where they do not form a line.
    """
    m = len(points)
    out = np.zeros((m, 2))
    for b in range(m):
        n = 1
        sx, sy = points[b, 0], points[b, 1]
        sxx, sxy, syy = sx * sx, sx * sy, sy * sy
        for side in (-1, 1):
            k = b + side
            while 0 <= k < m and n < 40:
                dx, dy = points[k, 0] - points[b, 0], points[k, 1] - points[b, 1]
                if dx * dx + dy * dy > reach * reach:
                    break
                sx += points[k, 0]
                sy += points[k, 1]
                sxx += points[k, 0] * points[k, 0]
                sxy += points[k, 0] * points[k, 1]
                syy += points[k, 1] * points[k, 1]
                n += 1
                k += side
        if n < 3:
            continue
        mx, my = sx / n, sy / n
        a, d, c = sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my
        half, root = 0.5 * (a + c), math.sqrt(max(0.25 * (a - c) ** 2 + d * d, 0.0))
        small, large = half - root, half + root
        if large < 1e-6 or small > 0.1 * large:
            continue
        angle = 0.5 * math.atan2(2.0 * d, a - c)  # along the wall
        nx, ny = -math.sin(angle), math.cos(angle)
        if nx * (sensor[0] - points[b, 0]) + ny * (sensor[1] - points[b, 1]) < 0.0:
            nx, ny = -nx, -ny
        out[b, 0], out[b, 1] = nx, ny
    return out


@njit(cache=True, nogil=True)
def _nearest(bearings: Floats, low: int, high: int, value: float) -> int:
    while low < high:
        middle = (low + high) // 2
        if bearings[middle] < value:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def match_pairs(
    points: Floats,
    normals: Floats,
    bearings: Floats,
    first: Indices,
    sensor: Floats,
    references: Indices,
    others: Indices,
    guesses: Floats,
    gates: Floats,
    iterations: int,
    stride: int,
    sigma: float,
    prior: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Match scan ``others[k]`` against scan ``references[k]``, from ``guesses`` (k, 3) in the reference's frame.

    ``gates`` (g,) m are the greatest distances of correspondences, used in turn over the ``iterations``. ``prior`` (3,)
    is the information that holds the result to the guess. Returns poses (k, 3), the information of the scans alone
    (k, 3, 3), the share of points that found a partner within the last gate (k,) and their mean |distance| m (k,).
    """
    count = len(references)
    poses, information = guesses.copy(), np.zeros((count, 3, 3))
    overlap, distance = np.zeros(count), np.zeros(count)
    h, g = np.zeros((3, 3)), np.zeros(3)
    for k in range(count):
        r0, r1 = first[references[k]], first[references[k] + 1]
        q0, q1 = first[others[k]], first[others[k] + 1]
        if r1 - r0 < 5 or q1 - q0 < 5:
            continue
        x, y, heading = guesses[k, 0], guesses[k, 1], guesses[k, 2]
        for iteration in range(iterations + 1):
            gate = gates[min(iteration, len(gates) - 1)]
            window = 1.5 * gate
            c, s = math.cos(heading), math.sin(heading)
            h[:, :] = 0.0
            g[:] = 0.0
            partners, used, sum_distance = 0, 0, 0.0
            for b in range(q0, q1, stride):
                used += 1
                ox, oy = c * points[b, 0] - s * points[b, 1], s * points[b, 0] + c * points[b, 1]
                px, py = x + ox, y + oy
                lx, ly = px - sensor[0], py - sensor[1]
                far = math.hypot(lx, ly)
                bearing = math.atan2(ly, lx)
                width = window / max(far, 0.3)
                low = _nearest(bearings, r0, r1, bearing - width)
                best, at = gate * gate, -1
                i = low
                while i < r1 and bearings[i] <= bearing + width:
                    dx, dy = points[i, 0] - px, points[i, 1] - py
                    d = dx * dx + dy * dy
                    if d < best:
                        best, at = d, i
                    i += 1
                if at < 0:
                    continue
                nx, ny = normals[at, 0], normals[at, 1]
                if nx == 0.0 and ny == 0.0:
                    continue
                mx, my = normals[b, 0], normals[b, 1]
                if (mx != 0.0 or my != 0.0) and nx * (c * mx - s * my) + ny * (s * mx + c * my) < 0.7:
                    continue  # the other side of a wall, or another wall
                e = nx * (px - points[at, 0]) + ny * (py - points[at, 1])
                partners += 1
                sum_distance += abs(e)
                w = 1.0 / (1.0 + (e / (2.0 * sigma)) ** 2) / (sigma * sigma)
                jt = -nx * oy + ny * ox
                h[0, 0] += w * nx * nx
                h[0, 1] += w * nx * ny
                h[0, 2] += w * nx * jt
                h[1, 1] += w * ny * ny
                h[1, 2] += w * ny * jt
                h[2, 2] += w * jt * jt
                g[0] += w * nx * e
                g[1] += w * ny * e
                g[2] += w * jt * e
            h[1, 0], h[2, 0], h[2, 1] = h[0, 1], h[0, 2], h[1, 2]
            overlap[k] = partners / max(used, 1)
            distance[k] = sum_distance / max(partners, 1)
            information[k] = h
            if iteration == iterations or partners < 5:
                break
            a = h.copy()
            gx = g.copy()
            gx[0] += prior[0] * (x - guesses[k, 0])
            gx[1] += prior[1] * (y - guesses[k, 1])
            gx[2] += prior[2] * (heading - guesses[k, 2])
            for d3 in range(3):
                a[d3, d3] += prior[d3]
            step = np.linalg.solve(a, gx)
            x -= step[0]
            y -= step[1]
            heading -= step[2]
            if abs(step[0]) + abs(step[1]) < 1e-4 and abs(step[2]) < 1e-4 and iteration >= len(gates) - 1 and iteration < iterations - 1:
                # converged: one more pass finds the information there
                gate = gates[len(gates) - 1]
        poses[k, 0], poses[k, 1], poses[k, 2] = x, y, heading
    return poses, information, overlap, distance
