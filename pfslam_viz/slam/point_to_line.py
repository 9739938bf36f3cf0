"""Matching a scan with the walls in a map, point to line (Censi 2008): the hot loops.

Every cell of the map knows the mean of the end points in it and the direction of their wall, so a wall is known to
millimetres whatever the size of a cell, and a bare wall says nothing about the direction along it.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Walls = NDArray[np.float32]  # (rows, columns, 5): number of end points, their mean x, y (m), the wall's unit normal

COUNT, X, Y, NORMAL_X, NORMAL_Y = range(5)
ALIKE = 0.7  # least cosine between normals of one wall
SURE = 0.5  # least length of a cell's mean normal: 1 when all end points agreed on it
ITERATIONS = 15
FEW = 4  # while sigma is wide, one end point in so many is enough
WIDE = 4.0  # sigmas at the first iteration, halved at each


@njit(cache=True, nogil=True)
def add_walls(
    walls: Walls,
    occupied: NDArray[np.uint8],
    origin_row: int,
    origin_column: int,
    cell: float,
    pose: Floats,
    points: Floats,
    normals: Floats,
    memory: int,
) -> None:
    """Average a scan's end points (m, 2) and normals (m, 2), both in the robot's frame, into their cells, in place.

    An end point without a wall (normal zero) is left out. A cell that is not occupied forgets its wall. A wall seen
    from behind counts against the one that is there, which gives way when nothing is left of it. The mean is over
    ``memory`` end points, older ones fade.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for b in range(len(points)):
        nx, ny = c * normals[b, 0] - s * normals[b, 1], s * normals[b, 0] + c * normals[b, 1]
        if nx == 0.0 and ny == 0.0:
            continue
        x = pose[0] + c * points[b, 0] - s * points[b, 1]
        y = pose[1] + s * points[b, 0] + c * points[b, 1]
        row, column = math.floor(-y / cell) + origin_row, math.floor(x / cell) + origin_column
        wall = walls[row, column]
        if occupied[row, column] == 0:
            wall[COUNT] = 0.0
            continue
        if wall[COUNT] > 0.0 and wall[NORMAL_X] * nx + wall[NORMAL_Y] * ny < 0.0:
            wall[COUNT] -= 1.0
            continue
        wall[COUNT] = min(wall[COUNT] + 1.0, memory)
        gain = 1.0 / wall[COUNT]
        wall[X] += gain * (x - wall[X])
        wall[Y] += gain * (y - wall[Y])
        wall[NORMAL_X] += gain * (nx - wall[NORMAL_X])
        wall[NORMAL_Y] += gain * (ny - wall[NORMAL_Y])


@njit(cache=True, nogil=True)
def find_walls(
    walls: Walls,
    occupied: NDArray[np.uint8],
    origin_row: int,
    origin_column: int,
    cell: float,
    pose: Floats,
    points: Floats,
    normals: Floats,
    search: int,
    partners: Floats,
) -> int:
    """The nearest wall of like direction for every end point seen from ``pose``; how many found one.

    Looks at rings of cells round the end point's own, up to ``search`` cells away, and stops one ring after the first
    find. ``partners`` (m, 5) receives x, y, the unit normal and 1, or 0 where there is none.
    """
    rows, columns = occupied.shape
    c, s = math.cos(pose[2]), math.sin(pose[2])
    found = 0
    for b in range(len(points)):
        partners[b, 4] = 0.0
        x = pose[0] + c * points[b, 0] - s * points[b, 1]
        y = pose[1] + s * points[b, 0] + c * points[b, 1]
        nx, ny = c * normals[b, 0] - s * normals[b, 1], s * normals[b, 0] + c * normals[b, 1]
        row, column = math.floor(-y / cell) + origin_row, math.floor(x / cell) + origin_column
        least, last = 1e18, search
        ring = 0
        while ring <= last:
            for i in range(max(row - ring, 0), min(row + ring + 1, rows)):
                step = 1 if ring == 0 or i == row - ring or i == row + ring else 2 * ring
                for j in range(column - ring, column + ring + 1, step):
                    if j < 0 or j >= columns or occupied[i, j] == 0:
                        continue
                    wall = walls[i, j]
                    length = math.sqrt(wall[NORMAL_X] * wall[NORMAL_X] + wall[NORMAL_Y] * wall[NORMAL_Y])
                    if wall[COUNT] == 0.0 or length < SURE:
                        continue
                    if wall[NORMAL_X] * nx + wall[NORMAL_Y] * ny < ALIKE * length:
                        continue
                    square = (wall[X] - x) ** 2 + (wall[Y] - y) ** 2
                    if square < least:
                        if least == 1e18:
                            last = min(ring + 1, search)
                        least = square
                        partners[b, 0], partners[b, 1] = wall[X], wall[Y]
                        partners[b, 2], partners[b, 3] = wall[NORMAL_X] / length, wall[NORMAL_Y] / length
                        partners[b, 4] = 1.0
            ring += 1
        found += int(partners[b, 4])
    return found


