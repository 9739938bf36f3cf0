"""How far two key scans may have drifted apart: where a loop has to be looked for.

Errors of joints between successive key scans add up along the way, and an error of heading is a lever for everything
that comes after it. To first order, with independent joints of position variance p and heading variance q, the later
pose L as seen from the earlier one E varies by

    sum p_j + sum q_j |x_j - x_L|²  in position,  sum q_j  in heading,

over the joints j on the way. Links (matched visits, closed loops) are short cuts: the way with least variance counts,
as in Olson's search windows from Dijkstra projections (Olson 2009, "Recognizing places using spectrally clustered local
matches").
"""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.settings import DriftConfig

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

NORMAL = 1.4826  # standard deviation of a normal distribution per median absolute deviation


class Drift:
    """The variances along one trajectory of key ``poses`` (k, 3).

    ``joints`` (k - 1, 2) are the deviations m, rad from each key pose to the next, ``links`` (c, 2) pairs of key scans
    that are held together.
    """

    def __init__(self, poses: Array, joints: Array, links: Indices, most_links: int) -> None:
        """No more than ``most_links`` of the links are tried, evenly taken."""
        self._poses = poses
        self._links = np.ascontiguousarray(links[:: 1 + (len(links) - 1) // most_links]) if len(links) else links
        p, q = joints[:, 0] ** 2, joints[:, 1] ** 2
        middle = 0.5 * (poses[:-1, :2] + poses[1:, :2])
        terms = np.column_stack([p + q * (middle**2).sum(axis=1), q * middle[:, 0], q * middle[:, 1], q])
        self._sums = np.concatenate([np.zeros((1, 4)), np.cumsum(terms, axis=0)])

    def before(self, later: int) -> tuple[Array, Array]:
        """Deviations of position (later,) m and heading (later,) rad of key pose ``later`` seen from all before it."""
        x, y = self._poses[later, :2]
        variances = _variances(self._sums, self._links, later, x, y)
        return np.sqrt(variances[0]), np.sqrt(variances[1])


@kernel("f8[:, ::1], i8[:, ::1], i8, f8, f8")
def _variances(sums: Array, links: Indices, later: int, x: float, y: float) -> Array:
    """(2, later): the variances of position (x, y) and of heading at key pose ``later`` as seen from those before it.

    Along all joints between them, or over the one link that makes the position's least.
    """
    out = np.empty((2, later))
    for earlier in range(later):
        position, heading = _along(sums, earlier, later, x, y)
        out[0, earlier], out[1, earlier] = position, heading
    for k in range(len(links)):
        start, end = links[k, 0], links[k, 1]
        if start >= later or end >= later:
            continue
        on_position, on_heading = _along(sums, end, later, x, y)
        for earlier in range(later):
            position, heading = _along(sums, earlier, start, x, y)
            if position + on_position < out[0, earlier]:
                out[0, earlier], out[1, earlier] = position + on_position, heading + on_heading
    return out


@kernel()
def _along(sums: Array, start: int, end: int, x: float, y: float) -> tuple[float, float]:
    """Variances of (x, y) and of heading over the joints between two key scans, whichever comes first."""
    first, last = min(start, end), max(start, end)
    q = sums[last, 3] - sums[first, 3]
    position = sums[last, 0] - sums[first, 0]
    position -= 2.0 * (x * (sums[last, 1] - sums[first, 1]) + y * (sums[last, 2] - sums[first, 2]))
    position += q * (x * x + y * y)
    return max(position, 0.0), q


def joint_deviations(
    matched: Constraints, motion: Constraints, count: int, longest_hop: int, deviation: Array
) -> Array:
    """Deviations (count - 1, 2) m, rad from each of ``count`` key scans to the next.

    That of a match, ``deviation`` (2,), where one of near key scans, no more than the ``longest_hop`` apart, spans the
    joint; elsewhere that of the ``motion`` constraints (odometry) of the graph.
    """
    joined = spanned(matched, count, longest_hop)
    known = np.zeros((count - 1, 2))
    np.add.at(known, motion.start, motion.information[:, [0, 2], [0, 2]])  # heading may be a constraint of its own
    odometry = known**-0.5
    return np.where(joined[:, None], deviation, np.maximum(odometry, deviation))


def spanned(matched: Constraints, count: int, longest_hop: int) -> NDArray[np.bool_]:
    """Which joints (count - 1,) from one of ``count`` key scans to the next a match of near key scans reaches over.

    Key scans no more than the ``longest_hop`` apart are near; others are of two visits.
    """
    near = matched.end - matched.start <= longest_hop
    change = np.zeros(count, np.int64)
    np.add.at(change, matched.start[near], 1)
    np.add.at(change, matched.end[near], -1)
    covered: NDArray[np.bool_] = np.cumsum(change)[:-1] > 0
    return covered


def match_deviation(matched: Constraints, hops: tuple[int, ...], config: DriftConfig) -> Array:
    """Deviation (2,) m, rad of a match between successive key scans, from the triangles that matches over hops form.

    A match over two hops against the two matches in between, by the median absolute deviation. ``hops`` are those
    between key scans that were ``matched``.
    """
    at = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(matched.start, matched.end, strict=True))}
    for hop in sorted(hops, reverse=True):
        triangles = [
            (k, at[a, a + hop], at[a + hop, b])
            for (a, b), k in at.items()
            if b - a == 2 * hop and (a, a + hop) in at and (a + hop, b) in at
        ]
        if len(triangles) < config.triangles:
            continue
        whole, first, second = np.array(triangles).T
        m = matched.measured
        missed = geometry.between(m[whole], geometry.compose(m[first], m[second]))
        spread = np.array([np.median(np.abs(missed[:, :2])), np.median(np.abs(missed[:, 2]))])
        told: Array = np.maximum(NORMAL * spread / np.sqrt(3.0 * hop), [config.least_distance, config.least_angle])
        return told
    return np.array([config.usual_distance, config.usual_angle])
