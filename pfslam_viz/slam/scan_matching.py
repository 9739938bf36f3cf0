"""Scan against scan: point-to-line ICP (Censi 2008) with correspondences looked up by bearing.

Scans keep the order of their beams, so the neighbours of a bearing are neighbours in the array, and a match costs a few
look-ups a point instead of a search.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz.slam.worker import Worker

Array = NDArray[np.float64]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Indices = NDArray[np.int64]

MOST = 400  # end points of a scan that are kept
WALL_REACH = 0.3  # m: neighbours that tell a wall's direction
OPEN = 0.03  # a direction is open where the walls' normals lean into it by less than about 10 degrees
NOISE = 0.02  # m: how far an end point may lie off its wall before it loses its say


class ScanStore:
    """Key scans, one after the other: end points with the normals of the walls they lie on, in the robot's frame.

    Attributes:
        sensor: (2,) the lidar in the robot's frame.
        points, normals, bearings: (p, 2) m, (p, 2), (p,) rad; a normal is zero where no wall fits, bearings are seen
            from the lidar and increase within a scan.
        first: scan k owns rows ``first[k]`` to ``first[k + 1]``.
        worker: who does a part of the matching.
    """

    def __init__(self, sensor: Array, worker: Worker | None = None) -> None:
        """An empty store; a ``worker`` does its part of the matching."""
        self.sensor = sensor
        self.worker = worker or Worker(threads=1)
        self._rows = np.zeros((1024, 5), np.float32)
        self._first = np.zeros(64, np.int64)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def points(self) -> Singles:
        """(p, 2) m."""
        return self._rows[:, 0:2]

    @property
    def normals(self) -> Singles:
        """(p, 2) unit vectors or zero."""
        return self._rows[:, 2:4]

    @property
    def bearings(self) -> Singles:
        """(p,) rad."""
        return self._rows[:, 4]

    @property
    def first(self) -> NDArray[np.int64]:
        """(scans + 1,) row of each scan's first point, and one past the last."""
        return self._first[: self._count + 1]

    def points_of(self, scan: int) -> Array:
        """(m, 2) end points of one scan."""
        return self.points[self._first[scan] : self._first[scan + 1]].astype(np.float64)

    def add(self, points: Array) -> None:
        """Append a scan's end points (m, 2), in the order of the beams; at most MOST of them, evenly, are kept."""
        points = points[:: 1 + max(len(points) - 1, 0) // MOST]
        start = int(self._first[self._count])
        end = start + len(points)
        while end > len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        if self._count + 2 > len(self._first):
            self._first = np.concatenate([self._first, np.zeros_like(self._first)])
        describe(points, self.sensor, WALL_REACH, self._rows[start:end])
        self._count += 1
        self._first[self._count] = end

    def size_of(self, scan: int) -> int:
        """How many end points one scan has."""
        return int(self._first[scan + 1] - self._first[scan])

    def drop_last(self) -> None:
        """Forget the scan added last."""
        self._count -= 1

    def match(
        self,
        references: NDArray[np.int64],
        others: NDArray[np.int64],
        guesses: Array,
        prior: Array,
        gates: Array,
        *,
        stride: int = 1,
        iterations: int = 15,
    ) -> "Matches":
        """Match scans ``others`` (k,) against ``references`` (k,); see :func:`match_pairs`."""

        def part(k: slice) -> tuple[Array, Array, Array, Array]:
            return match_pairs(
                self.points,
                self.normals,
                self.bearings,
                self.first,
                self.sensor,
                references[k],
                others[k],
                guesses[k],
                gates,
                iterations,
                stride,
                NOISE,
                prior,
            )

        found = self.worker.split(part, len(references), worth=100)
        return Matches(*(np.concatenate(values) for values in zip(*found, strict=True)))


@dataclass(frozen=True, slots=True)
class Matches:
    """k scan matches: ``poses`` (k, 3) of the matched scan in the reference's frame, the ``information`` (k, 3, 3)
    that the scans alone give on them (1/m², 1/m rad, 1/rad²), the share of points that found a partner (k,) and
    their mean distance from the partner's wall (k,) m."""

    poses: Array
    information: Array
    overlap: Array
    distance: Array


def open_direction(information: Array) -> Array | None:
    """The unit direction (2,) of which a match's information (3, 3) has nothing, while it has of the other; or None."""
    values, vectors = np.linalg.eigh(information[:2, :2])
    return vectors[:, 0] if values[1] > 0.0 and values[0] < 1e-6 * values[1] else None


@njit(cache=True, nogil=True)
def within(points: Floats, center: Floats, distance: float) -> Floats:
    """Those of the points (m, 2) that lie at most ``distance`` from ``center`` (2,), (k, 2)."""
    out = np.empty_like(points)
    k = 0
    for b in range(len(points)):
        if (points[b, 0] - center[0]) ** 2 + (points[b, 1] - center[1]) ** 2 <= distance**2:
            out[k] = points[b]
            k += 1
    return out[:k]


@njit(cache=True, nogil=True)
def wall_normals(points: Floats, sensor: Floats, reach: float) -> Floats:
    """Unit normals (m, 2), towards the lidar, of the wall through each end point and its neighbours in ``reach`` m.

    Zero where fewer than two neighbours lie there, or where they do not form a line.
    """
    m = len(points)
    out = np.zeros((m, 2))
    for b in range(m):
        n = 1
        sx, sy = points[b, 0], points[b, 1]
        sxx, sxy, syy = sx * sx, sx * sy, sy * sy
        for side in (-1, 1):
            k = b + side
            reached = 0
            while 0 <= k < m and reached < 20:
                dx, dy = points[k, 0] - points[b, 0], points[k, 1] - points[b, 1]
                if dx * dx + dy * dy > reach * reach:
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
def describe(points: Floats, sensor: Floats, reach: float, rows: Singles) -> None:
    """Fill a scan's ``rows`` (m, 5): its end points, their :func:`wall_normals`, and their bearings from the lidar.

    Bearings are those of successive beams, in [-pi, pi] at first and continued beyond pi; beams may lie more than pi
    apart.
    """
    rows[:, :2] = points
    rows[:, 2:4] = wall_normals(points, sensor, reach)
    turns, last = 0.0, 0.0
    for b in range(len(points)):
        bearing = math.atan2(points[b, 1] - sensor[1], points[b, 0] - sensor[0])
        if b > 0 and bearing - last < -0.1:
            turns += 2.0 * math.pi
        last = bearing
        rows[b, 4] = bearing + turns


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
def _forget_open_direction(h: Floats, g: Floats) -> None:
    """Take what a bare corridor seems to say about its own axis out of the information ``h`` and the gradient ``g``.

    The walls' roughness and the noise of their normals say a little in every direction; where that is all there is,
    it must not outvote the odometry (Zhang, Kaess & Singh 2016).
    """
    if h[2, 2] <= 0.0:
        return
    a = h[0, 0] - h[0, 2] * h[0, 2] / h[2, 2]
    b = h[0, 1] - h[0, 2] * h[1, 2] / h[2, 2]
    d = h[1, 1] - h[1, 2] * h[1, 2] / h[2, 2]
    half, root = 0.5 * (a + d), math.sqrt(0.25 * (a - d) ** 2 + b * b)
    if half - root > OPEN * (half + root):
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
        ahead = 0.5 * (bearings[r0] + bearings[r1 - 1])
        for iteration in range(iterations + 1):
            gate = gates[min(iteration, len(gates) - 1)]
            width = max(2.0 * sigma, gate / 3.0)  # beyond it a residual loses its say
            c, s = math.cos(heading), math.sin(heading)
            h[:, :] = 0.0
            g[:] = 0.0
            partners, used, sum_distance, middle = 0, 0, 0.0, r0
            for b in range(q0, q1, stride):
                used += 1
                ox, oy = c * points[b, 0] - s * points[b, 1], s * points[b, 0] + c * points[b, 1]
                px, py = x + ox, y + oy
                lx, ly = px - sensor[0], py - sensor[1]
                far = math.sqrt(lx * lx + ly * ly)
                bearing = math.atan2(ly, lx)
                bearing -= 2.0 * math.pi * math.floor((bearing - ahead) / (2.0 * math.pi) + 0.5)
                best, at = gate * gate, -1
                middle = _first_from(bearings, r0, r1, bearing, middle)
                for side in (-1, 1):  # outwards, as long as a point at that bearing can still be nearer
                    i = middle if side > 0 else middle - 1
                    while r0 <= i < r1:
                        away = 0.95 * far * min(abs(bearings[i] - bearing), 0.5)
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
                    continue
                mx, my = normals[b, 0], normals[b, 1]
                if (mx != 0.0 or my != 0.0) and nx * (c * mx - s * my) + ny * (s * mx + c * my) < 0.7:
                    continue  # the other side of a wall, or another wall
                e = nx * (px - points[at, 0]) + ny * (py - points[at, 1])
                partners += 1
                sum_distance += abs(e)
                w = 1.0 / (1.0 + (e / width) ** 2) / (sigma * sigma)
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
            _forget_open_direction(h, g)
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
            settled = abs(step[0]) + abs(step[1]) < 5e-4 and abs(step[2]) < 3e-4
            if settled and iteration >= len(gates) - 1:
                break
        poses[k, 0], poses[k, 1], poses[k, 2] = x, y, heading
    return poses, information, overlap, distance
