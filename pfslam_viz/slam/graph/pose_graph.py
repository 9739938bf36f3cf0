"""Sparse robust least squares over SE(2) poses and the constraints between them: the pose graph.

Gauss-Newton on the graph of Lu & Milios (1997), as in Grisetti et al. (2010). Before every step each robust constraint
is given its robust weight (:func:`weights`): it counts for less the more it disagrees with the poses, so that a false
one does little harm.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

CLOSE, MOST_GRADIENTS = 1e-5, 20  # how exactly steps after the first are solved for, relatively, or else factored anew
DAMPING = 1e-9  # 1/m² and 1/rad²: what no constraint holds stays, and the matrix can be factored


@dataclass(frozen=True, slots=True)
class Constraints:
    """k measured increments: ``measured`` (k, 3) is pose ``end`` (k,) in the frame of pose ``start`` (k,).

    ``information`` (k, 3, 3) is the inverse covariance, in the frame of the measured pose; a constraint with ``robust``
    (k,) counts for less the more it disagrees, the others always count in full.
    """

    start: Indices
    end: Indices
    measured: Array
    information: Array
    robust: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.start)

    def pick(self, which: Indices) -> "Constraints":
        """Those at the positions ``which``."""
        return Constraints(
            self.start[which], self.end[which], self.measured[which], self.information[which], self.robust[which]
        )

    def firm(self) -> "Constraints":
        """The same, none of them robust."""
        return Constraints(self.start, self.end, self.measured, self.information, np.zeros(len(self), np.bool_))

    @staticmethod
    def join(parts: "list[Constraints]") -> "Constraints":
        """All constraints of ``parts`` in one."""
        return Constraints(
            np.concatenate([p.start for p in parts]),
            np.concatenate([p.end for p in parts]),
            np.concatenate([p.measured for p in parts]),
            np.concatenate([p.information for p in parts]),
            np.concatenate([p.robust for p in parts]),
        )


def turned(information: NDArray[Any], heading: Array | float) -> Array:
    """Information (..., 3, 3) on a pose, brought from the axes of its reference to its own, at ``heading`` rad."""
    c, s = np.cos(heading), np.sin(heading)
    r: Array = np.zeros((*np.shape(heading), 3, 3))
    r[..., 0, 0], r[..., 0, 1], r[..., 1, 0], r[..., 1, 1], r[..., 2, 2] = c, -s, s, c, 1.0
    own: Array = np.swapaxes(r, -1, -2) @ information @ r
    return own


def residuals(poses: Array, constraints: Constraints) -> Array:
    """(k, 3) by how much the poses (n, 3) miss every constraint, in the frame of the measured pose."""
    return geometry.between(constraints.measured, geometry.between(poses[constraints.start], poses[constraints.end]))


def weights(poses: Array, constraints: Constraints, scale: float) -> Array:
    """The robust weights (k,) in (0, 1]: Geman-McClure on the Mahalanobis distance, ``scale`` sigmas wide; else 1."""
    e = residuals(poses, constraints)
    square = np.einsum("ki,kij,kj->k", e, constraints.information, e)
    return np.where(constraints.robust, 1.0 / (1.0 + square / scale**2) ** 2, 1.0)


def optimize(
    poses: Array,
    constraints: Constraints,
    *,
    iterations: int,
    scale: float,
    settled_distance: float,
    settled_angle: float,
) -> Array:
    """The poses (n, 3) that satisfy the constraints best; the first one stays where it is.

    Stops when no pose moves by more than ``settled_distance`` m or turns by more than ``settled_angle`` rad.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import LinearOperator, cg, splu

    x = np.array(poses, dtype=np.float64)
    n, k = len(x), len(constraints)
    if n < 2 or k == 0:
        return x
    i, j = constraints.start, constraints.end
    at = np.stack([i, j]).astype(np.int32)[:, :, None] * np.int32(3) + np.arange(3, dtype=np.int32)  # (2, k, 3)
    row = np.broadcast_to(at[:, None, :, :, None], (2, 2, k, 3, 3)).ravel()  # 32 bits: what the solver works with
    column = np.broadcast_to(at[None, :, :, None, :], (2, 2, k, 3, 3)).ravel()
    factors = None
    for _ in range(iterations):
        error = residuals(x, constraints)
        a, b = _jacobians(x, constraints)
        omega = constraints.information * weights(x, constraints, scale)[:, None, None]
        wa, wb = a.transpose(0, 2, 1) @ omega, b.transpose(0, 2, 1) @ omega
        values = np.concatenate([(wa @ a).ravel(), (wa @ b).ravel(), (wb @ a).ravel(), (wb @ b).ravel()])
        hessian = coo_matrix((values, (row, column)), shape=(3 * n, 3 * n)).tocsc()
        del values, omega
        gradient = np.zeros((n, 3))
        np.add.at(gradient, i, (wa @ error[:, :, None])[:, :, 0])
        np.add.at(gradient, j, (wb @ error[:, :, None])[:, :, 0])
        del a, b, wa, wb
        reduced = hessian[3:, 3:] + DAMPING * _identity(3 * n - 3)
        del hessian
        downhill, missed = -gradient.ravel()[3:], 1
        if factors is not None:  # those of the step before are nearly right: a few conjugate gradients do the rest
            nearly = LinearOperator(reduced.shape, factors.solve)
            step, missed = cg(reduced, downhill, rtol=CLOSE, maxiter=MOST_GRADIENTS, M=nearly)
        if missed:
            factors = nearly = None  # the old ones go first: they are most of what this takes
            # It is positive definite: with the pivots on the diagonal, the factors fill in less, and are as exact
            options = {"SymmetricMode": True}
            factors = splu(reduced, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
            step = factors.solve(downhill)
        change = step.reshape(-1, 3)
        x[1:] += change
        x[1:, 2] = geometry.wrap(x[1:, 2])
        if np.abs(change[:, :2]).max() < settled_distance and np.abs(change[:, 2]).max() < settled_angle:
            break
    return x


def _identity(n: int):  # type: ignore[no-untyped-def]
    from scipy.sparse import identity

    return identity(n, format="csc")


def _jacobians(poses: Array, constraints: Constraints) -> tuple[Array, Array]:
    """Derivatives (k, 3, 3) of the residuals by the start and the end pose."""
    start, end = poses[constraints.start], poses[constraints.end]
    c, s = np.cos(start[:, 2]), np.sin(start[:, 2])
    dx, dy = end[:, 0] - start[:, 0], end[:, 1] - start[:, 1]
    zero, one = np.zeros_like(c), np.ones_like(c)
    by_start = np.stack(
        [
            np.stack([-c, -s, -s * dx + c * dy], axis=-1),
            np.stack([s, -c, -c * dx - s * dy], axis=-1),
            np.stack([zero, zero, -one], axis=-1),
        ],
        axis=1,
    )
    by_end = np.stack(
        [
            np.stack([c, s, zero], axis=-1),
            np.stack([-s, c, zero], axis=-1),
            np.stack([zero, zero, one], axis=-1),
        ],
        axis=1,
    )
    mc, ms = np.cos(constraints.measured[:, 2]), np.sin(constraints.measured[:, 2])
    turn = np.zeros((len(c), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1] = mc, ms
    turn[:, 1, 0], turn[:, 1, 1] = -ms, mc
    turn[:, 2, 2] = 1.0
    return turn @ by_start, turn @ by_end
