"""Which of two trajectories do the scans speak for? Judged by what no fit has used.

Fits pull end points onto walls. They do not look at the space that a beam crossed on its way, and they match each scan
with a few others only. Here every key scan is laid over scans that it was not matched with: an end point that falls on
a wall seen by the other scan speaks for the two poses, one that lies in the open where the other scan's beam passed
speaks against them (as the beam model of Thrun, Burgard & Fox 2005, section 6.3, and the "negative information" of
free space). Two poses that see nothing in common say nothing.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.slam.graph.scan_matching import NEARLY, approximate_bearing, first_from
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import EvidenceConfig
from pfslam_viz.slam.graph.visits import earlier_visits

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Singles = NDArray[np.float32]


class EvidenceRules(NamedTuple):
    """What the kernel takes of :class:`EvidenceConfig`, in the same units."""

    beams: int
    fewest_points: int
    gap: float
    sigma: float
    wall_sigmas: float
    wall_reach: float
    margin: float
    margin_share: float
    crossed: float

    @classmethod
    def of(cls, config: EvidenceConfig) -> "EvidenceRules":
        """Those of a configuration."""
        return cls(**{name: getattr(config, name) for name in cls._fields})


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the scans say of one trajectory against another.

    ``gain`` is the mean over pairs of scans by how much more end points agree, in shares of a scan; ``sigmas`` that
    over its standard error, 0 where a single block has something to say; ``pairs`` how many pairs had. Pairs that both
    trajectories put alike have not.
    """

    gain: float
    sigmas: float
    pairs: int


