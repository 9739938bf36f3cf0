"""Revisit error: where the robot came back to, do the two scans agree on where it is?

For pairs of scans that an estimate puts within 1 m of each other, with 150° of view in common, and with more than 30 s
and 5 m of driving between them, the later scan is matched against the earlier one anew: an exhaustive search of ±1 m
and ±12° around the estimate, then point-to-line ICP. The revisit's error is how far the match moves the later pose.
Matching one scan to another is good to a few millimetres to a centimetre: that is the floor of what this measures.

Where the earlier scan leaves a direction open (a bare corridor's axis), movement along it counts as none. Revisits that
an estimate puts further apart than 1 m are not seen; a wrong estimate may so hide behind a small count.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.evaluation.scans import end_points, key_scans
from pfslam_viz.recordings.recording import Recording

Array = NDArray[np.float64]

NEAR = 1.0  # m
SHARED_VIEW = np.radians(150.0)
LATER = 30.0  # s
DRIVEN = 5.0  # m
MOST = 50  # revisits that are matched
BEAMS = 180  # a scan is thinned to this many
CELL = 0.05  # m, of the field that is searched
REACH = 12.0  # m, half the edge of that field
SIGMA = 0.1  # m, in the search's score
RELUCTANCE = 0.05  # score that a move by NEAR or a turn by 0.5 rad has to gain: an ambiguous scan stays where it is
FEWEST = 30  # points on either side
AGREEING = 0.6  # share of points that must lie within INLIER of the earlier scan after matching
INLIER = 0.1  # m
OPEN = 0.03  # share of the wall normals' power below which a direction is open


@dataclass(frozen=True, slots=True)
class RevisitError:
    """Medians over ``count`` revisits: m and deg."""

    translation: float
    rotation: float
    count: int


def revisit_error(recording: Recording, poses: Array) -> RevisitError | None:
    """Disagreement at revisits of ``poses`` (n, 3) of the recording's first n scans; None where there are none."""
    pairs = revisits(recording, poses)
    moves = [move for i, j in pairs if (move := _rematch(recording, int(i), int(j), poses)) is not None]
    if not moves:
        return None
    table = np.array(moves)
    translation = np.hypot(table[:, 0], table[:, 1])
    return RevisitError(float(np.median(translation)), float(np.degrees(np.median(np.abs(table[:, 2])))), len(moves))


def revisits(recording: Recording, poses: Array) -> NDArray[np.intp]:
    """Pairs (k, 2) of scan indices, earlier and later, k at most 50, evenly picked from all of the drive's."""
    from scipy.spatial import cKDTree

    scans = key_scans(recording, 0.5, 0.7)
    scans = scans[scans < len(poses)]
    p, t = poses[scans], recording.stamps[scans]
    driven = np.cumsum(np.hypot(recording.odometry[:, 0], recording.odometry[:, 1]))[scans]
    close = cKDTree(p[:, :2]).query_pairs(NEAR, output_type="ndarray")
    if len(close) == 0:
        return np.zeros((0, 2), dtype=np.intp)
    i, j = close.min(axis=1), close.max(axis=1)
    kept = (t[j] - t[i] > LATER) & (driven[j] - driven[i] > DRIVEN)
    kept &= shared_view(recording, np.abs(geometry.wrap(p[j, 2] - p[i, 2]))) >= SHARED_VIEW
    i, j = i[kept], j[kept]
    # One partner for each later scan: the nearest.
    order = np.lexsort((np.hypot(*(p[j, :2] - p[i, :2]).T), j))
    i, j = i[order], j[order]
    first = np.flatnonzero(np.diff(j, prepend=-1) > 0)
    if len(first) > MOST:
        first = first[np.linspace(0, len(first) - 1, MOST).round().astype(np.intp)]
    return np.stack([scans[i[first]], scans[j[first]]], axis=-1)


def shared_view(recording: Recording, turned: Array) -> Array:
    """Angle in rad that two scans from one place see in common, if the robot has turned by (k,) rad in [0, pi]."""
    view = float(np.ptp(recording.lidar.angles))
    return np.maximum(view - turned, 0) + np.maximum(view - (2 * np.pi - turned), 0)


def _rematch(recording: Recording, earlier: int, later: int, poses: Array) -> Array | None:
    """The move (3,) of the later pose, in the frame of the earlier, that matching asks for; None if none fits."""
    target = end_points(recording, np.array([earlier]), None).points
    source = end_points(recording, np.array([later]), BEAMS).points
    start = geometry.between(poses[earlier], poses[later])
    target = target[np.abs(target).max(axis=1, initial=0) < REACH]
    source = source[np.abs(source).max(axis=1, initial=0) < REACH]
    # Only what the earlier scan looked towards can agree with it.
    seen = geometry.transform(geometry.inverse(recording.lidar.pose), geometry.transform(start, source))
    angle, (low, high) = np.arctan2(seen[:, 1], seen[:, 0]), np.percentile(recording.lidar.angles, [0, 100])
    source = source[(angle - low) % (2 * np.pi) <= high - low]
    if min(len(target), len(source)) < FEWEST:
        return None
    return match(target, source, start)


