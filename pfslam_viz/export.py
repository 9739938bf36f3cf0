"""A run's results as files that other tools read: TUM trajectories, a ROS map, and metrics."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import console
from pfslam_viz.files import replaced
from pfslam_viz.outputs import check_export
from pfslam_viz.replay import Result
from pfslam_viz.slam.map_picture import MapPicture, map_picture
from pfslam_viz.slam.occupancy_grid import OccupancyGrid

Array = NDArray[np.float64]

OCCUPIED, FREE, UNKNOWN = 0, 254, 205  # map_server's own values of a pixel
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196  # (255 - 205) / 255 = 0.1961 lies between them: unknown
MOST_PIXELS = 64_000_000  # of the map's image: a square of 400 m in cells of 0.05 m
BORDER = 2  # unknown cells kept around what is known


def export(result: Result, out: Path, metrics: Mapping[str, Any]) -> list[Path]:
    """Write a run into the folder ``out`` and return the files.

    ``estimate.tum`` (the whole trajectory as known at the end), ``online.tum`` (each pose as it was estimated then),
    ``dead_reckoning.tum``, and ``truth.tum`` where it is known: a pose of the robot frame for every scan at the
    recording's own stamp, in the frame of the first pose. ``map.pgm`` and ``map.yaml`` for ROS map_server.
    ``metrics.json`` holds ``metrics``. A file is complete or not there; raises InputError if it cannot be written, or
    if a file of one of these names is there that is none of ours.
    """
    check_export(out)
    trajectories = {
        "estimate": result.estimate,
        "online": result.online,
        "dead_reckoning": result.dead_reckoning,
        "truth": result.truth,
    }
    written = []
    for name, poses in trajectories.items():
        if poses is not None:
            written.append(write_tum(out / f"{name}.tum", result.stamps, poses))
    written += write_map(out / "map.pgm", result.grid)
    path = out / "metrics.json"
    with replaced(path) as temporary:
        temporary.write_text(json.dumps(metrics, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return [*written, path]


def write_tum(path: Path, stamps: Array, poses: Array) -> Path:
    """Write ``poses`` (n, 3) at ``stamps`` (n,) s as lines ``stamp x y z qx qy qz qw``; stamps keep every digit."""
    half = poses[:, 2] / 2
    lines = [
        f"{np.format_float_positional(stamp, trim='-')} {x:.9f} {y:.9f} 0 0 0 {qz:.12f} {qw:.12f}\n"
        for stamp, x, y, qz, qw in zip(stamps, poses[:, 0], poses[:, 1], np.sin(half), np.cos(half), strict=True)
    ]
    with replaced(path) as temporary:
        temporary.write_text("".join(lines), encoding="ascii")
    return path


def write_map(path: Path, grid: OccupancyGrid) -> list[Path]:
    """Write the grid as the image ``path`` (.pgm) and, beside it, the .yaml that ROS map_server loads.

    Cut to what is known and a small border; a map of more than 64 million cells is cut to where its walls are, in
    larger cells if need be, and a line on stderr says so. The yaml's origin is the world position of the lower left
    pixel's corner.
    """
    picture = _picture(grid)
    image, (left, bottom) = picture.values, picture.lower_left
    if picture.note:
        console.tell(f"note: {path}: {picture.note}")
    rows, columns = image.shape
    with replaced(path) as temporary:
        temporary.write_bytes(b"P5\n%d %d\n255\n" % (columns, rows) + image.tobytes())
    yaml = path.with_suffix(".yaml")
    with replaced(yaml) as temporary:
        temporary.write_text(
            f"image: {path.name}\n"
            "mode: trinary\n"
            f"resolution: {picture.cell:.9g}\n"
            f"origin: [{left:.9f}, {bottom:.9f}, 0.0]\n"
            "negate: 0\n"
            f"occupied_thresh: {OCCUPIED_THRESHOLD}\n"
            f"free_thresh: {FREE_THRESHOLD}\n",
            encoding="ascii",
        )
    return [path, yaml]


def map_image(grid: OccupancyGrid) -> tuple[NDArray[np.uint8], tuple[float, float]]:
    """The grid as pixels (rows, columns), top row first, and the world position (m) of the lower left corner."""
    picture = _picture(grid)
    return picture.values, picture.lower_left


def _picture(grid: OccupancyGrid) -> MapPicture:
    def pixels(log_odds: NDArray[np.float32]) -> NDArray[np.uint8]:
        image = np.full(log_odds.shape, UNKNOWN, np.uint8)
        image[log_odds < 0] = FREE
        image[log_odds > grid.threshold] = OCCUPIED
        return image

    return map_picture(grid, pixels, np.array(UNKNOWN, np.uint8), most=MOST_PIXELS, border=BORDER)
