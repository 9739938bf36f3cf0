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
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.graph.branch_and_bound import search
from pfslam_viz.slam.graph.drift import Drift
from pfslam_viz.slam.graph.pose_graph import Constraints, turned
from pfslam_viz.slam.graph.scan_store import ScanStore, trusted
from pfslam_viz.slam.graph.settings import LoopClosingConfig

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Field = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Candidates:
    """Pairs of key scans (c,) that may show the same place, and how far (c,) m and rad they may have drifted apart."""

    earlier: Indices
    later: Indices
    reach: Array
    turn: Array


def find_loops(scans: ScanStore, poses: Array, drift: Drift, config: LoopClosingConfig) -> list[Constraints]:
    """Constraints between key scans that show the same place though ``poses`` (k, 3) do not say so, loop by loop."""
    later = np.arange(config.every, len(poses), config.every)
    return confirmed(poses, search_loops(scans, poses, find_candidates(poses, drift, later, config), config), config)


def search_loops(scans: ScanStore, poses: Array, candidates: Candidates, config: LoopClosingConfig) -> Constraints:
    """The candidates that fit elsewhere than ``poses`` (k, 3) say, and match there. Nothing confirms them yet."""
    found = _search_all(scans, poses, candidates, config)
    start, end = np.array([c[0] for c in found], np.int64), np.array([c[1] for c in found], np.int64)
    guesses = np.array([c[2] for c in found]).reshape(-1, 3)
    prior = np.array([config.guess_distance, config.guess_distance, config.guess_angle]) ** -2.0
    gates = np.array(config.gates)
    matched = scans.match(
        start, end, guesses, prior, gates, stride=config.match_stride, iterations=config.match_iterations
    )
    good = trusted(matched, guesses, config)
    information = config.temper * turned(matched.information, matched.poses[:, 2])
    robust = np.zeros(int(good.sum()), np.bool_)
    return Constraints(start[good], end[good], matched.poses[good], information[good], robust)


def confirmed(poses: Array, closures: Constraints, config: LoopClosingConfig) -> list[Constraints]:
    """Those ``closures`` that another one nearby confirms, loop by loop."""
    closures = closures.pick(np.flatnonzero(_agreed(poses, closures, config)))
    breaks = np.flatnonzero(np.diff(closures.end) > config.confirm_within) + 1
    return [closures.pick(part) for part in np.split(np.arange(len(closures)), breaks) if len(part)]


def find_candidates(poses: Array, drift: Drift, later: Indices, config: LoopClosingConfig) -> Candidates:
    """Key scans ``later`` (k,), each with the nearest earlier ones that drift may have carried away from it."""
    path = path_lengths(poses)
    found: list[tuple[int, int, float, float]] = []
    for k in later.tolist():
        position, heading = drift.before(k)
        reach = np.clip(config.sigmas * position, config.least_reach, config.most_reach)
        turn = np.clip(config.sigmas * heading, config.least_turn, config.most_turn)
        away = np.hypot(*(poses[:k, :2] - poses[k, :2]).T)
        away[(path[k] - path[:k] < config.least_loop) | (away > reach)] = np.inf
        for _ in range(config.places):
            nearest = int(np.argmin(away))
            if not np.isfinite(away[nearest]):
                break
            found.append((nearest, k, float(reach[nearest]), float(turn[nearest])))
            away[np.abs(path[:k] - path[nearest]) < config.elsewhere] = np.inf
    table = np.array(found).reshape(-1, 4)
    return Candidates(table[:, 0].astype(np.int64), table[:, 1].astype(np.int64), table[:, 2], table[:, 3])


def path_lengths(poses: Array) -> Array:
    """(k,) m driven up to each of the poses (k, 3)."""
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])


