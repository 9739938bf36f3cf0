"""A map or a floor texture with trajectories, axes in metres, scale bar and legend, drawn with matplotlib.

matplotlib is the extra ``figures``: import this module only where a figure is drawn. Sizes are in pixels of the
picture, which are matplotlib's points here.
"""

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Patch
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import Affine2D
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from pfslam_viz.figures_layers import FREE, PARTICLES, UNKNOWN, WALL, Array, Color, Image, Layer, Limits, Path2D

INK, FAINT, FRAME = "#22262e", "#6e747e", "#969ca6"
WALL_BY_TEXTURE: Color = (120, 126, 136)

LARGEST = (1240, 900)  # the axes, width and height
LEFT, RIGHT, TOP, BOTTOM, LEGEND_ROW = 84, 28, 84, 58, 26  # around the axes
LEGEND_COLUMN = 150
DPI = 72  # a point is a pixel

# Arrowhead along x, its tip at 1.
ARROWHEAD = np.array([[1.0, 0.0], [-0.69, 0.58], [-0.4, 0.0], [-0.69, -0.58], [1.0, 0.0]])


class Picture:
    """Axes that show ``limits``, to draw layers and trajectories on; :meth:`finish` adds what goes around.

    The picture's size follows from the limits and the number of legend entries alone.
    """

    def __init__(self, limits: Limits, background: Color, entries: int) -> None:
        self.limits = limits.shaped()
        self.scale = min(LARGEST[0] / self.limits.width, LARGEST[1] / self.limits.height)  # pixels a metre
        width, height = round(self.limits.width * self.scale), round(self.limits.height * self.scale)
        self.legend_columns = max(1, (width + LEFT) // LEGEND_COLUMN)
        bottom = BOTTOM + LEGEND_ROW * math.ceil(entries / self.legend_columns)
        size = width + LEFT + RIGHT, height + TOP + bottom
        self.figure = Figure((size[0] / DPI, size[1] / DPI), DPI, facecolor="white")
        place = LEFT / size[0], bottom / size[1], width / size[0], height / size[1]
        self.axes: Axes = self.figure.add_axes(place, facecolor=_rgb(background))
        self.axes.set_xlim(self.limits.left, self.limits.right)
        self.axes.set_ylim(self.limits.bottom, self.limits.top)
        self.axes.set_autoscale_on(False)
        self._entries: list[Artist] = []

    def cells(self, layer: Layer) -> None:
        """Lay known cells on the axes, over what is there."""
        (rows, columns), (left, top) = layer.alpha.shape, layer.upper_left
        extent = (left, left + columns * layer.cell, top - rows * layer.cell, top)
        # Cells of less than a pixel are averaged: single ones picked would lose thin walls.
        smooth = "antialiased" if layer.cell * self.scale < 1 else "nearest"
        colors = np.dstack([layer.image, layer.alpha])
        self.axes.imshow(colors, extent=extent, interpolation=smooth, aspect="auto", zorder=0.5)

    def path(self, path: Path2D, width: float, casing: bool = False) -> None:
        """A trajectory; with ``casing`` edged in white."""
        (line,) = self.axes.plot(*path.poses[:, :2].T, color=_rgb(path.color), linewidth=width, label=path.label)
        line.set_solid_joinstyle("round")
        if casing:
            line.set_path_effects([withStroke(linewidth=width + 2.5, foreground="white")])
        entry = Line2D([], [], color=_rgb(path.color), linewidth=3, label=path.label)
        self._entries.insert(0, entry)  # the one on top first

    def ends(self, path: Path2D, size: float = 28.0) -> None:
        """A ring where the trajectory begins, and an arrowhead of ``size`` pixels at its end, along the heading."""
        self._marker(path.poses[0, :2], MarkerStyle("o"), 10, "white", _rgb(path.color), 2.5, "start")
        heading = Affine2D().rotate(float(path.poses[-1, 2]))
        head = MarkerStyle(Outline(ARROWHEAD), transform=heading)
        self._marker(path.poses[-1, :2], head, size, _rgb(path.color), "white", 1.2, "robot")
        self._entries[-1].set_marker(Outline(ARROWHEAD))  # type: ignore[attr-defined]  # level in the legend

    def dots(self, points: Array, color: Color, label: str, size: float = 3.0) -> None:
        """A dot for each of the points (m, 2), ``size`` pixels wide."""
        dots = {"linestyle": "", "marker": "o", "markeredgewidth": 0, "color": _rgb(color)}
        self.axes.plot(*points.T, markersize=size, zorder=5, **dots)  # type: ignore[arg-type]
        self._entries.append(Line2D([], [], markersize=6, label=label, **dots))  # type: ignore[arg-type]

    def patch(self, color: Color, label: str) -> None:
        """A legend entry for cells of a colour."""
        self._entries.append(Patch(facecolor=_rgb(color), edgecolor=FRAME, label=label))

    def finish(self, title: str, subtitle: str) -> Image:
        """The whole picture (rows, columns, 3) RGB, with title, axes, scale bar and legend."""
        width, height = self.figure.get_size_inches() * DPI
        self.figure.text(LEFT / width, 1 - 38 / height, title, fontsize=20, color=INK, weight="bold", parse_math=False)
        self.figure.text(LEFT / width, 1 - 66 / height, subtitle, fontsize=13, color=FAINT, parse_math=False)
        axes = self.axes
        axes.set_xlabel("x (m)", fontsize=13, color=INK)
        axes.set_ylabel("y (m)", fontsize=13, color=INK)
        step = nice_step(max(self.limits.width, self.limits.height) / 9)
        axes.xaxis.set_major_locator(MultipleLocator(step))
        axes.yaxis.set_major_locator(MultipleLocator(step))
        axes.tick_params(labelsize=12, color=FRAME, labelcolor=FAINT, length=6)
        axes.grid(color=FRAME, alpha=0.25, linewidth=1)
        axes.set_axisbelow(True)
        for spine in axes.spines.values():
            spine.set_color(FRAME)
        length = nice_step(self.limits.width / 10)
        bar = AnchoredSizeBar(
            axes.transData, length, f"{length:g} m", "lower right", pad=0.5, color=INK, sep=5, borderpad=0.7,
            size_vertical=5 / self.scale, label_top=True, fontproperties={"size": 12},
        )  # fmt: skip
        bar.patch.set(facecolor="white", alpha=0.8, linewidth=0)
        axes.add_artist(bar)
        self.figure.legend(
            handles=self._entries, loc="lower left", bbox_to_anchor=(LEFT / width, 4 / height),
            ncols=self.legend_columns, fontsize=13, frameon=False, borderpad=0, borderaxespad=0, handlelength=2.2,
            labelcolor=INK,
        )  # fmt: skip
        canvas = FigureCanvasAgg(self.figure)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph")  # a name in a script that the font lacks: boxes, and no remark
            canvas.draw()  # type: ignore[no-untyped-call]
        return np.array(canvas.buffer_rgba(), np.uint8)[..., :3]  # type: ignore[no-untyped-call]

    def _marker(
        self, at: Array, marker: MarkerStyle, size: float, face: object, edge: object, edge_width: float, label: str
    ) -> None:
        look = {
            "linestyle": "", "marker": marker, "markersize": size, "markerfacecolor": face, "markeredgecolor": edge,
            "markeredgewidth": edge_width,
        }  # fmt: skip
        self.axes.plot(*at, zorder=4, **look)  # type: ignore[arg-type]
        self._entries.append(Line2D([], [], label=label, **look))  # type: ignore[arg-type]


def draw_map(
    limits: Limits,
    grid: Layer,
    paths: Sequence[Path2D],
    title: str,
    subtitle: str,
    particles: Array | None = None,
) -> Image:
    """A map with trajectories, the last one on top and with the robot at its end; RGB (rows, columns, 3)."""
    with style.context("default"):  # whatever the user's matplotlibrc says
        picture = Picture(limits, UNKNOWN, len(paths) + 5 + (particles is not None))
        picture.cells(grid)
        for path in paths:
            picture.path(path, 2.2)
        picture.ends(paths[-1])
        if particles is not None:
            picture.dots(particles, PARTICLES, "particles")
        for color, label in ((WALL, "occupied"), (FREE, "free"), (UNKNOWN, "unknown")):
            picture.patch(color, label)
        return picture.finish(title, subtitle)


def draw_texture(limits: Limits, grid: Layer, texture: Layer, path: Path2D, title: str, subtitle: str) -> Image:
    """The floor's colours with the walls around them for orientation; RGB (rows, columns, 3)."""
    dark = grid.image.max(axis=2) < np.mean(UNKNOWN) / 2
    flat = np.broadcast_to(np.array(WALL_BY_TEXTURE, np.uint8), grid.image.shape)
    walls = replace(grid, image=flat, alpha=np.where(dark, grid.alpha, np.uint8(0)))
    with style.context("default"):
        picture = Picture(limits, FREE, 4)
        picture.cells(texture)
        picture.cells(walls)
        picture.path(path, 1.6, casing=True)
        picture.ends(path)
        picture.patch(WALL_BY_TEXTURE, "occupied")
        return picture.finish(title, subtitle)


def nice_step(rough: float) -> float:
    """The smallest of 1, 2, 5 x 10^k that is at least ``rough`` > 0."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * (1 - 1e-9))


def _rgb(color: Color) -> tuple[float, float, float]:
    """As matplotlib has it, 0 to 1."""
    return color[0] / 255, color[1] / 255, color[2] / 255
