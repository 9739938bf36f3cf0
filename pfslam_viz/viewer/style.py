"""What is logged once: the table's colours and widths, the robot's shape, the cameras that look down."""

from itertools import pairwise
from typing import Any

import numpy as np
import rerun as rr

from pfslam_viz.recordings.recording import Recording
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.viewer import colors, entities
from pfslam_viz.viewer.colors import Color
from pfslam_viz.viewer.contents import IMAGE_SCALE
from pfslam_viz.viewer.entities import ENTITIES, Entity, Kind
from pfslam_viz.viewer.framing import Framing, overhead_camera, round_length
from pfslam_viz.viewer.sinks import Sink

CLOSE_UP, LOUPE = "close_up", "loupe"  # the cameras that follow the robot
FOLLOW_HEIGHT = 9.0  # m of floor that the close-up shows
LOUPE_HEIGHTS = (0.15, 2.0)  # m of floor that the particles' own view shows, by how far they spread

ROBOT_OUTLINE = np.array([[0.55, 0, 0], [-0.3, 0.3, 0], [-0.15, 0, 0], [-0.3, -0.3, 0]])
"""m: an arrow head along x, about as large as the robot."""

_ANGLE = np.linspace(0.0, 2 * np.pi, 65)
UNIT_CIRCLE = np.stack([np.cos(_ANGLE), np.sin(_ANGLE), 0 * _ANGLE], axis=-1)


FEW = 50  # particles that are drawn larger


def style_run(sink: Sink, run: str, color: Color, camera: CameraGeometry | None, particles: int) -> None:
    """Style what one run, of so many particles and with such a camera, has of its own."""
    for row in ENTITIES:
        if row.owner == "{run}":
            _style(sink, row, run, color, camera, few=particles <= FEW)
    sink.log_static(f"{entities.FOLLOW.path(run)}/{CLOSE_UP}", *_hanging_camera(FOLLOW_HEIGHT))
    sink.log_static(scale_bar_path(run, CLOSE_UP), _scale_bar((0.0, 0.0), FOLLOW_HEIGHT, FOLLOW_HEIGHT))
    log_loupe(sink, run, None)


def style_shared(sink: Sink, recording: Recording) -> None:
    """Style what all runs share: dead reckoning, and truth where it is known."""
    for row in ENTITIES:
        if row.owner == "dead_reckoning" or (row.owner == "truth" and recording.truth is not None):
            _style(sink, row, row.owner, colors.DEAD_RECKONING, None)


def style_walls(sink: Sink, path: str) -> None:
    """Style a block of walls (:mod:`pfslam_viz.viewer.blocks`) as the others."""
    sink.log_static(path, _boxes(entities.WALLS.color))


def _boxes(color: Any) -> rr.Boxes3D:
    return rr.Boxes3D.from_fields(colors=color, fill_mode=rr.components.FillMode.Solid)


def log_framing(sink: Sink, framing: Framing, truth: bool) -> None:
    """Point the overview's camera at a piece of floor; with ``truth``, put the colours of errors there."""
    sink.log_static(entities.OVERVIEW, *overhead_camera(framing.center, framing.height, framing.aspect))
    sink.log_static(entities.SCALE_BAR, _scale_bar(framing.center, framing.width, framing.height))
    if truth:
        bar, limits = _error_scale(framing)
        sink.log_static(entities.ERROR_SCALE, bar)
        sink.log_static(f"{entities.ERROR_SCALE}/limits", limits)


def _error_scale(framing: Framing) -> tuple[rr.LineStrips3D, rr.Points3D]:
    """A bar of the colours of errors at the right of a piece of floor, the largest on top, and the limits between."""
    x, z = framing.center[0] + 0.48 * framing.width, entities.POSE_Z
    y = framing.center[1] + framing.height * np.linspace(-0.45, 0.45, len(colors.ERROR_RAMP) + 1)
    bar = [[[x, a, z], [x, b, z]] for a, b in pairwise(y)]
    beside, lift = x - 0.07 * framing.height, 0.03 * framing.height  # the viewer writes below a point
    limits = rr.Points3D(
        [[beside, at + lift, z] for at in y[1:-1]],
        colors=colors.INK,
        radii=0.0,
        labels=[_length(limit) for limit in colors.ERROR_LIMITS],
        show_labels=True,
    )
    return rr.LineStrips3D(bar, colors=colors.ERROR_RAMP, radii=rr.Radius.ui_points(4.0)), limits


def _length(meters: float) -> str:
    return f"{meters:g} m" if meters >= 1 else f"{100 * meters:g} cm"


