"""Loops that the particles did not close: places come back to, found by searching wide, and believed reluctantly.

After a long way round, the robot may be metres from where its trajectory says. For key scans that should see an earlier
place but do not match it, the scans around them are laid over a map of that place at every offset within reach (the
correlative search of Olson 2009). A fit counts if it is good, if no other offset is nearly as good (a bare corridor
fits anywhere), if matching scan against scan confirms it, and if the next key scans find the same correction. Whether
it is kept is decided by what closing it does to all other matches: see :mod:`pfslam_viz.slam.smoothing`.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import LoopClosingConfig
from pfslam_viz.slam.pose_graph import Constraints, turned
from pfslam_viz.slam.scan_matching import Matches, ScanStore

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Field = NDArray[np.float32]

CELL = 0.1  # m of the map that is searched
BLUR = 0.12  # m: how far from a wall an end point still counts
TURN_STEP = 0.03  # rad
VIEW = 12.0  # m round a place that its map covers
WELL = 0.8  # agreement from which two views need not be searched: they fit as they lie
EVERY = 5  # key scans from one that is looked at to the next
AROUND = 12  # key scans before and after that are put together to one view
POINTS = 300  # end points of a view that are laid over the map, about
CONFIRM = np.array([0.5, 0.3, 0.2, 0.1])  # m: gates of the scan match that confirms
GUESS = np.array([0.3, 0.3, 0.1]) ** -2.0
KIN = 40  # key scans within which another closure can confirm one


@dataclass(frozen=True, slots=True)
class Candidates:
    """Pairs of key scans (c,) that may show the same place, and how far apart (c,) m they may have drifted."""

    earlier: Indices
    later: Indices
    reach: Array


def find_loops(scans: ScanStore, poses: Array, config: LoopClosingConfig) -> list[Constraints]:
    """Constraints between key scans that show the same place though ``poses`` (k, 3) do not say so, loop by loop."""
    candidates = find_candidates(poses, config)
    found = _search_all(scans, poses, candidates, config)
    if not found:
        return []
    start, end = np.array([c[0] for c in found]), np.array([c[1] for c in found])
    guesses = np.array([c[2] for c in found])
    matched = scans.match(start, end, guesses, GUESS, CONFIRM, stride=2)
    good = _confirmed(matched, guesses, config)
    good &= _agreed(poses, start, end, matched.poses, good)
    information = config.temper * turned(matched.information, matched.poses[:, 2])
    robust = np.zeros(int(good.sum()), np.bool_)
    closures = Constraints(start[good], end[good], matched.poses[good], information[good], robust)
    breaks = np.flatnonzero(np.diff(closures.end) > KIN) + 1
    return [closures.pick(part) for part in np.split(np.arange(len(closures)), breaks) if len(part)]


def find_candidates(poses: Array, config: LoopClosingConfig) -> Candidates:
    """Key scans, each with the nearest earlier one that drift since then may have carried away from it."""
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    earlier, later, reaches = [], [], []
    for k in range(0, len(poses), EVERY):
        between = path[k] - path
        reach = np.clip(config.least_reach + config.drift * between, 0.0, config.most_reach)
        away = np.hypot(*(poses[:, :2] - poses[k, :2]).T)
        away[(between < config.least_loop) | (away > reach)] = np.inf
        away[k:] = np.inf
        nearest = int(np.argmin(away))
        if np.isfinite(away[nearest]):
            earlier.append(nearest)
            later.append(k)
            reaches.append(reach[nearest])
    return Candidates(np.array(earlier, np.int64), np.array(later, np.int64), np.array(reaches))


def _search_all(
    scans: ScanStore, poses: Array, candidates: Candidates, config: LoopClosingConfig
) -> list[tuple[int, int, Array]]:
    """The candidates that fit somewhere else than where they are: earlier, later, and the increment between them."""
    views: dict[int, Array] = {}

    def view_of(key: int) -> Array:
        if key not in views:
            views[key] = view(scans, poses, key)
        return views[key]

    def search(part: slice) -> list[tuple[int, int, Array]]:
        found = []
        pairs = zip(candidates.earlier[part], candidates.later[part], candidates.reach[part], strict=True)
        for earlier, later, reach in pairs:
            pivot = geometry.between(poses[earlier], poses[later])
            better = _search(view_of(int(earlier)), view_of(int(later)), pivot, float(reach), config)
            if better is not None:
                found.append((int(earlier), int(later), better))
        return found

    parts = scans.worker.split(search, len(candidates.later), worth=8, pieces=8)
    return [loop for part in parts for loop in part]


def _search(there: Array, seen: Array, pivot: Array, reach: float, config: LoopClosingConfig) -> Array | None:
    """Where the view ``seen`` (m, 2) fits on the view ``there`` (n, 2) better than at ``pivot`` (3,), and nowhere else.

    The increment (3,) is within ``reach`` m of the pivot; None where there is no such place.
    """
    centre = pivot[:2]
    points = (geometry.transform(pivot, seen[:: max(1, len(seen) // POINTS)]) - centre) / CELL
    field, corner = blurred(there, centre, reach + VIEW)
    at = (centre - corner) / CELL
    here = float(overlay(field, at, points, np.zeros(1), 2).max())
    if here > WELL:
        return None
    steps = math.ceil(reach / CELL)
    turns = np.arange(-config.most_turn, config.most_turn + TURN_STEP / 2, TURN_STEP)
    scores = overlay(field, at, points, turns, steps)
    best = np.unravel_index(int(np.argmax(scores)), scores.shape)
    score = float(scores[best])
    if score < config.score or here > config.rival * score:
        return None  # it fits nowhere, or as well where it is
    rivals = scores.max(axis=0)
    rows, columns = np.ogrid[: rivals.shape[0], : rivals.shape[1]]
    rivals[(rows - best[1]) ** 2 + (columns - best[2]) ** 2 <= (config.rival_distance / CELL) ** 2] = 0.0
    if rivals.max() > config.rival * score:
        return None
    shift = np.array([(best[2] - steps) * CELL, (best[1] - steps) * CELL])
    return np.array([*(pivot[:2] + shift), pivot[2] + float(turns[best[0]])])


def view(scans: ScanStore, poses: Array, key: int) -> Array:
    """End points (m, 2) of the key scans around ``key``, in its frame."""
    near = range(max(0, key - AROUND), min(len(poses), key + AROUND + 1), 3)
    return np.concatenate(
        [geometry.transform(geometry.between(poses[key], poses[k]), scans.points_of(k)) for k in near]
    )


def blurred(points: Array, centre: Array, half: float) -> tuple[Field, Array]:
    """A square map (n, n), rows along y, 2 ``half`` m wide round ``centre``: 1 on walls, falling to 0; its corner."""
    import cv2

    n = math.ceil(2.0 * half / CELL)
    corner = centre - half
    cells = np.floor((points - corner) / CELL).astype(np.int64)
    inside = ((cells >= 0) & (cells < n)).all(axis=1)
    free = np.ones((n, n), np.uint8)
    free[cells[inside, 1], cells[inside, 0]] = 0
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 3) * CELL
    return np.exp(-(distance**2) / (2.0 * BLUR**2)).astype(np.float32), corner


@njit(cache=True, nogil=True)
def overlay(field: Field, centre: Array, points: Array, turns: Array, steps: int) -> Field:
    """Mean of the field under ``points`` (m, 2), turned about ``centre`` and moved by up to +-``steps`` cells.

    All in cells. Returns (turns, 2 steps + 1, 2 steps + 1): rows are shifts along y, columns along x.
    """
    n = field.shape[0]
    width = 2 * steps + 1
    out = np.zeros((len(turns), width, width), np.float32)
    for t in range(len(turns)):
        c, s = math.cos(turns[t]), math.sin(turns[t])
        for b in range(len(points)):
            column = math.floor(centre[0] + c * points[b, 0] - s * points[b, 1]) - steps
            row = math.floor(centre[1] + s * points[b, 0] + c * points[b, 1]) - steps
            if row < 0 or column < 0 or row + width > n or column + width > n:
                continue  # it leaves the map somewhere: nothing is known of it there
            for i in range(width):
                for j in range(width):
                    out[t, i, j] += field[row + i, column + j]
    out /= np.float32(len(points))
    return out


def _confirmed(matched: Matches, guesses: Array, config: LoopClosingConfig) -> NDArray[np.bool_]:
    moved = geometry.between(guesses, matched.poses)
    return (
        (matched.overlap > config.overlap)
        & (matched.distance < config.distance)
        & (np.hypot(moved[:, 0], moved[:, 1]) < 0.5)
        & (np.abs(moved[:, 2]) < 0.15)
    )


def _agreed(poses: Array, start: Indices, end: Indices, measured: Array, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which closures another good one nearby confirms: it would move its key scan by nearly the same."""
    to = geometry.compose(poses[start], measured)
    kin = (np.abs(end[:, None] - end[None]) < KIN) & good[None] & good[:, None] & ~np.eye(len(end), dtype=bool)
    # What the one closure does to its own key scan, done to the other's, must put that where the other closure does.
    correction = geometry.compose(to, geometry.between(poses[end], np.zeros(3)))
    predicted = geometry.compose(correction[:, None], poses[end][None])
    missed = geometry.between(predicted, np.broadcast_to(to[None], predicted.shape))
    same = (np.hypot(missed[..., 0], missed[..., 1]) < 0.3) & (np.abs(missed[..., 2]) < 0.1)
    return (kin & same).any(axis=1)