@njit(cache=True, nogil=True)
def normal_equations(
    pose: Floats, points: Floats, partners: Floats, sigma: float, information: Floats, gradient: Floats
) -> float:
    """One Gauss-Newton step's matrix (3, 3) and gradient (3,), per m and rad, of the distances to the partners' lines.

    Distances count with Geman and McClure's weight 1 / (1 + (d / 2 sigma)²)², so that what is not in the map does not
    pull. Returns the sum of the weights.
    """
    information[:], gradient[:] = 0.0, 0.0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for b in range(len(points)):
        if partners[b, 4] == 0.0:
            continue
        rx, ry = c * points[b, 0] - s * points[b, 1], s * points[b, 0] + c * points[b, 1]
        nx, ny = partners[b, 2], partners[b, 3]
        distance = nx * (pose[0] + rx - partners[b, 0]) + ny * (pose[1] + ry - partners[b, 1])
        turn = ny * rx - nx * ry  # how the distance changes with the heading
        weight = 1.0 / (1.0 + (distance / (2.0 * sigma)) ** 2) ** 2
        total += weight
        information[0, 0] += weight * nx * nx
        information[0, 1] += weight * nx * ny
        information[0, 2] += weight * nx * turn
        information[1, 1] += weight * ny * ny
        information[1, 2] += weight * ny * turn
        information[2, 2] += weight * turn * turn
        gradient[0] += weight * nx * distance
        gradient[1] += weight * ny * distance
        gradient[2] += weight * turn * distance
    for i in range(3):
        gradient[i] /= sigma * sigma
        for j in range(i, 3):
            information[i, j] /= sigma * sigma
            information[j, i] = information[i, j]
    return total


@njit(cache=True, nogil=True)
def solve(a: Floats, b: Floats) -> Floats:
    """x (3,) with a x = b, for a symmetric positive definite ``a`` (3, 3)."""
    l00 = math.sqrt(a[0, 0])
    l10, l20 = a[1, 0] / l00, a[2, 0] / l00
    l11 = math.sqrt(a[1, 1] - l10 * l10)
    l21 = (a[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(a[2, 2] - l20 * l20 - l21 * l21)
    y0 = b[0] / l00
    y1 = (b[1] - l10 * y0) / l11
    y2 = (b[2] - l20 * y0 - l21 * y1) / l22
    out = np.empty(3)
    out[2] = y2 / l22
    out[1] = (y1 - l21 * out[2]) / l11
    out[0] = (y0 - l10 * out[1] - l20 * out[2]) / l00
    return out


@njit(cache=True, nogil=True)
def match(
    walls: Walls,
    occupied: NDArray[np.uint8],
    origin_row: int,
    origin_column: int,
    cell: float,
    guess: Floats,
    prior: Floats,
    start: Floats,
    points: Floats,
    normals: Floats,
    search: int,
    sigma: float,
    temper: float,
    partners: Floats,
) -> tuple[Floats, Floats, float]:
    """The pose (3,) at which the tempered likelihood of the scan times the prior is greatest, by Gauss-Newton.

    ``prior`` (3, 3) is the information about ``guess`` (3,), world frame. Returns the pose, the scan's information
    (3, 3) there, tempered, and the mean weight of the end points in [0, 1]; ``partners`` (m, 5) keeps the last pairs.
    """
    pose = start.copy()
    information, gradient = np.zeros((3, 3)), np.zeros(3)
    few_points, few_normals, few_partners = points[::FEW].copy(), normals[::FEW].copy(), partners[::FEW].copy()
    total = 0.0
    for iteration in range(ITERATIONS):
        width = max(WIDE * 0.5**iteration, 1.0) * sigma
        if width > sigma:
            find_walls(
                walls, occupied, origin_row, origin_column, cell, pose, few_points, few_normals, search, few_partners
            )
            normal_equations(pose, few_points, few_partners, width, information, gradient)
            information *= FEW
            gradient *= FEW
        else:
            find_walls(walls, occupied, origin_row, origin_column, cell, pose, points, normals, search, partners)
            total = normal_equations(pose, points, partners, sigma, information, gradient)
        away = pose - guess
        for i in range(3):
            gradient[i] *= temper
            for j in range(3):
                information[i, j] *= temper
                gradient[i] += prior[i, j] * away[j]
        step = solve(information + prior, -gradient)
        pose += step
        if width == sigma and abs(step[0]) + abs(step[1]) < 1e-4 and abs(step[2]) < 1e-5:
            break
    return pose, information, total / max(len(points), 1)


@njit(cache=True, nogil=True)
def log_likelihoods(poses: Floats, points: Floats, partners: Floats, sigma: float) -> Floats:
    """Log-likelihood (N,) of the scan from each of the poses (N, 3), up to a constant, with the pairs as they are.

    The sum over end points of Geman and McClure's -2 d² / (4 sigma² + d²), which is -(d / sigma)² / 2 near the wall and
    levels out at -2, which is also what an end point without a partner counts.
    """
    out = np.zeros(len(poses))
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        total = 0.0
        for b in range(len(points)):
            x = poses[k, 0] + c * points[b, 0] - s * points[b, 1] - partners[b, 0]
            y = poses[k, 1] + s * points[b, 0] + c * points[b, 1] - partners[b, 1]
            square = (partners[b, 2] * x + partners[b, 3] * y) ** 2
            total += square / (4.0 * sigma * sigma + square) if partners[b, 4] > 0.0 else 1.0
        out[k] = -2.0 * total
    return out
