"""Where along a bare corridor two visits are: what a match of end points with walls leaves open, free space can tell.

Between two long walls, a scan slides along another one, and its match says nothing of that direction. But an alcove, a
door frame or the corridor's end that is a few end points of hundreds is also space that beams cross, or do not. So both
scans are laid over each other at one shift after the other along the open direction, and judged as in
:mod:`pfslam_viz.slam.graph.evidence`. A shift counts only if no other, further away, is nearly as good.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.evidence import agreement_of
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import EvidenceConfig, SlidingConfig

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def hold_along(
    scans: ScanStore, visits: Constraints, config: SlidingConfig, evidence: EvidenceConfig
) -> tuple[Constraints, Constraints]:
    """The matches of ``visits``, held along the direction that they leave open; and those that are further along it.

    The first are all of them, in their order: those that free space puts nearby are moved there and held. The second
    are firm, as closures of loops are: free space puts them too far off for a robust constraint to be heard.
    """
    at, axes = _open(visits, config)
    if len(at) == 0:
        return visits, visits.pick(at)
    shifts = shifts_along(scans, visits.pick(at), axes, config, evidence)
    moves = np.column_stack([shifts[:, None] * axes, np.zeros(len(at))])
    moved = geometry.compose(visits.measured[at], moves)
    information = visits.information[at].copy()
    information[:, :2, :2] += config.deviation**-2.0 * axes[:, :, None] * axes[:, None, :]
    near = np.abs(shifts) <= config.near
    far = np.abs(shifts) > config.near
    held = replace(visits, measured=visits.measured.copy(), information=visits.information.copy())
    held.measured[at[near]], held.information[at[near]] = moved[near], information[near]
    loops = replace(visits.pick(at[far]), measured=moved[far], information=information[far])
    return held, loops.firm()


def _open(visits: Constraints, config: SlidingConfig) -> tuple[Indices, Array]:
    """Which of the ``visits`` leave a direction open, every so many of them, and which (m, 2): in the later's frame."""
    at = np.flatnonzero(visits.end % config.every == 0)
    values, vectors = np.linalg.eigh(visits.information[at, :2, :2])
    is_open = (values[:, 1] > 0.0) & (values[:, 0] < config.weak * values[:, 1])
    return at[is_open], vectors[is_open][:, :, 0]


def shifts_along(
    scans: ScanStore, visits: Constraints, axes: Array, config: SlidingConfig, evidence: EvidenceConfig
) -> Array:
    """How far (v,) m along their ``axes`` (v, 2) free space puts the later scans of ``visits``; nan where unsure."""
    count = round(config.reach / config.step)
    steps = np.arange(-count, count + 1, dtype=np.float64)
    moves = np.zeros((len(visits), len(steps), 3))
    moves[:, :, :2] = config.step * steps[:, None] * axes[:, None]
    tried = geometry.compose(visits.measured[:, None], moves).reshape(-1, 3)
    earlier, later = np.repeat(visits.start, len(steps)), np.repeat(visits.end, len(steps))
    found = agreement_of(scans, earlier, later, tried, evidence).reshape(len(visits), len(steps))
    best = found.argmax(axis=1)
    apart = config.step * np.abs(steps - steps[best][:, None]) > config.apart
    rival = np.where(apart, found, -np.inf).max(axis=1)
    inside = (best > 0) & (best < len(steps) - 1)
    clear = inside & (found[np.arange(len(best)), best] > rival + config.gain)
    top = np.where(inside, best, 1)[:, None] + np.array([-1, 0, 1])
    before, peak, after = np.take_along_axis(found, top, axis=1).T  # of a parabola through the best and its neighbours
    bend = np.maximum(2.0 * peak - before - after, 1e-9)
    shifts: Array = config.step * (steps[best] + np.clip(0.5 * (after - before) / bend, -0.5, 0.5))
    return np.where(clear, shifts, np.nan)
