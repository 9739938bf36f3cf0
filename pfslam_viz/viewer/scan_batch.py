"""What is shown of every scan, copied out of the Steps, since a filter writes over its arrays.

Plain arrays, nothing of Rerun: :mod:`pfslam_viz.viewer.archetypes` makes Rerun's columns of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.step import Step
from pfslam_viz.viewer.colors import ERROR_LIMITS

Array = NDArray[np.float64]
Points = NDArray[np.float32]


def stride(total: int, most: int) -> int:
    """Every how many of ``total`` are kept so that at most ``most`` are."""
    return max(-(-total // max(most, 1)), 1)


def distance(some: Array, others: Array) -> Array:
    """How far poses (n, 3) are from others, m."""
    apart = some[:, :2] - others[:, :2]
    return np.hypot(apart[:, 0], apart[:, 1])


def error_levels(errors: Array) -> NDArray[np.intp]:
    """Levels in ERROR_RAMP for errors in m: 0 for up to the first of ERROR_LIMITS, ..."""
    return np.searchsorted(ERROR_LIMITS, errors)


@dataclass(frozen=True, slots=True)
class ScanCopy:
    """What is shown of one Step, whose names it keeps; end points are thinned, ``curves`` are numbers to plot."""

    index: int
    time: float
    best: Array
    mean: Array
    dead_reckoning: Array
    truth: Array | None
    covariance: Array
    particles: Points
    weights: Points
    end_points: Points
    hits: NDArray[np.bool_]
    dead_reckoning_end_points: Points
    correction: Array | None
    degenerate: Array | None
    revised: Points | None
    resampled: bool
    informative: bool
    curves: dict[str, float]

    @classmethod
    def of(cls, step: Step, max_beams: int, **curves: float) -> "ScanCopy":
        """Copies of at most ``max_beams`` end points, and of everything else; ``curves`` are plotted too."""
        estimate, match = step.estimate, step.estimate.match
        every = stride(len(step.end_points), max_beams)
        every_reckoned = stride(len(step.dead_reckoning_end_points), max_beams)
        curves["n_eff"] = float(estimate.n_eff)
        curves["correlation"] = np.count_nonzero(step.hits) / max(len(step.hits), 1)
        if match is not None:
            curves["score"] = float(match.score)
            curves["correction"] = float(np.hypot(match.correction[0], match.correction[1]))
        return cls(
            index=step.index,
            time=step.time,
            best=np.array(estimate.best),
            mean=np.array(estimate.mean),
            dead_reckoning=np.array(step.dead_reckoning),
            truth=None if step.truth is None else np.array(step.truth),
            covariance=np.array(estimate.covariance[:2, :2]),
            particles=estimate.particles.astype(np.float32),
            weights=estimate.weights.astype(np.float32),
            end_points=step.end_points[::every].astype(np.float32),
            hits=step.hits[::every].copy(),
            dead_reckoning_end_points=step.dead_reckoning_end_points[::every_reckoned].astype(np.float32),
            correction=None if match is None else np.array(match.correction),
            degenerate=None if match is None or match.degenerate is None else np.array(match.degenerate),
            revised=None if step.revision is None else step.revision.trajectory[:, :2].astype(np.float32),
            resampled=bool(estimate.resampled),
            informative=bool(estimate.informative),
            curves=curves,
        )


@dataclass(frozen=True, slots=True)
class Ragged:
    """Arrays of different lengths, one a scan: ``values`` holds them one after the other, ``lengths`` (n,) each."""

    values: NDArray[Any]
    lengths: NDArray[np.intp]

    @classmethod
    def of(cls, rows: Sequence[NDArray[Any]]) -> "Ragged":
        """From one array at least."""
        return cls(np.concatenate(rows), np.array([len(row) for row in rows], np.intp))

    def rows(self) -> list[NDArray[Any]]:
        """The arrays again, as views."""
        return np.split(self.values, np.cumsum(self.lengths)[:-1])

    def where(self, mask: NDArray[np.bool_]) -> "Ragged":
        """Without the values that ``mask``, as long as ``values``, leaves out."""
        kept = np.concatenate([[0], np.cumsum(mask)])
        ends = np.cumsum(self.lengths)
        return Ragged(self.values[mask], kept[ends] - kept[ends - self.lengths])


@dataclass(frozen=True, slots=True)
class ScanBatch:
    """n ScanCopies, field by field: (n, ...) each.

    Where one of them holds None, ``truth`` or ``correction`` is None; a curve that one of them lacks is left out.
    """

    index: NDArray[np.int64]
    time: Array
    best: Array
    mean: Array
    dead_reckoning: Array
    truth: Array | None
    covariance: Array
    particles: Ragged
    weights: Ragged
    end_points: Ragged
    hits: Ragged
    dead_reckoning_end_points: Ragged
    correction: Array | None
    degenerate: tuple[Array | None, ...]
    revised: tuple[Points | None, ...]
    resampled: NDArray[np.bool_]
    informative: NDArray[np.bool_]
    curves: dict[str, Array]

    @classmethod
    def of(cls, scans: Sequence[ScanCopy]) -> "ScanBatch":
        """From one ScanCopy at least."""
        batch: dict[str, Any] = {}
        for field in fields(cls):
            column = [getattr(scan, field.name) for scan in scans]
            if field.type is Ragged:
                batch[field.name] = Ragged.of(column)
            elif field.name in ("degenerate", "revised"):
                batch[field.name] = tuple(column)
            elif field.name == "curves":
                names = set.intersection(*map(set, column))
                batch[field.name] = {name: np.array([curves[name] for curves in column]) for name in names}
            else:
                batch[field.name] = None if any(value is None for value in column) else np.array(column)
        return cls(**batch)

    def __len__(self) -> int:
        return len(self.index)
