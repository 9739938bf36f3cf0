"""A picture of a piece of the world with axes in metres, drawn with OpenCV.

Everything is drawn at twice its final size and halved at the end, which smooths text, lines and map cells alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Color = tuple[int, int, int]  # RGB

WHITE: Color = (255, 255, 255)
INK: Color = (34, 38, 46)
FAINT: Color = (110, 116, 126)
FRAME: Color = (150, 156, 166)

OVERSAMPLING = 2
LARGEST = (1240, 900)  # final pixels of the plot itself, width and height
NARROWEST = 0.45  # the plot's shorter side over its longer one, at least
LEFT, RIGHT, TOP, BOTTOM, LEGEND_ROW = 84, 28, 84, 66, 30  # final pixels around the plot
FONT = cv2.FONT_HERSHEY_SIMPLEX
SUBPIXEL = 4  # fractional bits of the coordinates that OpenCV draws at


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
class Key:
    """A line of the legend: how it looks (``line``, ``patch``, ``ring``, ``dot`` or ``robot``), and what it says."""

    look: str
    color: Color
    label: str


class Plot:
    """Draw the world into it, lowest layer first; then :meth:`finish` adds what goes around."""

    def __init__(self, limits: Limits, background: Color = WHITE) -> None:
        self.limits = limits.shaped()
        self.scale = min(LARGEST[0] / self.limits.width, LARGEST[1] / self.limits.height)  # final pixels a metre
        width, height = round(self.limits.width * self.scale), round(self.limits.height * self.scale)
        self._zoom = self.scale * OVERSAMPLING
        self._area = np.empty((height * OVERSAMPLING, width * OVERSAMPLING, 3), np.uint8)
        self._area[:] = background

    def cells(self, image: Image, cell: float, upper_left: tuple[float, float], alpha: Image | None = None) -> None:
        """Lay cells (rows, columns, 3) of edge ``cell`` m on the plot, their upper left corner at that position.

        ``alpha`` (rows, columns), 0 to 255, is how much of each covers what is there; without it they cover it.
        """
        zoom = cell * self._zoom
        x, y = self._pixels(np.array([upper_left]))[0]
        # warpAffine speaks of pixel centres: cell (0, 0)'s centre is half a cell in.
        matrix = np.array([[zoom, 0, x + (zoom - 1) / 2], [0, zoom, y + (zoom - 1) / 2]])
        size = (self._area.shape[1], self._area.shape[0])
        method = cv2.INTER_NEAREST if zoom >= 1 else cv2.INTER_AREA
        cover = alpha if alpha is not None else np.full(image.shape[:2], 255, np.uint8)
        if zoom < 1:  # shrink by averaging first: picking single cells would lose thin walls
            shrunk = (max(1, round(image.shape[1] * zoom)), max(1, round(image.shape[0] * zoom)))
            exact_x, exact_y = image.shape[1] * zoom / shrunk[0], image.shape[0] * zoom / shrunk[1]
            image = cv2.resize(image, shrunk, interpolation=method).astype(np.uint8)
            cover = cv2.resize(cover, shrunk, interpolation=method).astype(np.uint8)
            matrix = np.array([[exact_x, 0, x + (exact_x - 1) / 2], [0, exact_y, y + (exact_y - 1) / 2]])
        placed = cv2.warpAffine(image, matrix, size, flags=cv2.INTER_NEAREST)
        weight = cv2.warpAffine(cover, matrix, size, flags=cv2.INTER_NEAREST)[..., None] / np.float32(255)
        self._area = (placed * weight + self._area * (1 - weight) + 0.5).astype(np.uint8)

    def line(self, points: Array, color: Color, width: float = 2.0, casing: bool = False) -> None:
        """A polyline through points (m, 2), ``width`` final pixels wide; with ``casing`` edged in white."""
        if len(points) < 2:
            return
        at = self._fixed(points)[:, None]
        if casing:
            cv2.polylines(self._area, [at], False, WHITE, self._thick(width + 2.5), cv2.LINE_AA, SUBPIXEL)
        cv2.polylines(self._area, [at], False, color, self._thick(width), cv2.LINE_AA, SUBPIXEL)

    def dots(self, points: Array, color: Color, radius: float = 1.5) -> None:
        """A dot for each of the points (m, 2), ``radius`` in final pixels."""
        for x, y in self._fixed(points).tolist():
            _disc(self._area, (x, y), radius, color)

    def ring(self, point: Array, color: Color, radius: float = 6.0) -> None:
        """A white disc with a coloured edge: where a drive begins."""
        x, y = self._fixed(np.asarray(point)[None, :2])[0].tolist()
        _ring(self._area, (x, y), radius, color)

    def robot(self, pose: Array, color: Color, size: float = 11.0) -> None:
        """An arrowhead at ``pose`` (3,) that points where the robot looks, ``size`` final pixels from tip to centre."""
        x, y = self._fixed(np.asarray(pose)[None, :2])[0].tolist()
        _robot(self._area, (x, y), float(pose[2]), size, color)

    def finish(self, title: str, subtitle: str = "", legend: Sequence[Key] = ()) -> Image:
        """The whole picture (rows, columns, 3) RGB, with title, axes, scale bar and legend."""
        height, width = self._area.shape[:2]
        rows = _legend_rows(legend, (width // OVERSAMPLING))
        bottom = BOTTOM + LEGEND_ROW * len(rows)
        s = OVERSAMPLING
        page = np.full((height + (TOP + bottom) * s, width + (LEFT + RIGHT) * s, 3), 255, np.uint8)
        self._grid_lines()
        self._scale_bar()
        page[TOP * s : TOP * s + height, LEFT * s : LEFT * s + width] = self._area
        corner, opposite = (LEFT * s - 1, TOP * s - 1), (LEFT * s + width, TOP * s + height)
        cv2.rectangle(page, corner, opposite, FRAME, s)
        _text(page, title, (LEFT, 38), 0.82, INK, weight=2)
        _text(page, subtitle, (LEFT, 66), 0.52, FAINT)
        self._axes(page, TOP + height // s)
        for k, row in enumerate(rows):
            _draw_legend(page, row, TOP + height // s + BOTTOM + LEGEND_ROW * k + 4)
        small = (page.shape[1] // s, page.shape[0] // s)
        return np.asarray(cv2.resize(page, small, interpolation=cv2.INTER_AREA), np.uint8)

    def _pixels(self, points: Array) -> Array:
        """Oversampled pixel coordinates (m, 2), x then y, of world points (m, 2)."""
        p = np.asarray(points, dtype=np.float64)
        x = (p[:, 0] - self.limits.left) * self._zoom
        return np.stack([x, (self.limits.top - p[:, 1]) * self._zoom], axis=-1)

    def _fixed(self, points: Array) -> NDArray[np.int32]:
        """The same as fixed-point numbers for OpenCV, kept within what it can draw."""
        at = (self._pixels(points) - 0.5) * 2**SUBPIXEL
        return np.clip(np.round(at), -(2**26), 2**26).astype(np.int32)

    def _thick(self, width: float) -> int:
        return max(1, round(width * OVERSAMPLING))

    def _ticks(self) -> tuple[Array, Array, int]:
        """Round positions on x and on y, and how many decimals they need."""
        step = nice_step(max(self.limits.width, self.limits.height) / 9)
        first_x, first_y = math.ceil(self.limits.left / step), math.ceil(self.limits.bottom / step)
        x = step * np.arange(first_x, math.floor(self.limits.right / step) + 1, dtype=np.float64)
        y = step * np.arange(first_y, math.floor(self.limits.top / step) + 1, dtype=np.float64)
        return x, y, max(0, -math.floor(math.log10(step)))

    def _grid_lines(self) -> None:
        x, y, _ = self._ticks()
        layer = self._area.copy()
        for column, _ in np.round(self._pixels(np.stack([x, np.zeros_like(x)], axis=-1))).astype(int):
            cv2.line(layer, (int(column), 0), (int(column), layer.shape[0]), FRAME, OVERSAMPLING)
        for _, row in np.round(self._pixels(np.stack([np.zeros_like(y), y], axis=-1))).astype(int):
            cv2.line(layer, (0, int(row)), (layer.shape[1], int(row)), FRAME, OVERSAMPLING)
        cv2.addWeighted(layer, 0.22, self._area, 0.78, 0, self._area)

    def _axes(self, page: Image, floor: int) -> None:
        s = OVERSAMPLING
        x, y, decimals = self._ticks()
        for value in x:
            at = LEFT + (value - self.limits.left) * self.scale
            cv2.line(page, (round(at * s), floor * s), (round(at * s), (floor + 6) * s), FRAME, s)
            _text(page, f"{value + 0.0:.{decimals}f}", (at, floor + 25), 0.48, FAINT, anchor="middle")
        for value in y:
            at = TOP + (self.limits.top - value) * self.scale
            cv2.line(page, ((LEFT - 6) * s, round(at * s)), (LEFT * s, round(at * s)), FRAME, s)
            _text(page, f"{value + 0.0:.{decimals}f}", (LEFT - 12, at + 5), 0.48, FAINT, anchor="end")
        centre = LEFT + self.limits.width * self.scale / 2
        _text(page, "x (m)", (centre, floor + 50), 0.52, INK, anchor="middle")
        strip = np.full((page.shape[1], page.shape[0], 3), 255, np.uint8)  # written level, then turned to read upwards
        _text(strip, "y (m)", (page.shape[0] / s - (TOP + floor) / 2, 24), 0.52, INK, anchor="middle")
        turned = cv2.rotate(strip, cv2.ROTATE_90_COUNTERCLOCKWISE)
        page[:, : 34 * s] = np.minimum(page[:, : 34 * s], turned[:, : 34 * s])

    def _scale_bar(self) -> None:
        """A bar of a round length, a tenth to a quarter of the width, in the lower right corner."""
        s = OVERSAMPLING
        length = nice_step(self.limits.width / 10)
        height, width = self._area.shape[:2]
        x1, y = width - 22 * s, height - 22 * s
        x0 = round(x1 - length * self._zoom)
        patch = self._area[y - 34 * s : y + 13 * s, x0 - 13 * s : x1 + 13 * s]
        patch[:] = (patch * 0.2 + 255 * 0.8).astype(np.uint8)
        cv2.rectangle(self._area, (x0, y - 3 * s), (x1, y + 3 * s), INK, -1)
        middle = (x0 + x1) // 2
        cv2.rectangle(self._area, (middle, y - 2 * s), (x1 - s, y + 2 * s), WHITE, -1)
        _text(self._area, f"{length:g} m", (middle / s, y / s - 11), 0.5, INK, anchor="middle")


def nice_step(rough: float) -> float:
    """The smallest of 1, 2, 5 x 10^k that is at least ``rough`` > 0."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough * (1 - 1e-9))


