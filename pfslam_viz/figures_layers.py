"""What the figures show, as cells, trajectories and limits; drawing them is figures_drawing.py's."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.slam.map_picture import map_picture
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.viewer import colors

if TYPE_CHECKING:
    from pfslam_viz.texture.floor_texture import FloorTexture

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Color = tuple[int, int, int]  # RGB

DEAD_RECKONING: Color = colors.DEAD_RECKONING
FILTER: Color = colors.FILTER
TRUTH: Color = colors.TRUTH
PARTICLES: Color = colors.MISS  # one colour that stands out from the path; the viewer colours them by weight
FREE: Color = (255, 255, 255)
UNKNOWN: Color = (206, 210, 216)
WALL: Color = (28, 30, 36)
MOST_CELLS = 6_000_000  # of a layer: a picture has a million pixels
STRAY = 0.2  # % of wall cells on each side that may lie outside the picture: single beams out of a window
NARROWEST = 0.45  # a picture's shorter side over its longer one, at least


@dataclass(frozen=True, slots=True)
class Limits:
    """The piece of the world that is shown, m."""

    left: float
    right: float
    bottom: float
    top: float

    @classmethod
    def around(cls, *clouds: Array, pad: float = 1.0) -> "Limits":
        """The smallest limits that hold the points (m, 2) of all clouds, with ``pad`` m around them."""
        points = np.vstack([np.zeros((0, 2)), *clouds])
        if len(points) == 0:
            points = np.zeros((1, 2))
        low, high = points.min(axis=0) - pad, points.max(axis=0) + pad
        return cls(float(low[0]), float(high[0]), float(low[1]), float(high[1]))

    @property
    def width(self) -> float:
        """m"""
        return self.right - self.left

    @property
    def height(self) -> float:
        """m"""
        return self.top - self.bottom

    def shaped(self) -> "Limits":
        """The same, with the shorter side widened until it is not too short for a picture."""
        grow_x = max(0.0, NARROWEST * self.height - self.width) / 2
        grow_y = max(0.0, NARROWEST * self.width - self.height) / 2
        return Limits(self.left - grow_x, self.right + grow_x, self.bottom - grow_y, self.top + grow_y)


@dataclass(frozen=True, slots=True)
class Layer:
    """Cells cut to what is known.

    ``image`` (rows, columns, 3) RGB, ``alpha`` (rows, columns) 255 where known and else 0, ``walls`` (m, 2) m the
    centres of occupied cells, and where the upper left corner is in the world.
    """

    image: Image
    alpha: Image
    walls: Array
    cell: float
    upper_left: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Path2D:
    """A trajectory (n, 3) to draw, and what to call it."""

    poses: Array
    color: Color
    label: str


def grid_layer(grid: OccupancyGrid) -> Layer:
    """The log-odds as shades, copied: white is surely free, black surely occupied, and what is unknown is left out.

    Of a map of more than :data:`MOST_CELLS`, where its walls are, in larger cells if need be.
    """

    def shades(log_odds: NDArray[np.float32]) -> Image:
        sure = np.tanh(np.abs(log_odds.astype(np.float64)) / 2)[..., None]  # (28) once: 0.6; three times: 0.97
        end = np.where((log_odds < 0)[..., None], np.array(FREE), np.array(WALL))
        image = np.round(np.array(UNKNOWN) * (1 - sure) + end * sure)
        return np.dstack([image, np.where(log_odds != 0, 255, 0)]).astype(np.uint8)

    picture = map_picture(grid, shades, np.array([*UNKNOWN, 0], np.uint8), most=MOST_CELLS)
    return Layer(
        picture.values[..., :3], picture.values[..., 3], grid.wall_positions(), picture.cell, picture.upper_left
    )


def texture_layer(texture: "FloorTexture") -> Layer:
    """The painted cells, copied."""
    rows, columns = _span(texture.weight > 0)
    alpha = np.where(texture.weight[rows, columns] > 0, np.uint8(255), np.uint8(0))
    image = texture.color[rows, columns].copy()
    corner = _upper_left(texture.origin, texture.cell, rows, columns)
    return Layer(image, alpha, np.zeros((0, 2)), texture.cell, corner)


def map_limits(layer: Layer, *trajectories: Array) -> Limits:
    """Limits that show the walls of a map and whole trajectories (n, 3)."""
    walls = layer.walls
    if len(walls):
        walls = np.percentile(walls, [STRAY, 100 - STRAY], axis=0)
    return Limits.around(walls, *(poses[:, :2] for poses in trajectories))


def _span(known: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns that hold everything known; one cell if nothing is."""
    if not known.any():
        return slice(0, 1), slice(0, 1)
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _upper_left(origin: tuple[int, int], cell: float, rows: slice, columns: slice) -> tuple[float, float]:
    """World position (m) of the upper left corner of a cut: the inverse of (24) and (25)."""
    return (columns.start - origin[1]) * cell, (origin[0] - rows.start) * cell
