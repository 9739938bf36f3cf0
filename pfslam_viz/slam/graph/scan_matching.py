"""Scan against scan: point-to-line ICP (Censi 2008) with correspondences looked up by bearing.

Scans keep the order of their beams, so the neighbours of a bearing are neighbours in the array, and a match costs a few
look-ups a point instead of a search. An end point's partner is the nearest point of the other scan, if it lies within
the gate: a greatest distance, wide at first and narrower with every iteration. The plain NumPy twin, which searches
among all points, is in ``tests/slam/graph/test_scan_matching.py``.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz.slam.graph.settings import ScanMatchingConfig

Array = NDArray[np.float64]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

CHORD = 0.95  # two points at bearings apart by b <= 0.5 rad and as far away are at least sin(b) >= 0.95 b apart


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


@njit(cache=True, nogil=True)
def _first_from(bearings: Singles, low: int, high: int, value: float, start: int) -> int:
    """The first of ``low`` to ``high`` whose bearing is at least ``value``, or ``high``, looked for from ``start``."""
    k = start
    while k > low and bearings[k - 1] >= value:
        k -= 1
    while k < high and bearings[k] < value:
        k += 1
    return k


@njit(cache=True, nogil=True)
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
    half, root = 0.5 * (a + d), math.sqrt(0.25 * (a - d) ** 2 + b * b)
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


@njit(cache=True, nogil=True)
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
    poses, information = guesses.copy(), np.zeros((count, 3, 3))
    overlap, distance = np.zeros(count), np.zeros(count)
    h, g = np.zeros((3, 3)), np.zeros(3)
    for k in range(count):
        r0, r1 = first[references[k]], first[references[k] + 1]
        q0, q1 = first[others[k]], first[others[k] + 1]
        if r1 - r0 < rules.fewest_points or q1 - q0 < rules.fewest_points:
            continue
        x, y, heading = guesses[k, 0], guesses[k, 1], guesses[k, 2]
        ahead = 0.5 * (bearings[r0] + bearings[r1 - 1])
        for iteration in range(iterations + 1):
            gate = gates[min(iteration, len(gates) - 1)]
            width = max(rules.robust_noise * rules.noise, gate / rules.robust_gate)  # of the robust weight (Cauchy's)
            c, s = math.cos(heading), math.sin(heading)
            h[:, :] = 0.0  # information and gradient of the scans: one Gauss-Newton step
            g[:] = 0.0
            partners, used, sum_distance, middle = 0, 0, 0.0, r0
            for b in range(q0, q1, stride):
                used += 1
                ox, oy = c * points[b, 0] - s * points[b, 1], s * points[b, 0] + c * points[b, 1]
                px, py = x + ox, y + oy
                lx, ly = px - lidar_position[0], py - lidar_position[1]
                far = math.sqrt(lx * lx + ly * ly)
                bearing = math.atan2(ly, lx)
                bearing -= 2.0 * math.pi * math.floor((bearing - ahead) / (2.0 * math.pi) + 0.5)
                best, at = gate * gate, -1
                middle = _first_from(bearings, r0, r1, bearing, middle)
                for side in (-1, 1):  # outwards, as long as a point at that bearing can still be nearer
                    i = middle if side > 0 else middle - 1
                    while r0 <= i < r1:
                        away = CHORD * far * min(abs(bearings[i] - bearing), 0.5)
                        if away * away >= best:
                            break
                        dx, dy = points[i, 0] - px, points[i, 1] - py
                        d = dx * dx + dy * dy
                        if d < best:
                            best, at = d, i
                        i += side
                if at < 0:
                    continue
                nx, ny = normals[at, 0], normals[at, 1]
                if nx == 0.0 and ny == 0.0:
                    continue  # the partner lies on no wall
                mx, my = normals[b, 0], normals[b, 1]
                if (mx != 0.0 or my != 0.0) and nx * (c * mx - s * my) + ny * (s * mx + c * my) < rules.facing:
                    continue  # the other side of a wall, or another wall
                # The distance from the partner's wall, its robust weight, and how it changes with the heading
                e = nx * (px - points[at, 0]) + ny * (py - points[at, 1])
                w = 1.0 / (1.0 + (e / width) ** 2) / (rules.noise * rules.noise)
                jt = -nx * oy + ny * ox
                partners += 1
                sum_distance += abs(e)
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
            _forget_open_direction(h, g, open_shares[references[k]])
            overlap[k] = partners / max(used, 1)
            distance[k] = sum_distance / max(partners, 1)
            information[k] = h
            if iteration == iterations or partners < rules.fewest_points:
                break
            held, pull = h.copy(), g.copy()  # information and gradient with the prior's
            pull[0] += prior[0] * (x - guesses[k, 0])
            pull[1] += prior[1] * (y - guesses[k, 1])
            pull[2] += prior[2] * (heading - guesses[k, 2])
            for axis in range(3):
                held[axis, axis] += prior[axis]
            step = np.linalg.solve(held, pull)
            x -= step[0]
            y -= step[1]
            heading -= step[2]
            settled = abs(step[0]) + abs(step[1]) < rules.settled_distance and abs(step[2]) < rules.settled_angle
            if settled and iteration >= len(gates) - 1:
                break
        poses[k, 0], poses[k, 1], poses[k, 2] = x, y, heading
    return poses, information, overlap, distance
