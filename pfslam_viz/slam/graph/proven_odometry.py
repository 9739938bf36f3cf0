"""Odometry that has proven right, and where a trajectory turns against it.

One step of good odometry and one of poor look alike beside a match's own noise. Over some more they do not:
errors of single steps grow with the root of the span, those of a gyro's bias or a wheel's size with the span itself,
as in Allan's variance (Allan 1966). So odometry is proven if its difference to the trajectory, by medians and as a
multiple of what the settings expect, is small over spans of one step to many; not of more than that, because a few
wrong turns of the trajectory itself are in most of the long ones.

Such odometry tells where scans were matched wrongly (people who walk along, a hall of which hardly a wall is in view):
a step of the trajectory that contradicts it by far. Matching the same scans again from there finds the same again, so
the whole trajectory is laid out anew as the odometry says, except where the scans about such a step clearly show that
it is the odometry that slipped. From then on its heading is held between matches, too: where matches are right, it is
left loose there, because a bias of the gyro would bend what the scans know.
"""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.evidence import agreement_of
from pfslam_viz.slam.graph.odometry_errors import NORMAL
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import EvidenceConfig, OdometryConfig

Array = NDArray[np.float64]

SPANS = 4  # that the way has at least, of any length: fewer tell no median


def greatest_multiple(missed: Array, deviation: Array, longest: int) -> float:
    """The standard deviation of sums of ``missed`` (k,) over that of independent errors of ``deviation`` (k,).

    By the median absolute deviation, over spans of 1, 2, 4, ... steps, the ``longest`` at most; the greatest of them.
    """
    total = np.concatenate([[0.0], np.cumsum(missed)])
    variance = np.concatenate([[0.0], np.cumsum(deviation**2)])
    greatest, span = 0.0, 1
    while span <= longest and SPANS * span <= len(missed):
        ratios = np.abs(total[span:] - total[:-span]) / np.sqrt(variance[span:] - variance[:-span])
        greatest = max(greatest, NORMAL * float(np.median(ratios)))
        span *= 2
    return greatest


def prove(
    poses: Array, steps: Array, deviation: Array, known: NDArray[np.bool_], config: OdometryConfig
) -> tuple[float, float]:
    """How much less than the settings say odometry errs in position and heading; 1 for what is not proven.

    ``steps`` (k - 1, 3) are the odometry's between the key ``poses`` (k, 3), the wheels' scale corrected, of
    ``deviation`` (k - 1, 3) m, m, rad as the settings say. How far it drove is asked only where scans have ``known``
    (k - 1,) every direction.
    """
    missed = missed_by(poses, steps)
    driven = np.hypot(steps[:, 0], steps[:, 1])
    told = known & (driven >= config.scale_driven)
    ahead = (missed[told, :2] * steps[told, :2]).sum(axis=1) / driven[told]
    return _proven(ahead, deviation[told, 0], config), _proven(missed[:, 2], deviation[:, 2], config)


def _proven(missed: Array, deviation: Array, config: OdometryConfig) -> float:
    if len(missed) < config.proven_motions:
        return 1.0
    multiple = greatest_multiple(missed, deviation, config.proven_span)
    return max(multiple, config.proven_least) if multiple < config.proven else 1.0


def missed_by(poses: Array, steps: Array) -> Array:
    """(k - 1, 3) by how much key ``poses`` (k, 3) go otherwise than ``steps`` (k - 1, 3), in each start's frame."""
    missed = geometry.between(poses[:-1], poses[1:]) - steps
    missed[:, 2] = geometry.wrap(missed[:, 2])
    return missed


def contradicting(
    poses: Array, steps: Array, deviation: Array, proven: tuple[float, float], config: OdometryConfig
) -> NDArray[np.bool_]:
    """Which steps (k - 1,) of the key ``poses`` (k, 3) contradict odometry that is ``proven``, as by :func:`prove`.

    By more than its errors explain, and by more than matches would find from another start anyway.
    """
    missed = missed_by(poses, steps)
    of_distance, of_angle = proven
    moved = np.hypot(missed[:, 0], missed[:, 1])
    far = moved > np.maximum(config.doubt * of_distance * deviation[:, 0], config.doubt_distance)
    turned = np.abs(missed[:, 2]) > np.maximum(config.doubt * of_angle * deviation[:, 2], config.doubt_angle)
    contradicts: NDArray[np.bool_] = (far & (of_distance < 1.0)) | (turned & (of_angle < 1.0))
    return contradicts


def refuted(
    scans: ScanStore,
    poses: Array,
    steps: Array,
    joints: NDArray[np.bool_],
    config: OdometryConfig,
    evidence: EvidenceConfig,
) -> NDArray[np.bool_]:
    """At which of the ``joints`` (k - 1,) the scans clearly put the key ``poses`` (k, 3) right, not the ``steps``.

    Even good wheels slip once. Then the scans before and after agree with the poses as matched, and not at all with
    the odometry's step between them; where they were matched wrongly, they agree with neither much more.
    """
    out = np.zeros(len(joints), np.bool_)
    for k in np.flatnonzero(joints).tolist():
        before = np.arange(max(k + 1 - config.doubt_hops, 0), k + 1)
        after = np.arange(k + 1, min(k + 1 + config.doubt_hops, len(poses)))
        start, end = (pairs.ravel() for pairs in np.meshgrid(before, after))
        near = end - start <= config.doubt_hops
        start, end = start[near], end[near]
        slid = geometry.compose(geometry.between(poses[start], poses[[k]]), steps[[k]])
        slid = geometry.compose(slid, geometry.between(poses[[k + 1]], poses[end]))
        own = agreement_of(scans, start, end, geometry.between(poses[start], poses[end]), evidence)
        out[k] = np.mean(own - agreement_of(scans, start, end, slid, evidence)) > config.doubt_refuted
    return out


def laid_out(poses: Array, steps: Array, proven: tuple[float, float], slipped: NDArray[np.bool_]) -> Array:
    """Key ``poses`` (k, 3) as odometry ``steps`` (k - 1, 3) lead, but as they are where it ``slipped`` (k - 1,).

    With their own headings where the odometry's is not proven.
    """
    own = geometry.between(poses[:-1], poses[1:])
    led = steps if proven[1] < 1.0 else np.column_stack([steps[:, :2], own[:, 2]])
    return geometry.accumulate(np.vstack([poses[:1], np.where(slipped[:, None], own, led)]))
