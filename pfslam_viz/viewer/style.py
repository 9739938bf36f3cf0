"""What is logged once: colours, widths, the robot's shape, the cameras that look down."""

import numpy as np
import rerun as rr

from pfslam_viz.recordings.recording import Frames, Recording
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.entities import Color, Entities
from pfslam_viz.viewer.framing import Framing, overhead_camera
from pfslam_viz.viewer.sinks import Sink

FOLLOW_HEIGHT = 9.0  # m of floor that the close-up shows
LOUPE_HEIGHTS = (0.15, 2.0)  # m of floor that the particles' own view shows, by how far they spread
IMAGE_SCALE = 2  # camera images are reduced by this

ROBOT_OUTLINE = np.array([[0.55, 0, 0], [-0.3, 0.3, 0], [-0.15, 0, 0], [-0.3, -0.3, 0]])
"""m: an arrow head along x, about as large as the robot."""

CURVES = ("drift", "heading_drift", "error", "n_eff", "spread", "correlation", "score", "correction", "lineages")


def style_run(sink: Sink, paths: Entities, color: Color, frames: Frames | None) -> None:
    """Style what one run draws."""
    path, ui = paths.filter, rr.Radius.ui_points
    sink.log_static(path("particles"), rr.Points3D.from_fields(radii=ui(2.0)))
    wall = rr.Boxes3D.from_fields(colors=entities.WALL, fill_mode=rr.components.FillMode.Solid)
    sink.log_static(path("walls"), wall)
    sink.log_static(path("headings"), rr.Arrows3D.from_fields(radii=ui(0.75)))
    sink.log_static(path("scan/hit"), rr.Points3D.from_fields(colors=entities.HIT, radii=ui(1.75)))
    sink.log_static(path("scan/miss"), rr.Points3D.from_fields(colors=entities.MISS, radii=ui(1.75)))
    sink.log_static(path("correction"), rr.Arrows3D.from_fields(colors=entities.MISS, radii=ui(1.5)))
    for name, line, width in (
        ("degenerate", entities.MISS, 1.5),
        ("lineages", entities.LINEAGE, 0.5),
        ("history", entities.HINDSIGHT, 1.0),
        ("closures", entities.HINDSIGHT, 1.5),
        ("hindsight", entities.HINDSIGHT, 1.5),
    ):
        sink.log_static(path(name), rr.LineStrips3D.from_fields(colors=line, radii=ui(width)))
    _style_trail(sink, path("trajectory"), color)
    _style_robot(sink, path("robot"), color)
    sink.log_static(path("mean"), rr.Points3D([[0, 0, 0]], colors=color, radii=ui(4.0)))
    angle = np.linspace(0.0, 2 * np.pi, 65)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    sink.log_static(path("covariance"), rr.LineStrips3D([circle], colors=color, radii=ui(1.25)))
    sink.log_static(path("follow/close_up"), *overhead_camera((0.0, 0.0), FOLLOW_HEIGHT, aspect=1.0, above=5.0))
    log_loupe(sink, paths, None)
    if frames is not None:
        _style_camera(sink, path("robot/camera"), frames, color)
    for plot in CURVES:
        _style_curve(sink, paths.plot(plot), color, paths.run)


def style_shared(sink: Sink, recording: Recording) -> None:
    """Style what all runs share: dead reckoning and truth."""
    root, color = "world/dead_reckoning", entities.DEAD_RECKONING
    scan = rr.Points3D.from_fields(colors=color, radii=rr.Radius.ui_points(1.75))
    sink.log_static(f"{root}/scan", scan)
    _style_trail(sink, f"{root}/trajectory", color)
    _style_robot(sink, f"{root}/robot", color)
    _style_curve(sink, "plots/error/dead_reckoning", color, "dead reckoning")
    if recording.truth is not None:
        _style_trail(sink, "world/truth/trajectory", entities.TRUTH, width=0.75)  # a thin line on the estimates
        _style_robot(sink, "world/truth/robot", entities.TRUTH)


def log_framing(sink: Sink, framing: Framing) -> None:
    """Point the overview's camera at a piece of floor."""
    sink.log_static(entities.OVERVIEW, *overhead_camera(framing.center, framing.height, framing.aspect))


def log_loupe(sink: Sink, paths: Entities, spread: float | None) -> None:
    """Let the particles' own view show what a cloud of this standard deviation (m; None: not known yet) needs."""
    height = 1.0 if spread is None else float(np.clip(12.0 * spread, *LOUPE_HEIGHTS))
    sink.log_static(paths.filter("follow/loupe"), *overhead_camera((0.0, 0.0), height, aspect=1.0, above=5.0))


def log_page(sink: Sink, path: str, text: str) -> None:
    """A markdown page."""
    sink.log_static(path, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))


def _style_trail(sink: Sink, path: str, color: Color, width: float = 1.75) -> None:
    for part in ("done", "open"):
        line = rr.LineStrips3D.from_fields(colors=color, radii=rr.Radius.ui_points(width))
        sink.log_static(f"{path}/{part}", line)


def _style_robot(sink: Sink, path: str, color: Color) -> None:
    shape = rr.Mesh3D(
        vertex_positions=ROBOT_OUTLINE,
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        vertex_normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        vertex_colors=np.tile([*color, 255], (4, 1)),
    )
    sink.log_static(f"{path}/shape", shape)
    outline = np.vstack([ROBOT_OUTLINE, ROBOT_OUTLINE[:1]])
    sink.log_static(f"{path}/outline", rr.LineStrips3D([outline], colors=color, radii=rr.Radius.ui_points(1.5)))


def _style_curve(sink: Sink, path: str, color: Color, name: str) -> None:
    sink.log_static(path, rr.SeriesLines(colors=color, widths=1.5, names=name.replace("_", " ")))


def _style_camera(sink: Sink, path: str, frames: Frames, color: Color) -> None:
    camera = frames.camera
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
    sink.log_static(path, rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), pinhole)
