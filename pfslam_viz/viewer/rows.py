"""Rows of entities that are logged at every scan, gathered and sent in blocks: small files, flat memory."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz.viewer.entities import WEIGHT_RAMP
from pfslam_viz.viewer.sinks import Sink

Array = NDArray[np.float64]
Encoder = Callable[[list[Any]], Any]


@dataclass
class _Rows:
    encode: Encoder
    steps: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)


@dataclass
class Rows:
    """What is to be sent, by entity path; ``logged`` holds every path that ever got a row."""

    sink: Sink
    logged: set[str] = field(default_factory=set)
    _entities: dict[str, _Rows] = field(default_factory=dict)

    def add(self, path: str, encode: Encoder, step: int, seconds: float, value: Any) -> None:
        """A row of ``path`` at scan ``step`` and time ``seconds``; ``encode`` turns the values of a block into columns."""
        rows = self._entities.get(path)
        if rows is None:
            rows = self._entities[path] = _Rows(encode)
            self.logged.add(path)
        rows.steps.append(step)
        rows.seconds.append(seconds)
        rows.values.append(value)

    def flush(self) -> None:
        """Send what was gathered."""
        for path, rows in self._entities.items():
            if rows.steps:
                times = [
                    rr.TimeColumn("step", sequence=rows.steps),
                    rr.TimeColumn("time", duration=np.asarray(rows.seconds)),
                ]
                self.sink.send_columns(path, times, rows.encode(rows.values))
                rows.steps, rows.seconds, rows.values = [], [], []


def lifted(points: Array, z: float) -> NDArray[np.float32]:
    """Points (m, 2) or (m, 3) as (m, 3) float32 at height ``z``."""
    out = np.full((len(points), 3), z, np.float32)
    out[:, :2] = points[:, :2]
    return out


def rounded(points: Array, resolution: float = 0.01) -> Array:
    """Coordinates (m, 2) to multiples of ``resolution`` m, which makes files small."""
    return np.round(points[:, :2] / resolution) * resolution


def points_at(z: float) -> Encoder:
    """Encoder of point sets (m, 2)."""

    def encode(values: list[Array]) -> Any:
        positions = lifted(np.concatenate(values), z)
        return rr.Points3D.columns(positions=positions).partition([len(v) for v in values])

    return encode


_RAMP = np.array([(r << 24) | (g << 16) | (b << 8) | 255 for r, g, b in WEIGHT_RAMP], np.uint32)


def colored_points_at(z: float) -> Encoder:
    """Encoder of (points (m, 2), level of :data:`WEIGHT_RAMP` (m,))."""

    def encode(values: list[tuple[Array, NDArray[np.intp]]]) -> Any:
        positions = lifted(np.concatenate([v[0] for v in values]), z)
        colors = _RAMP[np.concatenate([v[1] for v in values])]
        return rr.Points3D.columns(positions=positions, colors=colors).partition([len(v[0]) for v in values])

    return encode


def colored_arrows_at(z: float) -> Encoder:
    """Encoder of (origins (m, 2), vectors (m, 2), level of :data:`WEIGHT_RAMP` (m,))."""

    def encode(values: list[tuple[Array, Array, NDArray[np.intp]]]) -> Any:
        origins = lifted(np.concatenate([v[0] for v in values]), z)
        vectors = lifted(np.concatenate([v[1] for v in values]), 0.0)
        colors = _RAMP[np.concatenate([v[2] for v in values])]
        lengths = [len(v[0]) for v in values]
        return rr.Arrows3D.columns(origins=origins, vectors=vectors, colors=colors).partition(lengths)

    return encode


def arrow_at(z: float) -> Encoder:
    """Encoder of one arrow a row: (origin (2,), vector (2,))."""

    def encode(values: list[tuple[Array, Array]]) -> Any:
        return rr.Arrows3D.columns(
            origins=lifted(np.array([v[0] for v in values]), z), vectors=lifted(np.array([v[1] for v in values]), 0.0)
        )

    return encode


def strip_at(z: float) -> Encoder:
    """Encoder of one polyline (m, 2) a row; none where m is 0."""

    def encode(values: list[Array]) -> Any:
        strips = [lifted(v, z) for v in values if len(v)]
        return rr.LineStrips3D.columns(strips=strips).partition([int(len(v) > 0) for v in values])

    return encode


def pose_at(z: float) -> Encoder:
    """Encoder of poses (3,), as transforms."""

    def encode(values: list[Array]) -> Any:
        poses = np.asarray(values)
        quaternions = np.zeros((len(poses), 4), np.float32)
        quaternions[:, 2], quaternions[:, 3] = np.sin(poses[:, 2] / 2), np.cos(poses[:, 2] / 2)
        return rr.Transform3D.columns(translation=lifted(poses, z), quaternion=quaternions)

    return encode


def position_at(z: float) -> Encoder:
    """Encoder of positions (2,) or poses (3,), as transforms that do not turn."""

    def encode(values: list[Array]) -> Any:
        return rr.Transform3D.columns(translation=lifted(np.asarray(values), z))

    return encode


def ellipse_at(z: float) -> Encoder:
    """Encoder of (mean (2,), shape (2, 2)): a transform that makes an ellipse of a unit circle."""

    def encode(values: list[tuple[Array, Array]]) -> Any:
        matrices = np.tile(np.eye(3, dtype=np.float32), (len(values), 1, 1))
        matrices[:, :2, :2] = [v[1] for v in values]
        columns = np.swapaxes(matrices, 1, 2).reshape(-1, 9)  # Rerun stores matrices column by column
        return rr.Transform3D.columns(translation=lifted(np.array([v[0] for v in values]), z), mat3x3=columns)

    return encode


def scalars(values: Sequence[float]) -> Any:
    """Encoder of numbers, for plots."""
    return rr.Scalars.columns(scalars=np.asarray(values, np.float64))