def compare(
    scans: ScanStore, poses: Array, others: Array, config: EvidenceConfig, *, visits_alike: bool = False
) -> Verdict:
    """How much better the key ``poses`` (k, 3) explain the scans than the ``others`` (k, 3) do.

    With ``visits_alike``, the pairs of two visits count together as much as those of one, though they are fewer: for
    comparing with the filter's own trajectory. The filter has matched each scan with a map of those shortly before it,
    which it therefore puts well; where it drifts, that shows when it comes back.
    """
    pairs = witnesses(poses, others, config)
    pairs = pairs[_differ(poses, others, pairs, config)]
    mine, theirs = agreement(scans, poses, pairs, config), agreement(scans, others, pairs, config)
    told = (mine != 0.0) | (theirs != 0.0)
    size = max(min(config.block, len(poses) // config.fewest_blocks), 1)
    difference, block = (mine - theirs)[told], pairs[told, 1] // size
    if len(difference) == 0:
        return Verdict(0.0, 0.0, 0)
    share = _shares(pairs[told], config, visits_alike)
    gain = float((share * difference).sum())
    if np.count_nonzero(np.bincount(block)) < 2:
        return Verdict(gain, 0.0, len(difference))  # one block has no spread
    sums = np.bincount(block, share * (difference - gain))
    return Verdict(gain, gain / max(float(np.linalg.norm(sums)), 1e-9), len(difference))


def _shares(pairs: Indices, config: EvidenceConfig, visits_alike: bool) -> Array:
    """By how much each of the pairs (p,) counts, 1 in all."""
    kind = (pairs[:, 1] - pairs[:, 0] > max(config.hops)).astype(np.int64) * visits_alike
    counts = np.bincount(kind)
    shares: Array = 1.0 / (counts[kind] * np.count_nonzero(counts))
    return shares


def _differ(poses: Array, others: Array, pairs: Indices, config: EvidenceConfig) -> NDArray[np.bool_]:
    """Which pairs (p,) the two trajectories put differently."""
    start, end = pairs[:, 0], pairs[:, 1]
    apart = geometry.between(geometry.between(others[start], others[end]), geometry.between(poses[start], poses[end]))
    far: NDArray[np.bool_] = np.hypot(apart[:, 0], apart[:, 1]) > config.alike_distance
    return far | (np.abs(apart[:, 2]) > config.alike_angle)


def witnesses(poses: Array, others: Array, config: EvidenceConfig) -> Indices:
    """Pairs (p, 2) of key scans that either trajectory puts near each other, the earlier one first, each once."""
    n = len(poses)
    pairs = [np.stack([np.arange(n - hop), np.arange(hop, n)], axis=-1) for hop in config.hops if hop < n]
    for trajectory in (poses, others):
        visits = earlier_visits(trajectory, config.radius, config.apart, config.visits, config.turn_length, 0)
        visits[:, 0] = np.minimum(visits[:, 0] + config.aside, visits[:, 1] - 1)
        pairs.append(visits)
    return np.unique(np.concatenate(pairs), axis=0) if pairs else np.zeros((0, 2), np.int64)


def agreement(scans: ScanStore, poses: Array, pairs: Indices, config: EvidenceConfig) -> Array:
    """(p,): the share of end points on each other's walls, less ``crossed`` times that in each other's open space."""
    earlier, later = np.ascontiguousarray(pairs[:, 0]), np.ascontiguousarray(pairs[:, 1])
    return agreement_of(scans, earlier, later, geometry.between(poses[earlier], poses[later]), config)


def agreement_of(
    scans: ScanStore, earlier: Indices, later: Indices, increments: Array, config: EvidenceConfig
) -> Array:
    """The same (p,) of key scans ``earlier`` (p,) and ``later`` (p,), apart by the ``increments`` (p, 3)."""
    store = (scans.points, scans.own_normals, scans.bearings, scans.first, scans.lidar_position)
    rules = EvidenceRules.of(config)
    back = geometry.between(increments, np.zeros(3))

    def part(k: slice) -> Array:
        there = _agreement(*store, earlier[k], later[k], increments[k], rules)
        here = _agreement(*store, later[k], earlier[k], back[k], rules)
        told = (there[:, 1] >= config.least_told) & (here[:, 1] >= config.least_told)
        return np.where(told, 0.5 * (there[:, 0] + here[:, 0]), 0.0)

    return np.concatenate(scans.worker.split(part, len(earlier), worth=50))


@kernel("f4[:, :], f4[:, ::1], f4[:], i8[::1], f8[::1], i8[::1], i8[::1], f8[:, ::1], EvidenceRules")
def _agreement(
    points: Singles,
    normals: Singles,
    bearings: Singles,
    first: Indices,
    lidar_position: Array,
    references: Indices,
    others: Indices,
    increments: Array,
    rules: EvidenceRules,
) -> Array:
    """(p, 2): what the end points of scans ``others`` say of ``increments`` (p, 3), and the share that says anything.

    An increment is the other scan's pose in the frame of its reference.
    """
    out = np.zeros((len(references), 2))
    on_wall = rules.wall_sigmas * rules.sigma
    for k in range(len(references)):
        r0, r1 = first[references[k]], first[references[k] + 1]
        q0, q1 = first[others[k]], first[others[k] + 1]
        if r1 - r0 < rules.fewest_points or q1 - q0 < rules.fewest_points:
            continue
        gap = rules.gap * (bearings[r1 - 1] - bearings[r0]) / (r1 - r0)  # rad between beams with something in between
        ahead = 0.5 * (bearings[r0] + bearings[r1 - 1])
        x, y = increments[k, 0], increments[k, 1]
        c, s = math.cos(increments[k, 2]), math.sin(increments[k, 2])
        total, told, looked, i = 0.0, 0, 0, r0
        for b in range(q0, q1, 1 + (q1 - q0) // rules.beams):
            looked += 1
            px, py = x + c * points[b, 0] - s * points[b, 1], y + s * points[b, 0] + c * points[b, 1]
            lx, ly = px - lidar_position[0], py - lidar_position[1]
            bearing = approximate_bearing(lx, ly, ahead)
            i = first_from(bearings, r0, r1, bearing, i)  # the first beam that is not before it
            if (i < r1 and bearings[i] - bearing < NEARLY) or (i > r0 and bearing - bearings[i - 1] < NEARLY):
                bearing = math.atan2(ly, lx)
                bearing -= 2.0 * math.pi * math.floor((bearing - ahead) / (2.0 * math.pi) + 0.5)
                i = first_from(bearings, r0, r1, float(np.float32(bearing)), i)
            if not r0 < i < r1 or bearings[i] - bearings[i - 1] > gap:
                continue
            nearest = 1e9
            for j in range(i - 1, i + 1):
                dx, dy = px - points[j, 0], py - points[j, 1]
                nx, ny = normals[j, 0], normals[j, 1]
                square = dx * dx + dy * dy
                if (nx != 0.0 or ny != 0.0) and square < rules.wall_reach * rules.wall_reach:
                    nearest = min(nearest, abs(nx * dx + ny * dy))
                elif square < on_wall * on_wall:
                    nearest = min(nearest, math.hypot(dx, dy))
            if nearest < on_wall:
                away = nearest / rules.sigma
                total += math.exp(-0.5 * (away * away))
                told += 1
                continue
            far, shortest = math.sqrt(lx * lx + ly * ly), 1e9
            for j in range(i - 1, i + 1):
                dx, dy = points[j, 0] - lidar_position[0], points[j, 1] - lidar_position[1]
                shortest = min(shortest, math.sqrt(dx * dx + dy * dy))
            if far < shortest - rules.margin - rules.margin_share * far:
                total -= rules.crossed
                told += 1
        out[k, 0], out[k, 1] = total / looked, told / looked
    return out
