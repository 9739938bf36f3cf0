"""Which piece of floor the views show, and the pinholes that look straight down on it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.slam.occupancy_grid import OccupancyGrid

if TYPE_CHECKING:
    import rerun as rr

Array = NDArray[np.float64]

ASPECT = 1.4
"""Width by height of a view that shares the window with another one."""
MARGIN = 1.0  # m of floor shown around what there is to see
SAMPLED_SCANS = 150
OUTLIERS = (0.5, 99.5)  # per cent of the points that count: a beam through a window does not
REACH = 0.12  # how far dead reckoning may widen the picture of the filter's map, as a share of it


@dataclass(frozen=True, slots=True)
class Framing:
    """A rectangle of floor, in m: the views show it whole. ``content`` is how wide and high the things in it are."""

    center: tuple[float, float]
    width: float
    height: float
    content: tuple[float, float]

    @property
    def aspect(self) -> float:
        """Width by height."""
        return self.width / self.height

    @classmethod
    def of_box(cls, low: Array, high: Array, aspect: float = ASPECT) -> "Framing":
        """The box with a margin, widened to the aspect (width by height)."""
        center = (low + high) / 2
        across, up = (float(size) for size in np.maximum(high - low, 1.0) + 2 * MARGIN)
        width = max(across, up * aspect)
        return cls((float(center[0]), float(center[1])), width, width / aspect, (across, up))

    @classmethod
    def of_recording(cls, recording: Recording, aspect: float = ASPECT) -> "Framing":
        """What can be known before the run: where the scans fall from dead reckoning."""
        poses = recording.dead_reckoning()
        lidar = recording.lidar
        chosen = np.unique(np.linspace(0, len(poses) - 1, SAMPLED_SCANS).astype(int))
        points = [poses[:, :2]]
        for k in chosen:
            ranges = recording.ranges[k].astype(np.float64)
            valid = (ranges >= lidar.range_min) & (ranges <= lidar.range_max)
            beams = np.stack([np.cos(lidar.angles), np.sin(lidar.angles)], axis=-1)[valid] * ranges[valid, None]
            points.append(geometry.transform(poses[k], geometry.transform(lidar.pose, beams)))
        low, high = np.percentile(np.concatenate(points[1:]), OUTLIERS, axis=0)
        return cls.of_box(np.minimum(low, poses[:, :2].min(axis=0)), np.maximum(high, poses[:, :2].max(axis=0)), aspect)

    @classmethod
    def of_results(cls, results: Sequence[Result], aspect: float = ASPECT) -> "Framing":
        """What the run found: the filter's walls, every trajectory, and dead reckoning as far as that is bearable."""
        boxes = [_walls(result.grid) for result in results]
        boxes += [_extent(poses) for r in results for poses in (r.online, r.estimate, r.truth) if poses is not None]
        low = np.min([box[0] for box in boxes if box is not None], axis=0)
        high = np.max([box[1] for box in boxes if box is not None], axis=0)
        reach = REACH * (high - low)
        lowest, highest = low - reach, high + reach
        for box in (_extent(results[0].dead_reckoning), _walls(results[0].dead_reckoning_grid)):
            if box is not None:
                low = np.minimum(low, np.maximum(box[0], lowest))
                high = np.maximum(high, np.minimum(box[1], highest))
        return cls.of_box(low, high, aspect)


def aspect_of(panels: int) -> float:
    """Width by height of each of so many views beside each other in a window."""
    return ASPECT if panels <= 2 else 2 * ASPECT / panels


def _extent(poses: Array) -> tuple[Array, Array] | None:
    return (poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)) if len(poses) else None


def _walls(grid: OccupancyGrid) -> tuple[Array, Array] | None:
    cells = np.argwhere(grid.occupied)
    if not len(cells):
        return None
    low, high = np.percentile(grid.centers(cells), OUTLIERS, axis=0)
    return low, high


PIXELS = 1000  # height of the overhead image; only its proportion to the floor matters


def overhead_size(aspect: float = ASPECT) -> tuple[int, int]:
    """Width and height in pixels of the overhead pinhole's image."""
    return round(PIXELS * aspect), PIXELS


def overhead_camera(
    center: tuple[float, float], height_on_floor: float, aspect: float = ASPECT, above: float = 50.0
) -> tuple["rr.Transform3D", "rr.Pinhole"]:
    """A pinhole over ``center`` that sees ``height_on_floor`` m of z = 0 from top to bottom, y up, x to the right.

    It hangs ``above`` m over the floor: high enough to look straight down, low enough for the viewer's arithmetic.
    A Spatial2DView whose origin it is shows the scene as a map that pans and zooms only.
    """
    import rerun as rr

    width, height = overhead_size(aspect)
    down = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]
    return (
        rr.Transform3D(translation=[*center, above], mat3x3=down),
        rr.Pinhole(
            focal_length=height * above / height_on_floor,
            width=width,
            height=height,
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=above,
            line_width=0.0,
        ),
    )
