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
    """A rectangle of floor, in m: the views show it whole. ``outline`` (k, 2) are the things in it that lie outmost."""

    center: tuple[float, float]
    width: float
    height: float
    outline: Array

    @property
    def aspect(self) -> float:
        """Width by height."""
        return self.width / self.height

    @classmethod
    def of_box(cls, low: Array, high: Array, aspect: float = ASPECT, outline: Array | None = None) -> "Framing":
        """The box with a margin, widened to the aspect (width by height); the outline is its corners if not given."""
        center = (low + high) / 2
        across, up = (float(size) for size in np.maximum(high - low, 1.0) + 2 * MARGIN)
        width = max(across, up * aspect)
        if outline is None:
            outline = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])])
        return cls((float(center[0]), float(center[1])), width, width / aspect, outline)

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
        outline = _outline(results, low, high)
        reach = REACH * (high - low)
        lowest, highest = low - reach, high + reach
        for box in (_extent(results[0].dead_reckoning), _walls(results[0].dead_reckoning_grid)):
            if box is not None:
                low = np.minimum(low, np.maximum(box[0], lowest))
                high = np.maximum(high, np.minimum(box[1], highest))
        return cls.of_box(low, high, aspect, outline)


def aspect_of(panels: int) -> float:
    """Width by height of each of so many views beside each other in a window."""
    return ASPECT if panels <= 2 else 2 * ASPECT / panels


def _extent(poses: Array) -> tuple[Array, Array] | None:
    return (poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)) if len(poses) else None


def _walls(grid: OccupancyGrid) -> tuple[Array, Array] | None:
    positions = grid.wall_positions()
    if not len(positions):
        return None
    low, high = np.percentile(positions, OUTLIERS, axis=0)
    return low, high


def _outline(results: Sequence[Result], low: Array, high: Array) -> Array:
    """The outmost of the walls and trajectories inside a box, (k, 2): those that lie furthest in any direction."""
    points = [poses[:, :2] for r in results for poses in (r.online, r.estimate) if len(poses)]
    points += [r.grid.wall_positions() for r in results]
    every = np.concatenate(points)
    inside = every[((every >= low) & (every <= high)).all(axis=1)]
    angles = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray(inside[np.argmax(inside @ directions, axis=0)])


@dataclass(frozen=True, slots=True)
class Pointers:
    """Arrows at the edge of a framing, (n, 2) m each, to something that is ``beyond`` (n,) m outside; 0: inside."""

    origins: Array
    vectors: Array
    beyond: Array


POINTER, POINTERS = 0.08, 2000  # length as a share of the framing's height; so many moments at most
INSET = 0.05  # of the framing's height: how far inside of its edge the arrow ends


def out_of_view(framing: Framing, poses: Array) -> tuple[NDArray[np.intp], Pointers]:
    """The moments, rows of ``poses`` (m, 3), from which on an arrow holds, and the arrows: n each, of one at least."""
    inset = INSET * framing.height
    half = np.array([framing.width, framing.height]) / 2 - inset
    inside = np.clip(poses[:, :2], framing.center - half, framing.center + half)
    apart = poses[:, :2] - inside
    far = np.hypot(apart[:, 0], apart[:, 1])
    outside = far > inset
    changes = np.flatnonzero(np.diff(outside, prepend=False))
    every = max(len(poses) // POINTERS, 1)
    moments = np.flatnonzero(outside & (np.arange(len(poses)) % every == 0))
    rows = np.unique(np.concatenate([[0], changes, moments])).astype(np.intp)
    left, low = framing.center - half * np.array([0.4, 0.6])  # the scale bar lies in that corner
    inside[(inside[:, 0] < left) & (inside[:, 1] < low), 1] = low
    apart = poses[:, :2] - inside
    vectors = POINTER * framing.height * apart[rows] / np.maximum(np.hypot(*apart[rows].T), 1e-9)[:, None]
    beyond = np.where(outside[rows], far[rows] - inset, 0.0)
    return rows, Pointers(inside[rows] - vectors, vectors, beyond)


def round_length(most: float) -> float:
    """The longest of 1, 2 or 5 times a power of ten that is no longer than ``most``, in m."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(step for step in (1, 2, 5) if step * power <= most * (1 + 1e-9)))


PIXELS = 1000  # height of the overhead image; only its proportion to the floor matters


def overhead_size(aspect: float = ASPECT) -> tuple[int, int]:
    """Width and height in pixels of the overhead pinhole's image."""
    return round(PIXELS * aspect), PIXELS


def overhead_camera(
    center: tuple[float, float], height_on_floor: float, aspect: float = ASPECT, above: float | None = None
) -> tuple["rr.Transform3D", "rr.Pinhole"]:
    """A pinhole over ``center`` that sees ``height_on_floor`` m of z = 0 from top to bottom, y up, x to the right.

    It hangs ``above`` m over the floor: high enough to look straight down, low enough for the viewer's arithmetic. None
    takes 50 m, or the height of what it sees: from lower, lines at the edge would look thicker.
    A Spatial2DView whose origin it is shows the scene as a map that pans and zooms only.
    """
    import rerun as rr

    width, height = overhead_size(aspect)
    above = max(50.0, height_on_floor) if above is None else above
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
WINDOW = 1.6  # width by height of the 3-D view in a window of 1280 x 800 pixels or more
PITCH = np.radians(48.0)  # how far the eye looks down
FILL = 0.94  # share of the view that the building may fill
ROOF = 0.6  # m


def eye_on(framing: Framing, window: float = WINDOW) -> tuple[Array, Array]:
    """Where an eye is, and what it looks at, (3,) m each, so that it sees all of the framing's outline from above.

    It looks across the longer side, so that this lies along the window, from as near as a view of this width by height
    (or wider) allows, and puts what it sees in the middle of the view.
    """
    low, high = framing.outline.min(axis=0), framing.outline.max(axis=0)
    width, height = np.maximum(high - low, 1.0)
    back = np.array([1.0, 0.0]) if height > width else np.array([0.0, -1.0])  # from the content to the eye
    toward = np.array([*(np.cos(PITCH) * back), np.sin(PITCH)])
    right = np.array([-back[1], back[0], 0.0])
    up = np.cross(toward, right)
    corners = np.concatenate([np.insert(framing.outline, 2, z, axis=1) for z in (0.0, ROOF)])
    target = np.array([*((low + high) / 2), 0.0])
    distance, most = 4.0 * max(width, height), FILL * np.tan(VIEWING_ANGLE / 2)
    for _ in range(30):  # settles in a few
        seen = corners - target
        depth = distance - seen @ toward
        across, along = seen @ right / depth, seen @ up / depth
        aside, ahead = (across.min() + across.max()) / 2, (along.min() + along.max()) / 2
        target = target + 0.7 * distance * (aside * right + ahead * np.array([*(-back / np.sin(PITCH)), 0.0]))
        reach = max(np.ptp(across) / 2 / window, np.ptp(along) / 2)
        distance *= (reach / most) ** 0.7
    return target + distance * toward, target
