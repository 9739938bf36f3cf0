"""Batches of scans, and other contents, as columns of Rerun's archetypes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from pfslam_viz.viewer.colors import ERROR_RAMP, WEIGHT_RAMP, Color
from pfslam_viz.viewer.contents import Boxes, Cells, Content, Lines, Note, Spots
from pfslam_viz.viewer.scan_batch import Ragged, ScanBatch, stride
from pfslam_viz.viewer.trail import level_strips

Array = NDArray[np.float64]
Points = NDArray[np.float32]
Strips = Sequence[Points] | Points  # polylines (m, 2) each, or (k, m, 2) for all of them

RESOLUTION = 0.01  # m: coordinates are rounded to this, which makes files small
FEW = 100  # particles whose positions are kept finely
HEADINGS = 60  # arrows a scan
HEADING_LENGTHS = (0.03, 0.3)  # m: twice the cloud's standard deviation (thrice where few), within these
LEVEL_HEIGHT = 0.002  # m from one level of weight to the next


def time_columns(steps: Sequence[int] | NDArray[np.int64], seconds: Sequence[float] | Array) -> list[rr.TimeColumn]:
    """The timelines ``step`` (scans) and ``time`` (s since the first scan)."""
    return [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("time", duration=np.asarray(seconds, np.float64))]


def lifted(points: Any, z: float) -> Points:
    """Points (m, 2) or (m, 3) as (m, 3) float32 at height ``z``."""
    out = np.full((len(points), 3), z, np.float32)
    out[:, :2] = points[:, :2]
    return out


def point_columns(points: Ragged, z: float) -> Any:
    """A point set (m, 2) a row, rounded."""
    positions = lifted(np.round(points.values / RESOLUTION) * RESOLUTION, z)
    return rr.Points3D.columns(positions=positions).partition(points.lengths)


def packed(colors: Sequence[Color]) -> NDArray[np.uint32]:
    """Colours as Rerun stores them, opaque."""
    return np.array([(r << 24) | (g << 16) | (b << 8) | 255 for r, g, b in colors], np.uint32)


_RAMP, _ERROR_RAMP = packed(WEIGHT_RAMP), packed(ERROR_RAMP)


def particle_columns(scans: ScanBatch, most: int, z: float) -> tuple[Any, Any]:
    """At most so many particles a scan as points, some of them as arrows along their heading; coloured by weight.

    Positions are rounded to a quarter of the cloud's standard deviation (a fortieth where particles are few, which
    costs little), at most to :data:`RESOLUTION`.
    """
    kept = [_by_weight(weights, most) for weights in scans.weights.rows()]
    lengths = np.array([len(order) for order in kept])
    ends = np.cumsum(lengths)
    starts = np.cumsum(scans.weights.lengths) - scans.weights.lengths
    chosen = np.concatenate(kept) + np.repeat(starts, lengths)
    particles, weights = scans.particles.values[chosen], scans.weights.values[chosen]
    level = weight_levels(weights * np.repeat(scans.weights.lengths, lengths))
    spread = np.sqrt(np.maximum(np.trace(scans.covariance, axis1=1, axis2=2), 0.0))
    spread = np.repeat(spread, lengths)[:, None]
    few = np.repeat(lengths <= FEW, lengths)[:, None]
    grain = np.clip(spread / np.where(few, 40, 4), RESOLUTION / 50, RESOLUTION)
    positions = lifted(np.round(particles[:, :2] / grain) * grain, z)
    positions[:, 2] += LEVEL_HEIGHT * level  # where particles cover each other, the heaviest shows
    colors = _RAMP[level]
    points = rr.Points3D.columns(positions=positions, colors=colors).partition(lengths)
    some = [np.arange(end - 1, end - 1 - n, -stride(n, HEADINGS))[::-1] for end, n in zip(ends, lengths, strict=True)]
    drawn = np.concatenate(some)
    heading = np.round(particles[drawn, 2] * 60.0) / 60.0
    length = np.clip(np.where(few[drawn], 3, 2) * spread[drawn], *HEADING_LENGTHS)
    vectors = lifted(length * np.stack([np.cos(heading), np.sin(heading)], axis=-1), 0.0)
    arrows = rr.Arrows3D.columns(origins=positions[drawn], vectors=vectors, colors=colors[drawn])
    return points, arrows.partition([len(s) for s in some])


def weight_levels(averages: Points) -> NDArray[np.intp]:
    """Levels in WEIGHT_RAMP for weights given in averages, 1 / N each: 1 is in the middle, 9 and more at the end."""
    levels = len(WEIGHT_RAMP)
    return np.minimum((averages / (1.0 + averages) * levels + 1e-3).astype(np.intp), levels - 1)


def _by_weight(weights: Points, most: int) -> NDArray[np.intp]:
    """Which of the particles are drawn, the heaviest last: it covers the others, and runs of one colour pack well."""
    order = np.argsort(weights)
    return order[::-1][:: stride(len(order), most)][::-1]


def line_columns(groups: Sequence[Strips], z: float, colors: NDArray[np.uint32] | None = None) -> Any:
    """Some polylines a row, at height ``z``, of a colour each if ``colors`` are given for all of them.

    Rerun's own conversion of one strip at a time is slow.
    """
    points, lengths = [np.zeros((0, 2), np.float32)], [0]
    for group in groups:
        if isinstance(group, np.ndarray):  # of equal lengths
            points.append(group.reshape(-1, 2))
            lengths += [group.shape[1]] * len(group)
        else:
            points += group
            lengths += [len(strip) for strip in group]
    return _line_columns(np.concatenate(points), lengths, [len(group) for group in groups], z, colors)


def _line_columns(points: Points, lengths: Any, counts: Any, z: float, colors: NDArray[np.uint32] | None = None) -> Any:
    """The same of ``points`` (m, 2), polyline after polyline: 0 and the ``lengths``, and ``counts``, how many a row."""
    data_type = rr.components.LineStrip3DBatch._ARROW_DATATYPE
    flat = lifted(points, z)
    inner = pa.FixedSizeListArray.from_arrays(pa.array(flat.ravel()), type=data_type.value_type)
    strips = pa.ListArray.from_arrays(pa.array(np.cumsum(lengths).astype(np.int32)), inner, type=data_type)
    return rr.LineStrips3D.columns(strips=strips, colors=colors).partition(counts)


def strip_columns(values: Sequence[Any], z: float) -> Any:
    """A polyline (m, 2) a row; none where m is 0."""
    return line_columns([[v] if len(v) else [] for v in values], z)


def error_columns(values: Sequence[Points], z: float) -> Any:
    """A trajectory (m, 3) a row: x, y and the level of the error there, in ERROR_RAMP, that the way to it shows."""
    points, lengths, levels, counts = level_strips(values)
    return _line_columns(points, [0, *lengths.tolist()], counts.tolist(), z, _ERROR_RAMP[levels])


def pose_columns(poses: Array, z: float) -> Any:
    """Poses (n, 3), one a row, as transforms."""
    quaternions = np.zeros((len(poses), 4), np.float32)
    quaternions[:, 2], quaternions[:, 3] = np.sin(poses[:, 2] / 2), np.cos(poses[:, 2] / 2)
    return rr.Transform3D.columns(translation=lifted(poses, z), quaternion=quaternions)


def position_columns(poses: Array, z: float) -> Any:
    """The positions of poses (n, 3), one a row, as transforms that do not turn."""
    return rr.Transform3D.columns(translation=lifted(poses, z))


def ellipse_columns(means: Array, covariances: Array, z: float) -> Any:
    """Transforms that make the two-sigma ellipses of covariances (n, 2, 2) of a unit circle."""
    values, vectors = np.linalg.eigh(covariances)
    shapes = np.tile(np.eye(3, dtype=np.float32), (len(means), 1, 1))
    shapes[:, :2, :2] = 2.0 * vectors * np.sqrt(np.maximum(values, 1e-12))[:, None, :]
    by_columns = pa.array(np.swapaxes(shapes, 1, 2).ravel())  # as Rerun stores them; its own conversion is slow
    data_type = rr.components.TransformMat3x3Batch._ARROW_DATATYPE
    matrices = pa.FixedSizeListArray.from_arrays(by_columns, type=data_type)
    return rr.Transform3D.columns(translation=lifted(means, z), mat3x3=matrices)


def arrow_columns(origins: Array, vectors: Array, z: float) -> Any:
    """An arrow a row: origins and vectors (n, 2)."""
    return rr.Arrows3D.columns(origins=lifted(origins, z), vectors=lifted(vectors, 0.0))


def pointer_columns(origins: Array, vectors: Array, labels: Sequence[str], shown: NDArray[np.bool_], z: float) -> Any:
    """An arrow with its label in the rows that are ``shown`` (n,), none in the others: origins and vectors (n, 2)."""
    kept = [label for label, show in zip(labels, shown, strict=True) if show]
    starts, arrows = lifted(origins[shown], z), lifted(vectors[shown], 0.0)
    return rr.Arrows3D.columns(origins=starts, vectors=arrows, labels=kept).partition(shown.astype(int))


def scalar_columns(values: Any) -> Any:
    """A number a row, for plots."""
    return rr.Scalars.columns(scalars=np.asarray(values, np.float64))


def content_columns(contents: Sequence[Content]) -> Any:
    """What one entity shows, a content a row: one at least, all of one kind."""
    rows: list[Any] = list(contents)
    if isinstance(rows[0], Cells):
        return _grid_map_columns(rows)
    if isinstance(rows[0], Boxes):
        centers, half_sizes = np.concatenate([r.centers for r in rows]), np.concatenate([r.half_sizes for r in rows])
        return rr.Boxes3D.columns(centers=centers, half_sizes=half_sizes).partition([len(r.centers) for r in rows])
    if isinstance(rows[0], Lines):
        colored = [ERROR_RAMP[level] for r in rows for level in r.levels]
        return line_columns([r.strips for r in rows], rows[0].z, packed(colored) if colored else None)
    if isinstance(rows[0], Spots):
        points, lengths = np.concatenate([r.points for r in rows]), [len(r.points) for r in rows]
        labels = [label for r in rows for label in r.labels] or None
        return rr.Points3D.columns(positions=lifted(points, rows[0].z), labels=labels).partition(lengths)
    if isinstance(rows[0], Note):
        return rr.TextLog.columns(text=[r.text for r in rows], level=[r.level for r in rows])
    types = ["image/jpeg"] * len(rows)
    return rr.EncodedImage.columns(blob=_blobs([r.contents for r in rows]), media_type=types)


def _blobs(rows: Sequence[NDArray[np.uint8]]) -> Any:
    """Bytes (m,) each as what images take, without the copies that Rerun makes of every array."""
    data_type = rr.components.BlobBatch._ARROW_DATATYPE
    offsets = np.cumsum([0, *(len(row) for row in rows)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), pa.array(np.concatenate(rows)), type=data_type)


def _grid_map_columns(grids: Sequence[Cells]) -> Any:
    n, gray = len(grids), grids[0].values.ndim == 2
    formats = [
        rr.components.ImageFormat(
            width=grid.values.shape[1],
            height=grid.values.shape[0],
            color_model="L" if gray else "RGBA",
            channel_datatype="U8",
        )
        for grid in grids
    ]
    return rr.GridMap.columns(
        data=_blobs([grid.values.reshape(-1) for grid in grids]),
        format=formats,
        cell_size=[grid.cell for grid in grids],
        translation=np.array([grid.corner for grid in grids]),
        colormap=[rr.components.Colormap.RvizMap] * n if gray else None,
        opacity=None if gray else [0.999] * n,
    )
