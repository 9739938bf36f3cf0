"""SE(2) poses as the filter uses them, vectorised.

A pose is ``(x, y, theta)``: metres and radians, counter-clockwise from x, as in the paper's state (16). Every function
takes arrays of poses of shape ``(..., 3)`` and broadcasts.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def wrap(angle: ArrayLike) -> Array:
    """Angle(s) in rad brought to [-pi, pi)."""
    return (np.asarray(angle, dtype=np.float64) + np.pi) % (2.0 * np.pi) - np.pi


# Single poses in plain numbers: a quarter of the time, and the same to the last place. Cosine and sine are NumPy's: the
# math module's may differ there.


def _compose_one(x: float, y: float, heading: float, ahead: float, aside: float, turn: float) -> Array:
    c, s = float(np.cos(heading)), float(np.sin(heading))
    return np.array([x + c * ahead - s * aside, y + s * ahead + c * aside, _wrap_one(heading + turn)])


def _between_one(x: float, y: float, heading: float, to_x: float, to_y: float, to_heading: float) -> Array:
    c, s = float(np.cos(heading)), float(np.sin(heading))
    dx, dy = to_x - x, to_y - y
    return np.array([c * dx + s * dy, -s * dx + c * dy, _wrap_one(to_heading - heading)])


def _wrap_one(angle: float) -> float:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def compose(pose: ArrayLike, increment: ArrayLike) -> Array:
    """The pose reached from ``pose`` by ``increment``, which is given in the frame of ``pose`` (SE(2) product)."""
    a, b = np.asarray(pose, dtype=np.float64), np.asarray(increment, dtype=np.float64)
    if a.ndim == b.ndim == 1:
        return _compose_one(*a.tolist(), *b.tolist())
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [
            a[..., 0] + c * b[..., 0] - s * b[..., 1],
            a[..., 1] + s * b[..., 0] + c * b[..., 1],
            wrap(a[..., 2] + b[..., 2]),
        ],
        axis=-1,
    )


def between(start: ArrayLike, end: ArrayLike) -> Array:
    """The increment that leads from pose ``start`` to pose ``end``, in the frame of ``start``: start⁻¹ ⊕ end."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    if a.ndim == b.ndim == 1:
        return _between_one(*a.tolist(), *b.tolist())
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * dx + s * dy, -s * dx + c * dy, wrap(b[..., 2] - a[..., 2])], axis=-1)


def increments(poses: ArrayLike) -> Array:
    """The motion ``(n, 3)`` to each of the ``(n, 3)`` poses from the one before, in the frame of that; row 0 is zero.

    The reverse of :func:`accumulate`, but for where the poses start.
    """
    p = np.asarray(poses, dtype=np.float64)
    steps = np.zeros_like(p)
    steps[1:] = between(p[:-1], p[1:])
    return steps


def inverse(pose: ArrayLike) -> Array:
    """The pose of the origin, seen from ``pose``."""
    return between(pose, np.zeros(3))


def transform(pose: ArrayLike, points: ArrayLike) -> Array:
    """Points ``(m, 2)`` from the frame of one ``pose`` (3,) to the frame it is given in: equation (23)."""
    p, xy = np.asarray(pose, dtype=np.float64), np.asarray(points, dtype=np.float64)
    c, s = np.cos(p[2]), np.sin(p[2])
    return np.stack([p[0] + c * xy[:, 0] - s * xy[:, 1], p[1] + s * xy[:, 0] + c * xy[:, 1]], axis=-1)


def accumulate(increments: ArrayLike, start: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Poses ``(n, 3)`` after each of the ``(n, 3)`` increments, from ``start``; headings wrapped."""
    steps = np.asarray(increments, dtype=np.float64)
    x, y, theta = (float(v) for v in np.asarray(start, dtype=np.float64))
    headings = theta + np.cumsum(steps[:, 2])
    before = np.concatenate([[theta], headings[:-1]])
    c, s = np.cos(before), np.sin(before)
    return np.stack(
        [
            x + np.cumsum(c * steps[:, 0] - s * steps[:, 1]),
            y + np.cumsum(s * steps[:, 0] + c * steps[:, 1]),
            wrap(headings),
        ],
        axis=-1,
    )


def twist(increments: ArrayLike) -> Array:
    """The steady motion ``(..., 3)`` whose unit of time leads through each increment: its logarithm in SE(2)."""
    p = np.asarray(increments, dtype=np.float64)
    half = 0.5 * p[..., 2]
    # V(theta)⁻¹ of the position, with theta / 2 / tan(theta / 2) on its diagonal.
    along = np.cos(half) / np.sinc(half / np.pi)
    return np.stack([along * p[..., 0] + half * p[..., 1], along * p[..., 1] - half * p[..., 0], p[..., 2]], axis=-1)


def steady_motion(twists: ArrayLike) -> Array:
    """The increments ``(..., 3)`` that steady motions lead to in a unit of time: the reverse of :func:`twist`.

    The robot goes along an arc: equation (17), with a motion to the side besides.
    """
    v = np.asarray(twists, dtype=np.float64)
    half = 0.5 * v[..., 2]
    chord = np.sinc(half / np.pi)
    c, s = chord * np.cos(half), chord * np.sin(half)
    return np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1], v[..., 2]], axis=-1)


def mean_pose(poses: ArrayLike, weights: ArrayLike) -> Array:
    """The weighted mean of ``(n, 3)`` poses, equation (33), with the circular mean of the headings."""
    p, w = np.asarray(poses, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    heading = np.arctan2(w @ np.sin(p[:, 2]), w @ np.cos(p[:, 2]))
    return np.array([w @ p[:, 0], w @ p[:, 1], heading])


def path_length(poses: ArrayLike) -> float:
    """The length in m of the polyline through the positions of ``(n, 3)`` poses."""
    p = np.asarray(poses, dtype=np.float64)
    return float(np.hypot(*np.diff(p[:, :2], axis=0).T).sum()) if len(p) > 1 else 0.0


def interpolate_poses(stamps: ArrayLike, poses: ArrayLike, at: ArrayLike) -> Array:
    """Poses at the times ``at`` (m,), linear between ``poses`` (n, 3) at increasing ``stamps`` (n,).

    Headings take the short way round. Outside the stamps the first and last pose are held.
    """
    t, p = np.asarray(stamps, dtype=np.float64), np.asarray(poses, dtype=np.float64)
    q = np.asarray(at, dtype=np.float64)
    heading = np.unwrap(p[:, 2])
    return np.stack([np.interp(q, t, p[:, 0]), np.interp(q, t, p[:, 1]), wrap(np.interp(q, t, heading))], axis=-1)