def log_loupe(sink: Sink, run: str, spread: float | None) -> None:
    """Let the particles' own view show what a cloud of this standard deviation (m; None: not known yet) needs."""
    height = 1.0 if spread is None else float(np.clip(12.0 * spread, *LOUPE_HEIGHTS))
    sink.log_static(f"{entities.FOLLOW.path(run)}/{LOUPE}", *_hanging_camera(height))
    sink.log_static(scale_bar_path(run, LOUPE), _scale_bar((0.0, 0.0), height, height))


def scale_bar_path(run: str, camera: str) -> str:
    """The entity path of the scale bar that belongs to one of the cameras that follow the robot."""
    return f"{entities.FOLLOW.path(run)}/{camera}_scale_bar"


def _scale_bar(center: tuple[float, float], width: float, height: float) -> rr.LineStrips3D:
    """A line of round length, with ticks at its ends, in the lower left corner of a piece of floor."""
    length, tick = round_length(width / 5), height / 80
    left, y = center[0] - 0.46 * width, center[1] - 0.4 * height
    bar = [[left, y + tick], [left, y - tick], [left, y], [left + length, y], [left + length, y + tick]]
    bar += [[left + length, y - tick]]
    points = np.insert(np.array(bar), 2, entities.POSE_Z, axis=1)
    return rr.LineStrips3D(
        [points], colors=colors.INK, radii=rr.Radius.ui_points(1.25), labels=_length(length), show_labels=True
    )


def log_page(sink: Sink, path: str, text: str) -> None:
    """A markdown page."""
    sink.log_static(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))


def _hanging_camera(height_on_floor: float) -> tuple[rr.Transform3D, rr.Pinhole]:
    """A camera over the robot that sees so many metres of floor."""
    return overhead_camera((0.0, 0.0), height_on_floor, aspect=1.0, above=5.0)


def _style(
    sink: Sink, row: Entity, run: str, run_color: Color, camera: CameraGeometry | None, few: bool = False
) -> None:
    """Log the static style of one row of the table, if its kind has one."""
    color, radius = row.rgb(run_color), rr.Radius.ui_points((few and row.few) or row.width)
    match row.kind:
        case Kind.POINTS:
            style: Any = rr.Points3D.from_fields(colors=color, radii=radius)
        case Kind.ARROWS:
            style = rr.Arrows3D.from_fields(colors=color, radii=radius)
        case Kind.LINES | Kind.TRAIL:
            style = rr.LineStrips3D.from_fields(colors=color, radii=radius)
        case Kind.BOXES:
            style = _boxes(color)
        case Kind.DOT:
            style = rr.Points3D([[0, 0, 0]], colors=color, radii=radius)
        case Kind.ELLIPSE:
            style = rr.LineStrips3D([UNIT_CIRCLE], colors=color, radii=radius)
        case Kind.CURVE:
            name = run if row.owner == "{run}" else row.owner
            name += ": threshold" if row is entities.N_EFF_LIMIT else ""
            keep = rr.components.AggregationPolicy[row.keep]
            style = rr.SeriesLines(
                colors=color, widths=row.width, names=name.replace("_", " "), aggregation_policy=keep
            )
        case Kind.MARKS:
            style = rr.SeriesPoints(
                colors=color, marker_sizes=row.width, markers="Circle", names=f"{run}: resampled".replace("_", " ")
            )
        case Kind.ROBOT:
            shape, outline = row.visible(run)
            sink.log_static(shape, _arrow_head(color))
            style = rr.LineStrips3D([np.vstack([ROBOT_OUTLINE, ROBOT_OUTLINE[:1]])], colors=color, radii=radius)
            sink.log_static(outline, style)
            return
        case Kind.CAMERA:
            if camera is not None:
                sink.log_static(row.path(run), *_camera(camera, color))
            return
        case _:
            return
    for path in row.visible(run):
        sink.log_static(path, style)


def _arrow_head(color: Color | None) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=ROBOT_OUTLINE,
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        vertex_normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        vertex_colors=np.tile([*(color or ()), 255], (4, 1)),
    )


def _camera(camera: CameraGeometry, color: Color | None) -> tuple[rr.Transform3D, rr.Pinhole]:
    pose, k = camera.robot_from_optical(), camera.intrinsics
    pinhole = rr.Pinhole(
        focal_length=[k.fx / IMAGE_SCALE, k.fy / IMAGE_SCALE],
        principal_point=[k.cx / IMAGE_SCALE, k.cy / IMAGE_SCALE],
        width=k.width // IMAGE_SCALE,
        height=k.height // IMAGE_SCALE,
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.8,
        color=color,
    )
    return rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), pinhole