def _text(
    image: Image, text: str, at: tuple[float, float], size: float, color: Color, anchor: str = "start", weight: int = 1
) -> None:
    """Write at the base line's left end, middle or right end, given in final pixels. The font knows ASCII only."""
    plain = text.encode("ascii", "replace").decode("ascii")
    width = _text_width(plain, size, weight)
    shift = {"start": 0.0, "middle": width / 2, "end": width}[anchor]
    origin = (round((at[0] - shift) * OVERSAMPLING), round(at[1] * OVERSAMPLING))
    cv2.putText(image, plain, origin, FONT, size * OVERSAMPLING, color, weight * OVERSAMPLING, cv2.LINE_AA)


def _text_width(text: str, size: float, weight: int = 1) -> float:
    """Final pixels."""
    return cv2.getTextSize(text, FONT, size * OVERSAMPLING, weight * OVERSAMPLING)[0][0] / OVERSAMPLING


def _legend_rows(keys: Sequence[Key], width: int) -> list[list[tuple[float, Key]]]:
    """The keys broken into rows that fit ``width`` final pixels, each with its x."""
    rows: list[list[tuple[float, Key]]] = []
    x = math.inf
    for key in keys:
        needs = 38 + _text_width(key.label, 0.5) + 20
        if x + needs - 20 > LEFT + width + RIGHT / 2:
            rows.append([])
            x = float(LEFT)
        rows[-1].append((x, key))
        x += needs
    return rows


