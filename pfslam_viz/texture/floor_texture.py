"""A map of the floor's colours on the occupancy grid's cells."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz.robot import CameraGeometry
from pfslam_viz.settings import TextureConfig
from pfslam_viz.slam.tiles import Tiled, TiledArrays
from pfslam_viz.texture.floor_plane import FloorPlane
from pfslam_viz.texture.kernels import blend, collect, match, merge
from pfslam_viz.texture.kinect import FloorView


@dataclass(frozen=True, slots=True)
class Look:
    """What one frame shows of the floor: the sums of :func:`kernels.collect` in a ``patch`` (n, n, 4) of cells.

    Its cell [0, 0] is ``top``, ``left``, counted from the world origin's; ``box`` is the first and last row and column
    that were seen. ``tilted``: with a plane of its own.
    """

    patch: NDArray[np.float32]
    top: int
    left: int
    box: tuple[int, int, int, int]
    tilted: bool


class FloorTexture:
    """The colour of every floor cell that a camera has seen: section K, equations (35) to (38) and (24).

    Cells and frame are the occupancy grid's: row 0 is the top (largest y), column 0 the left, and ``origin`` holds the
    row and column of the cell at the world's origin.

    With ``config.blend`` "mean" a cell's colour is the mean of every pixel that ever fell into it. As a square metre of
    floor covers pixels in proportion to cos(view angle) / distance², that is a mean weighted by distance and view
    angle, but it follows the exposure, and many views from afar outvote a close one.

    With "finest" a frame's colours are first brought to those that are painted already (:func:`kernels.match`), and a
    cell keeps to its finest views (:func:`kernels.blend`). docs/texture.md has what else was tried.

    A texture that has outgrown :data:`~pfslam_viz.slam.tiles.MOST` cells is kept in tiles where something was painted,
    and ``color`` and ``weight`` are put together anew whenever they are asked for: look at :meth:`tiled` instead, where
    a texture may be large.

    Attributes:
        cell: edge of a cell in m.
        camera: what looks at the floor, its height counted from there.
        frames: how many frames were added,
        tilted: and how many of them with a plane of their own.
    """

    def __init__(self, camera: CameraGeometry, config: TextureConfig, cell: float) -> None:
        """``camera`` with its height counted from the floor; ``cell`` m."""
        self.cell = cell
        self.camera = camera
        self.view = FloorView.of(camera, config.floor_tolerance, config.max_range)
        self.frames = 0
        self.tilted = 0
        self._blend = config.blend == "finest"
        kinds: dict[str, Any] = {"weight": (np.float32, ()), "color": (np.uint8, (3,)), "sum": (np.float32, (3,))}
        self._cells = TiledArrays({**kinds, "finest": (np.float32, ())} if self._blend else kinds)
        self._side = 2 * math.ceil(self.view.reach / cell) + 3
        self._patches: list[NDArray[np.float32]] = []  # all 0, to be used again

    @property
    def color(self) -> NDArray[np.uint8]:
        """(rows, columns, 3) RGB; black where nothing was seen."""
        return self._whole("color")

    @property
    def weight(self) -> NDArray[np.float32]:
        """(rows, columns), how many pixels of the finest view's worth a cell got; 0 where it was not seen."""
        return self._whole("weight")

    @property
    def origin(self) -> tuple[int, int]:
        """Row and column of the cell at the world's origin, (24) and (25)."""
        if not self._cells.windowed:
            return self._cells.origin
        top, left, _, _ = self.tiled()[1].box()
        return -top, -left

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.weight.shape[0], self.weight.shape[1]

    def tiled(self) -> tuple[Tiled, Tiled]:
        """Colours and weights where something was painted, in tiles."""
        color, weight = self._cells.tiled("color", "weight")
        return color, weight

    def _whole(self, name: str) -> NDArray[Any]:
        if not self._cells.windowed:
            return self._cells.arrays[name]
        (tiled,) = self._cells.tiled(name)
        return tiled.dense(tiled.box())

    @property
    def lower_left(self) -> tuple[float, float]:
        """World position (m) of the lower left corner."""
        return -self.origin[1] * self.cell, (self.origin[0] - self.shape[0]) * self.cell

    @property
    def tilted_text(self) -> str:
        """Such as ``tilted in 12 of 183 frames, painted with planes of their own``."""
        return f"tilted in {self.tilted:,} of {self.frames:,} frames, painted with planes of their own"

    def add(self, disparity: NDArray[np.uint16], color: NDArray[np.uint8], pose: ArrayLike) -> int:
        """Paint what one frame shows of the floor; the number of cells it touched.

        Args:
            disparity: (480, 640) uint16, raw.
            color: (480, 640, 3) uint8 RGB.
            pose: (3,) the robot's in the world, when the disparity image was taken.

        Raises:
            ValueError: if an image is not of that shape and type.
        """
        return self.add_cropped(*self.view.crop(disparity, color), pose)

    def add_cropped(
        self,
        disparity: NDArray[np.uint16],
        color: NDArray[np.uint8],
        pose: ArrayLike,
        plane: FloorPlane | None = None,
    ) -> int:
        """The same for images as ``view.crop`` leaves them, and with the frame's own ``plane`` for the floor."""
        return self.paint(self.look(disparity, color, pose, plane))

    def look(
        self, disparity: NDArray[np.uint16], color: NDArray[np.uint8], pose: ArrayLike, plane: FloorPlane | None = None
    ) -> Look:
        """What such a frame shows of the floor, to be painted: changes nothing, and may be called on any thread."""
        x, y, heading = (float(v) for v in np.asarray(pose, dtype=np.float64))
        v = self.view if plane is None else self.view.over(self.camera, plane.pitch, plane.roll, plane.height)
        try:
            patch = self._patches.pop()
        except IndexError:
            patch = np.zeros((self._side, self._side, 4), np.float32)
        # The patch is a square of cells about the robot; its cell [0, 0] is this far from the world origin's cell.
        half = self._side // 2
        top, left = math.floor(-y / self.cell) - half, math.floor(x / self.cell) - half
        box = collect(
            patch, top, left, self.cell, disparity, color, x, y, math.cos(heading), math.sin(heading),
            v.by_row, v.by_column, v.position, v.tolerance, v.max_range,
            v.color_columns, v.color_rows, v.color_shift,
        )  # fmt: skip
        return Look(patch, top, left, box, plane is not None)

    def paint(self, look: Look) -> int:
        """Paint what a frame showed; the number of cells it touched. Once for each look, in the frames' order."""
        top, left, (first_row, last_row, first_column, last_column) = look.top, look.left, look.box
        self.frames += 1
        self.tilted += look.tilted
        if last_row < first_row:
            self._patches.append(look.patch)
            return 0
        self._cells.cover(top + first_row, left + first_column, top + last_row, left + last_column)
        seen = look.patch[first_row : last_row + 1, first_column : last_column + 1]
        row, column = top + first_row + self._cells.origin[0], left + first_column + self._cells.origin[1]
        here = slice(row, row + seen.shape[0]), slice(column, column + seen.shape[1])
        arrays = {name: values[here] for name, values in self._cells.arrays.items()}
        if not self._blend:
            touched: int = merge(seen, arrays["sum"], arrays["weight"], arrays["color"])
        else:
            gain = match(seen, arrays["sum"], arrays["weight"])
            touched = blend(seen, gain, arrays["sum"], arrays["weight"], arrays["finest"], arrays["color"])
        seen[:] = 0.0  # for a frame to come, which is less than to clear the whole patch
        self._patches.append(look.patch)
        return touched
