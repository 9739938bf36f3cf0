"""Kümmerle's metric: error against known relative poses, which needs no common frame.

R. Kümmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27, 2009. The error of a relation
is the pose gt⁻¹ ⊕ est, where est is the estimated pose at ``end`` in the frame of the estimated pose at ``start``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.recording import Relations

Array = NDArray[np.float64]

TOLERANCE = 0.01  # s: a relation's stamp and its scan's differ by no more than rounding


@dataclass(frozen=True, slots=True)
class MeanStd:
    """Mean and standard deviation (of the whole set, not of a sample from it: the published tables' convention)."""

    mean: float
    std: float

    @classmethod
    def of(cls, values: Array) -> "MeanStd":
        """Of (k,) values, k > 0."""
        return cls(float(values.mean()), float(values.std()))


@dataclass(frozen=True, slots=True)
class RelationErrors:
    """The metric over all matched relations: m, deg, m², deg²."""

    matched: int
    unmatched: int
    translation: MeanStd
    rotation: MeanStd
    translation_squared: MeanStd
    rotation_squared: MeanStd

    def as_dict(self) -> dict[str, float]:
        """Plain numbers under names that carry their units."""
        return {
            "translation_mean_m": self.translation.mean,
            "translation_std_m": self.translation.std,
            "rotation_mean_deg": self.rotation.mean,
            "rotation_std_deg": self.rotation.std,
            "translation_squared_mean_m2": self.translation_squared.mean,
            "translation_squared_std_m2": self.translation_squared.std,
            "rotation_squared_mean_deg2": self.rotation_squared.mean,
            "rotation_squared_std_deg2": self.rotation_squared.std,
            "matched": self.matched,
            "unmatched": self.unmatched,
        }


def nearest(stamps: ArrayLike, at: ArrayLike) -> NDArray[np.intp]:
    """For each time ``at`` (m,) the index of the nearest of the increasing ``stamps`` (n,), n > 0."""
    t, q = np.asarray(stamps, dtype=np.float64), np.asarray(at, dtype=np.float64)
    if len(t) == 1:
        return np.zeros(len(q), dtype=np.intp)
    right = np.clip(np.searchsorted(t, q), 1, len(t) - 1)
    return right - (q - t[right - 1] <= t[right] - q)


def errors_of(
    relations: Relations, stamps: ArrayLike, poses: ArrayLike, tolerance: float = TOLERANCE
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Per relation |translation| (k,) m, |rotation| (k,) deg, and whether both its stamps have a pose (k,).

    ``poses`` (n, 3) belong to the increasing ``stamps`` (n,) s. A relation is matched by the poses nearest in time to
    its two stamps, if they are within ``tolerance`` s; the errors of an unmatched one mean nothing.
    """
    t, p = np.asarray(stamps, dtype=np.float64), np.asarray(poses, dtype=np.float64)
    i, j = nearest(t, relations.start), nearest(t, relations.end)
    matched = (np.abs(t[i] - relations.start) <= tolerance) & (np.abs(t[j] - relations.end) <= tolerance)
    error = geometry.between(relations.poses, geometry.between(p[i], p[j]))
    return np.hypot(error[:, 0], error[:, 1]), np.abs(np.degrees(error[:, 2])), matched


def relation_errors(
    relations: Relations, stamps: ArrayLike, poses: ArrayLike, tolerance: float = TOLERANCE
) -> RelationErrors | None:
    """The metric for ``poses`` (n, 3) at ``stamps`` (n,) s; None if not one relation's stamps have poses."""
    translation, rotation, matched = errors_of(relations, stamps, poses, tolerance)
    if not matched.any():
        return None
    translation, rotation = translation[matched], rotation[matched]
    return RelationErrors(
        matched=int(matched.sum()),
        unmatched=int((~matched).sum()),
        translation=MeanStd.of(translation),
        rotation=MeanStd.of(rotation),
        translation_squared=MeanStd.of(translation**2),
        rotation_squared=MeanStd.of(rotation**2),
    )