def match(target: Array, source: Array, start: Array) -> Array | None:
    """How ``start`` (3,), the pose of ``source`` (m, 2) in the frame of ``target`` (n, 2), has to move to fit (3,).

    None if the two do not show the same place, or not enough of it.
    """
    found = _refine(target, source, _search(target, source, start))
    if found is None:
        return None
    pose, normals = found
    move = pose - start
    move[2] = geometry.wrap(move[2])
    power, directions = np.linalg.eigh(normals.T @ normals / len(normals))
    if power[0] < OPEN:
        move[:2] -= directions[:, 0] * (directions[:, 0] @ move[:2])
    return move


def _search(target: Array, source: Array, start: Array) -> Array:
    """The pose (3,) near ``start`` with the best score on a grid of 0.1 m and 2 degrees."""
    import cv2

    n = int(2 * REACH / CELL)
    image = np.ones((n, n), np.uint8)
    x, y = np.floor((target + REACH) / CELL).astype(np.intp).T
    image[y, x] = 0
    distance = cv2.distanceTransform(image, cv2.DIST_L2, cv2.DIST_MASK_5) * CELL
    field = np.exp(-0.5 * (distance / SIGMA) ** 2)
    shift = np.linspace(-NEAR, NEAR, 21)
    dx, dy = (d.ravel() for d in np.meshgrid(shift, shift))
    best, best_score = start, -np.inf
    for turn in np.radians(np.linspace(-12, 12, 13)):
        rotated = geometry.transform(start + np.array([0, 0, turn]), source)
        column = np.floor((rotated[:, 0] + dx[:, None] + REACH) / CELL).astype(np.intp)
        row = np.floor((rotated[:, 1] + dy[:, None] + REACH) / CELL).astype(np.intp)
        inside = (column >= 0) & (row >= 0) & (column < n) & (row < n)
        score = np.where(inside, field[np.clip(row, 0, n - 1), np.clip(column, 0, n - 1)], 0).mean(axis=1)
        score -= RELUCTANCE * ((dx**2 + dy**2) / NEAR**2 + (turn / 0.5) ** 2)
        k = int(score.argmax())
        if score[k] > best_score:
            best, best_score = start + np.array([dx[k], dy[k], turn]), float(score[k])
    return best


def _refine(target: Array, source: Array, pose: Array) -> tuple[Array, Array] | None:
    """Point-to-line ICP from ``pose`` (3,): the pose, and the normals (m, 2) that hold it. None if they disagree."""
    from scipy.spatial import cKDTree

    tree = cKDTree(target)
    normals, on_a_line = _normals(target, tree)
    pose = pose.copy()
    for reach in (0.3, 0.3, 0.3, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1):
        points = geometry.transform(pose, source)
        distance, index = tree.query(points, distance_upper_bound=reach)
        used = np.isfinite(distance)
        used[used] &= on_a_line[index[used]]
        if used.sum() < FEWEST / 2:
            return None
        n, at = normals[index[used]], points[used]
        residual = ((target[index[used]] - at) * n).sum(axis=1)
        lever = (at[:, 0] - pose[0]) * n[:, 1] - (at[:, 1] - pose[1]) * n[:, 0]
        jacobian = np.column_stack([n, lever])
        information = jacobian.T @ jacobian
        # A little stiffness keeps what the walls leave open where it was.
        step = np.linalg.solve(information + 0.01 * len(n) * np.eye(3), jacobian.T @ residual)
        pose += step
    distance, _ = tree.query(geometry.transform(pose, source), distance_upper_bound=INLIER)
    if np.isfinite(distance).mean() < AGREEING:
        return None
    return pose, n


def _normals(points: Array, tree: Any) -> tuple[Array, NDArray[np.bool_]]:
    """Unit normals (n, 2) of the lines through each point's neighbours, and whether they do lie on a line (n,)."""
    k = min(7, len(points))
    distance, index = tree.query(points, k=k)
    offset = points[index] - points[index].mean(axis=1, keepdims=True)
    spread = np.einsum("nki,nkj->nij", offset, offset) / k
    values, vectors = np.linalg.eigh(spread)
    return vectors[:, :, 0], (values[:, 0] < 0.1 * values[:, 1]) & (distance[:, -1] < 0.5)
