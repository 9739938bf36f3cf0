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
        points = []
        for k in chosen:
            ranges = recording.ranges[k].astype(np.float64)
            valid = (ranges >= lidar.range_min) & (ranges <= lidar.range_max)
            beams = np.stack([np.cos(lidar.angles), np.sin(lidar.angles)], axis=-1)[valid] * ranges[valid, None]
            points.append(geometry.transform(poses[k], geometry.transform(lidar.pose, beams)))
        seen = np.concatenate(points)
        low, high = np.percentile(seen if len(seen) else poses[:, :2], OUTLIERS, axis=0)
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


VIEWING_ANGLE = np.radians(55.0)  # Rerun's own, from top to bottom of a 3-D view
WINDOW = (1.55, 2.3)  # width by height of the 3-D view, in windows from 1280 x 800 to 1920 x 900 pixels
PITCH = np.radians(48.0)  # how far the eye looks down
FILL = 0.94  # share of the view that the building may fill
ROOF = 0.6  # m


def eye_on(framing: Framing) -> tuple[Array, Array]:
    """Where an eye is, and what it looks at, (3,) m each, so that it sees all of the framing's content from above.

    It looks across the longer side, so that this lies along the window, from as near as the narrowest window that
    :data:`WINDOW` names allows, and puts the content in the middle of the view.
    """
    width, height = framing.content
    back = np.array([1.0, 0.0]) if height > width else np.array([0.0, -1.0])  # from the content to the eye
    toward = np.array([*(np.cos(PITCH) * back), np.sin(PITCH)])
    right = np.array([-back[1], back[0], 0.0])
    up = np.cross(toward, right)
    sides = np.array([[x, y, z] for x in (-width, width) for y in (-height, height) for z in (0.0, 2 * ROOF)]) / 2
    corners = sides + np.array([*framing.center, 0.0])
    target = np.array([*framing.center, 0.0])
    distance, most = 4.0 * max(width, height), FILL * np.tan(VIEWING_ANGLE / 2)
    for _ in range(30):  # settles in a few
        seen = corners - target
        depth = distance - seen @ toward
        across, along = seen @ right / depth, seen @ up / depth
        middle = (along.min() + along.max()) / 2
        target = target + 0.7 * middle * distance * np.array([*(-back / np.sin(PITCH)), 0.0])
        reach = max(np.abs(across).max() / WINDOW[0], (along.max() - along.min()) / 2)
        distance *= (reach / most) ** 0.7
    return target + distance * toward, target
