"""Scans gathered into blocks, and each block as columns of Rerun's archetypes: small files, flat memory, little time.

A block holds what the Steps hold (copies, since a filter may write over its arrays); everything drawn is worked out
for a whole block at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz.step import Step
from pfslam_viz.viewer.entities import WEIGHT_RAMP

Array = NDArray[np.float64]
Points = NDArray[np.float32]

RESOLUTION = 0.01  # m: coordinates are rounded to this, which makes files small
FEW = 100  # particles that are drawn finely
HEADINGS = 60  # arrows a scan
HEADING_LENGTHS = (0.02, 0.2)  # m: twice the cloud's standard deviation, within these
LEVEL_HEIGHT = 0.002  # m from one level of weight to the next


@dataclass
class Block:
    """Consecutive scans, field by field; one entry a scan."""

    steps: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    best: list[Array] = field(default_factory=list)
    mean: list[Array] = field(default_factory=list)
    covariance: list[Array] = field(default_factory=list)
    dead_reckoning: list[Array] = field(default_factory=list)
    truth: list[Array] = field(default_factory=list)
    particles: list[Points] = field(default_factory=list)
    weights: list[Points] = field(default_factory=list)
    end_points: list[Points] = field(default_factory=list)
    hits: list[NDArray[np.bool_]] = field(default_factory=list)
    dead_reckoning_end_points: list[Points] = field(default_factory=list)
    curves: dict[str, list[float]] = field(default_factory=dict)
    corrections: list[Array] = field(default_factory=list)
    degenerate: list[Array | None] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.steps)

    def add(self, step: Step, max_particles: int, max_beams: int, lineages: int) -> None:
        """Take a scan, thinned to the most that is drawn of it."""
        estimate = step.estimate
        self.steps.append(step.index)
        self.seconds.append(step.time)
        for poses, pose in (
            (self.best, estimate.best),
            (self.mean, estimate.mean),
            (self.dead_reckoning, step.dead_reckoning),
        ):
            poses.append(np.array(pose))
        self.covariance.append(np.array(estimate.covariance[:2, :2]))
        if step.truth is not None:
            self.truth.append(np.array(step.truth))
        order = np.argsort(estimate.weights)  # runs of one colour pack well, and the heaviest is drawn last
        order = order[::-1][:: stride(len(order), max_particles)][::-1]
        self.particles.append(estimate.particles[order].astype(np.float32))
        heaviest = max(float(estimate.weights[order[-1]]), 1e-300)
        self.weights.append((estimate.weights[order] / heaviest).astype(np.float32))
        every = stride(len(step.end_points), max_beams)
        self.end_points.append(step.end_points[::every].astype(np.float32))
        self.hits.append(step.hits[::every].copy())
        every = stride(len(step.dead_reckoning_end_points), max_beams)
        self.dead_reckoning_end_points.append(step.dead_reckoning_end_points[::every].astype(np.float32))
        self._add_curves(step, lineages)

    def _add_curves(self, step: Step, lineages: int) -> None:
        match = step.estimate.match
        values = {
            "n_eff": float(step.estimate.n_eff),
            "correlation": np.count_nonzero(step.hits) / max(len(step.hits), 1),
            "lineages": float(lineages),
        }
        if match is not None:
            values["score"] = float(match.score)
            values["correction"] = float(np.hypot(match.correction[0], match.correction[1]))
            self.corrections.append(np.array(match.correction))
            self.degenerate.append(None if match.degenerate is None else np.array(match.degenerate))
        for name, value in values.items():
            self.curves.setdefault(name, []).append(value)

    def times(self) -> list[rr.TimeColumn]:
        """Both timelines."""
        return time_columns(self.steps, self.seconds)


def time_columns(steps: Sequence[int], seconds: Sequence[float]) -> list[rr.TimeColumn]:
    """The timelines ``step`` (scans) and ``time`` (s since the first scan)."""
    return [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("time", duration=np.asarray(seconds, np.float64))]


def stride(total: int, most: int) -> int:
    """Every how many of ``total`` are kept so that at most ``most`` are."""
    return max(-(-total // max(most, 1)), 1)


def lifted(points: Any, z: float) -> Points:
    """Points (m, 2) or (m, 3) as (m, 3) float32 at height ``z``."""
    out = np.full((len(points), 3), z, np.float32)
    out[:, :2] = points[:, :2]
    return out


def _concatenated(values: Sequence[Points], width: int) -> Points:
    return np.concatenate(values) if values else np.zeros((0, width), np.float32)


def point_columns(values: Sequence[Points], z: float) -> Any:
    """A point set (m, 2) a row, rounded."""
    points = np.round(_concatenated(values, 2)[:, :2] / RESOLUTION) * RESOLUTION
    return rr.Points3D.columns(positions=lifted(points, z)).partition([len(v) for v in values])


def split(values: Sequence[Points], masks: Sequence[NDArray[np.bool_]]) -> tuple[list[Points], list[Points]]:
    """Each point set (m, 2) as those that its mask (m,) picks, and the others."""
    pairs = list(zip(values, masks, strict=True))
    return [v[m] for v, m in pairs], [v[~m] for v, m in pairs]


_RAMP = np.array([(r << 24) | (g << 16) | (b << 8) | 255 for r, g, b in WEIGHT_RAMP], np.uint32)


def particle_columns(block: Block, z: float) -> tuple[Any, Any]:
    """The particles as points, and some of them as arrows that look along their heading; coloured by weight.

    Positions are rounded to a quarter of the cloud's standard deviation (a fortieth where particles are few, which
    costs little), at most to :data:`RESOLUTION`.
    """
    lengths = np.array([len(p) for p in block.particles])
    particles = np.concatenate(block.particles)
    levels = len(WEIGHT_RAMP)
    level = np.minimum((np.concatenate(block.weights) * levels).astype(np.intp), levels - 1)
    spread = np.sqrt(np.maximum(np.trace(np.array(block.covariance), axis1=1, axis2=2), 0.0))
    spread = np.repeat(spread, lengths)[:, None]
    few = np.repeat(lengths <= FEW, lengths)[:, None]
    grain = np.clip(spread / np.where(few, 40, 4), RESOLUTION / 50, RESOLUTION)
    positions = lifted(np.round(particles[:, :2] / grain) * grain, z)
    positions[:, 2] += LEVEL_HEIGHT * level  # where particles cover each other, the heaviest shows
    colors = _RAMP[level]
    points = rr.Points3D.columns(positions=positions, colors=colors).partition(lengths)
    ends = np.cumsum(lengths)
    some = [np.arange(end - 1, end - 1 - n, -stride(n, HEADINGS))[::-1] for end, n in zip(ends, lengths, strict=True)]
    chosen = np.concatenate(some)
    heading = np.round(particles[chosen, 2] * 60.0) / 60.0
    length = np.clip(2 * spread[chosen], *HEADING_LENGTHS)
    vectors = lifted(length * np.stack([np.cos(heading), np.sin(heading)], axis=-1), 0.0)
    arrows = rr.Arrows3D.columns(origins=positions[chosen], vectors=vectors, colors=colors[chosen])
    return points, arrows.partition([len(s) for s in some])


def strips(points: Sequence[Any] | Points, z: float) -> Any:
    """Polylines as what LineStrips3D takes, without its slow conversion of one strip at a time.

    ``points`` are (m, 2) each, or (k, m, 2) for all of them.
    """
    data_type = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    if isinstance(points, np.ndarray):  # of equal lengths
        lengths = np.full(points.shape[0], points.shape[1])
        joined = points.reshape(-1, 2)
    else:
        lengths = np.array([len(p) for p in points], np.intp)
        joined = _concatenated(points, 2)
    offsets = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    flat = lifted(joined, z)
    inner = pa.FixedSizeListArray.from_arrays(pa.array(flat.ravel()), type=data_type.value_type)
    return pa.ListArray.from_arrays(pa.array(offsets), inner, type=data_type)


def strip_columns(values: Sequence[Any], z: float) -> Any:
    """A polyline (m, 2) a row; none where m is 0."""
    lines = strips([v for v in values if len(v)], z)
    return rr.LineStrips3D.columns(strips=lines).partition([int(len(v) > 0) for v in values])


def pose_columns(poses: Sequence[Array], z: float) -> Any:
    """A pose (3,) a row, as transforms."""
    p = np.asarray(poses)
    quaternions = np.zeros((len(p), 4), np.float32)
    quaternions[:, 2], quaternions[:, 3] = np.sin(p[:, 2] / 2), np.cos(p[:, 2] / 2)
    return rr.Transform3D.columns(translation=lifted(p, z), quaternion=quaternions)


def position_columns(poses: Sequence[Array], z: float) -> Any:
    """The position of a pose (3,) a row, as transforms that do not turn."""
    return rr.Transform3D.columns(translation=lifted(np.asarray(poses), z))


def ellipse_columns(means: Sequence[Array], covariances: Sequence[Array], z: float) -> Any:
    """Transforms that make the two-sigma ellipse of each covariance (2, 2) of a unit circle."""
    values, vectors = np.linalg.eigh(np.asarray(covariances))
    shapes = np.tile(np.eye(3, dtype=np.float32), (len(means), 1, 1))
    shapes[:, :2, :2] = 2.0 * vectors * np.sqrt(np.maximum(values, 1e-12))[:, None, :]
    by_columns = pa.array(np.swapaxes(shapes, 1, 2).ravel())  # as Rerun stores them; its own conversion is slow
    data_type = rr.components.TransformMat3x3Batch._ARROW_DATATYPE
    matrices = pa.FixedSizeListArray.from_arrays(by_columns, type=data_type)
    return rr.Transform3D.columns(translation=lifted(np.asarray(means), z), mat3x3=matrices)


def arrow_columns(origins: Array, vectors: Array, z: float) -> Any:
    """An arrow a row: origins and vectors (n, 2)."""
    return rr.Arrows3D.columns(origins=lifted(origins, z), vectors=lifted(vectors, 0.0))


def scalar_columns(values: Any) -> Any:
    """A number a row, for plots."""
    return rr.Scalars.columns(scalars=np.asarray(values, np.float64))
