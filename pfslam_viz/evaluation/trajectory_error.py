"""Error of a trajectory against the truth, aligned at the start only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrajectoryError:
    """How far an estimate is from the truth over all scans: metres and degrees.

    ``position_final`` is the error of the last pose: what is left of the drift when the robot is back at its start.
    """

    position_rmse: float
    position_max: float
    position_final: float
    heading_rmse: float
    heading_max: float

    def as_dict(self) -> dict[str, float]:
        """Plain numbers under names that carry their units."""
        return {
            "position_rmse_m": self.position_rmse,
            "position_max_m": self.position_max,
            "position_final_m": self.position_final,
            "heading_rmse_deg": self.heading_rmse,
            "heading_max_deg": self.heading_max,
        }


def pose_errors(truth: ArrayLike, estimate: ArrayLike) -> tuple[Array, Array]:
    """Distance (n,) m and signed heading error (n,) deg of each pose, both trajectories moved to start at the origin.

    ``truth`` and ``estimate`` are (n, 3), pose by pose at the same times, each in any frame.
    """
    t, e = np.asarray(truth, dtype=np.float64), np.asarray(estimate, dtype=np.float64)
    if t.shape != e.shape or t.ndim != 2 or t.shape[1] != 3 or len(t) == 0:
        raise ValueError(f"truth {t.shape} and estimate {e.shape} must both be (n, 3) with n > 0")
    difference = geometry.between(e[0], e) - geometry.between(t[0], t)
    return np.hypot(difference[:, 0], difference[:, 1]), np.degrees(geometry.wrap(difference[:, 2]))


def trajectory_error(truth: ArrayLike, estimate: ArrayLike) -> TrajectoryError:
    """The error of ``estimate`` (n, 3) against ``truth`` (n, 3), aligned by the first pose and nothing else."""
    position, heading = pose_errors(truth, estimate)
    return TrajectoryError(
        position_rmse=float(np.sqrt(np.mean(position**2))),
        position_max=float(position.max()),
        position_final=float(position[-1]),
        heading_rmse=float(np.sqrt(np.mean(heading**2))),
        heading_max=float(np.abs(heading).max()),
    )