def _search_all(
    scans: ScanStore, poses: Array, candidates: Candidates, config: LoopClosingConfig
) -> list[tuple[int, int, Array]]:
    """The candidates that fit somewhere else than where they are: earlier, later, and the increment between them."""
    views: dict[int, Array] = {}
    path = path_lengths(poses)

    def view_of(key: int) -> Array:
        if key not in views:
            views[key] = view(scans, poses, path, key, config)
        return views[key]

    def search(part: slice) -> list[tuple[int, int, Array]]:
        found = []
        pairs = zip(
            candidates.earlier[part], candidates.later[part], candidates.reach[part], candidates.turn[part], strict=True
        )
        for earlier, later, reach, turn in pairs:
            pivot = geometry.between(poses[earlier], poses[later])
            better = _search(view_of(int(earlier)), view_of(int(later)), pivot, float(reach), float(turn), config)
            if better is not None:
                found.append((int(earlier), int(later), better))
        return found

    parts = scans.worker.split(search, len(candidates.later), worth=8, pieces=8)
    return [loop for part in parts for loop in part]


def _search(
    there: Array, seen: Array, pivot: Array, reach: float, turn: float, config: LoopClosingConfig
) -> Array | None:
    """Where the view ``seen`` (m, 2) fits on the view ``there`` (n, 2) better than at ``pivot`` (3,), and nowhere else.

    The increment (3,) is within ``reach`` m and ``turn`` rad of the pivot; None where there is no such place.
    """
    if len(there) == 0 or len(seen) == 0:
        return None  # all was out of range
    centre, cell = pivot[:2], config.cell
    points = (geometry.transform(pivot, seen[:: max(1, len(seen) // config.points)]) - centre) / cell
    field, corner = blurred(there, centre, reach + config.view, cell, config.blur)
    at = (centre - corner) / cell
    here = float(overlay(field, at, points, np.zeros(1), 2).max())
    if here > config.fits_already:
        return None
    steps = math.ceil(reach / cell)
    count = math.ceil(turn / config.turn_step)
    turns = config.turn_step * np.arange(-count, count + 1, dtype=np.float64)
    least = max(config.score, here / config.rival)  # otherwise it fits nowhere, or as well where it is
    fit = search(field, at, points, turns, steps, least=least, share=config.rival, apart=config.rival_distance / cell)
    if fit is None or fit.rival > config.rival * fit.score:
        return None
    return np.array([*(pivot[:2] + cell * np.array([fit.column, fit.row])), pivot[2] + float(turns[fit.turn])])


def view(scans: ScanStore, poses: Array, path: Array, key: int, config: LoopClosingConfig) -> Array:
    """End points (m, 2) of the key scans around ``key`` along the ``path`` (k,) m, in its frame."""
    near = np.flatnonzero(np.abs(path - path[key]) <= config.around)
    near = near[:: 1 + (len(near) - 1) // config.view_scans]
    return np.concatenate(
        [geometry.transform(geometry.between(poses[key], poses[k]), scans.points_of(int(k))) for k in near]
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
    if not inside.any():
        return np.zeros((n, n), np.float32), corner  # the distance transform has no answer
    free = np.ones((n, n), np.uint8)
    free[cells[inside, 1], cells[inside, 0]] = 0
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 3) * cell
    return np.exp(-(distance**2) / (2.0 * blur**2)).astype(np.float32), corner


@kernel("f4[:, ::1], f8[::1], f8[:, ::1], f8[::1], i8")
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
    count = np.float32(len(points))
    for t in range(len(turns)):
        for i in range(width):
            for j in range(width):
                out[t, i, j] /= count
    return out


def _agreed(poses: Array, closures: Constraints, config: LoopClosingConfig) -> NDArray[np.bool_]:
    """Which closures another one nearby confirms: it would move its key scan by nearly the same."""
    end = closures.end
    to = geometry.compose(poses[closures.start], closures.measured)
    near = (np.abs(end[:, None] - end[None]) < config.confirm_within) & ~np.eye(len(end), dtype=bool)
    # What the one closure does to its own key scan, done to the other's, must put that where the other closure does.
    correction = geometry.compose(to, geometry.between(poses[end], np.zeros(3)))
    predicted = geometry.compose(correction[:, None], poses[end][None])
    missed = geometry.between(predicted, np.broadcast_to(to[None], predicted.shape))
    same: NDArray[np.bool_] = np.hypot(missed[..., 0], missed[..., 1]) < config.confirm_distance
    same &= np.abs(missed[..., 2]) < config.confirm_angle
    agreed: NDArray[np.bool_] = (near & same).any(axis=1)
    return agreed
