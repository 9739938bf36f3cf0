"""Loops that the particles did not close: places come back to, found by searching wide, and believed reluctantly.

After a long way round, the robot may be metres from where its trajectory says. For key scans that should see an earlier
place but do not match it, the scans around them are laid over a map of that place at every offset within reach (the
correlative search of Olson 2009). A fit counts if it is good, if no other offset is nearly as good (a bare corridor
fits anywhere), if matching scan against scan confirms it, and if the next key scans find the same correction. Whether
it is kept is decided by what closing it does to all other matches: see :mod:`pfslam_viz.slam.graph.smoothing`.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.pose_graph import Constraints, turned
from pfslam_viz.slam.graph.scan_store import ScanStore, trusted
from pfslam_viz.slam.graph.settings import LoopClosingConfig

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Field = NDArray[np.float32]


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
    prior = np.array([config.guess_distance, config.guess_distance, config.guess_angle]) ** -2.0
    gates = np.array(config.gates)
    matched = scans.match(
        start, end, guesses, prior, gates, stride=config.match_stride, iterations=config.match_iterations
    )
    good = trusted(matched, guesses, config)
    good &= _agreed(poses, start, end, matched.poses, good, config)
    information = config.temper * turned(matched.information, matched.poses[:, 2])
    robust = np.zeros(int(good.sum()), np.bool_)
    closures = Constraints(start[good], end[good], matched.poses[good], information[good], robust)
    breaks = np.flatnonzero(np.diff(closures.end) > config.confirm_within) + 1
    return [closures.pick(part) for part in np.split(np.arange(len(closures)), breaks) if len(part)]


def find_candidates(poses: Array, config: LoopClosingConfig) -> Candidates:
    """Key scans, each with the nearest earlier one that drift since then may have carried away from it."""
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    earlier, later, reaches = [], [], []
    for k in range(0, len(poses), config.every):
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
            views[key] = view(scans, poses, key, config)
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
    centre, cell = pivot[:2], config.cell
    points = (geometry.transform(pivot, seen[:: max(1, len(seen) // config.points)]) - centre) / cell
    field, corner = blurred(there, centre, reach + config.view, cell, config.blur)
    at = (centre - corner) / cell
    here = float(overlay(field, at, points, np.zeros(1), 2).max())
    if here > config.fits_already:
        return None
    steps = math.ceil(reach / cell)
    turns = np.arange(-config.most_turn, config.most_turn + config.turn_step / 2, config.turn_step)
    scores = overlay(field, at, points, turns, steps)
    best = np.unravel_index(int(np.argmax(scores)), scores.shape)
    score = float(scores[best])
    if score < config.score or here > config.rival * score:
        return None  # it fits nowhere, or as well where it is
    rivals = scores.max(axis=0)
    rows, columns = np.ogrid[: rivals.shape[0], : rivals.shape[1]]
    rivals[(rows - best[1]) ** 2 + (columns - best[2]) ** 2 <= (config.rival_distance / cell) ** 2] = 0.0
    if rivals.max() > config.rival * score:
        return None
    shift = np.array([(best[2] - steps) * cell, (best[1] - steps) * cell])
    return np.array([*(pivot[:2] + shift), pivot[2] + float(turns[best[0]])])


def view(scans: ScanStore, poses: Array, key: int, config: LoopClosingConfig) -> Array:
    """End points (m, 2) of the key scans around ``key``, in its frame."""
    near = range(max(0, key - config.around), min(len(poses), key + config.around + 1), config.around_step)
    return np.concatenate(
        [geometry.transform(geometry.between(poses[key], poses[k]), scans.points_of(k)) for k in near]
    )


def blurred(points: Array, centre: Array, half: float, cell: float, blur: float) -> tuple[Field, Array]:
    """A square map (n, n), rows along y, 2 ``half`` m wide round ``centre``, and its corner (2,) m.

    1 on walls, falling to 0 as exp(-d² / 2 ``blur``²); cells of ``cell`` m.
    """
    import cv2

    n = math.ceil(2.0 * half / cell)
    corner = centre - half
    cells = np.floor((points - corner) / cell).astype(np.int64)
    inside = ((cells >= 0) & (cells < n)).all(axis=1)
    free = np.ones((n, n), np.uint8)
    free[cells[inside, 1], cells[inside, 0]] = 0
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 3) * cell
    return np.exp(-(distance**2) / (2.0 * blur**2)).astype(np.float32), corner


@njit(cache=True, nogil=True)
def overlay(field: Field, centre: Array, points: Array, turns: Array, steps: int) -> Field:
    """Mean of the field under ``points`` (m, 2), turned about ``centre`` and moved by up to +-``steps`` cells.

    All in cells. Returns (turns, 2 steps + 1, 2 steps + 1): rows are shifts along y, columns along x. The plain twin is
    in ``tests/slam/graph/test_loop_closing.py``.
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


def _agreed(
    poses: Array,
    start: Indices,
    end: Indices,
    measured: Array,
    good: NDArray[np.bool_],
    config: LoopClosingConfig,
) -> NDArray[np.bool_]:
    """Which closures another good one nearby confirms: it would move its key scan by nearly the same."""
    to = geometry.compose(poses[start], measured)
    near = (
        (np.abs(end[:, None] - end[None]) < config.confirm_within)
        & good[None]
        & good[:, None]
        & ~np.eye(len(end), dtype=bool)
    )
    # What the one closure does to its own key scan, done to the other's, must put that where the other closure does.
    correction = geometry.compose(to, geometry.between(poses[end], np.zeros(3)))
    predicted = geometry.compose(correction[:, None], poses[end][None])
    missed = geometry.between(predicted, np.broadcast_to(to[None], predicted.shape))
    same: NDArray[np.bool_] = np.hypot(missed[..., 0], missed[..., 1]) < config.confirm_distance
    same &= np.abs(missed[..., 2]) < config.confirm_angle
    confirmed: NDArray[np.bool_] = (near & same).any(axis=1)
    return confirmed