def _draw_legend(page: Image, row: list[tuple[float, Key]], y: float) -> None:
    s = OVERSAMPLING
    for x, key in row:
        middle = (round((x + 15) * s * 2**SUBPIXEL), round((y + 6) * s * 2**SUBPIXEL))
        if key.look == "patch":
            corners = (round((x + 3) * s), round((y - 3) * s)), (round((x + 27) * s), round((y + 15) * s))
            cv2.rectangle(page, *corners, key.color, -1)
            cv2.rectangle(page, *corners, FRAME, s)
        elif key.look == "line":
            ends = (round(x * s), round((y + 6) * s)), (round((x + 30) * s), round((y + 6) * s))
            cv2.line(page, *ends, key.color, 3 * s, cv2.LINE_AA)
        elif key.look == "dot":
            _disc(page, middle, 3.0, key.color)
        elif key.look == "ring":
            _ring(page, middle, 6.0, key.color)
        else:
            _robot(page, middle, 0.0, 11.0, key.color)
        _text(page, key.label, (x + 38, y + 11), 0.5, INK)


def _disc(image: Image, at: tuple[int, int], radius: float, color: Color) -> None:
    cv2.circle(image, at, round(radius * OVERSAMPLING * 2**SUBPIXEL), color, -1, cv2.LINE_AA, SUBPIXEL)


def _ring(image: Image, at: tuple[int, int], radius: float, color: Color) -> None:
    _disc(image, at, radius + 1.5, WHITE)
    _disc(image, at, radius, color)
    _disc(image, at, radius - 2.5, WHITE)


def _robot(image: Image, at: tuple[int, int], heading: float, size: float, color: Color) -> None:
    for grow, fill in ((1.3, WHITE), (1.0, color)):
        angles = heading + np.radians([0, 140, 180, 220])
        reach = size * grow * OVERSAMPLING * 2**SUBPIXEL * np.array([1.0, 0.9, 0.4, 0.9])
        corners = np.stack([at[0] + reach * np.cos(angles), at[1] - reach * np.sin(angles)], axis=-1)
        cv2.fillPoly(image, [np.round(corners).astype(np.int32)], fill, cv2.LINE_AA, SUBPIXEL)
