"""A simulated building: walls, floors, and the route the robot takes through it.

Buildings are drawn on a plan of axis-aligned rooms (:class:`Plan`) and become a :class:`World` of wall segments.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry

Array = NDArray[np.float64]
Color = tuple[int, int, int]

WALL_HEIGHT = 2.6  # m
PLASTER: Color = (206, 203, 196)


@dataclass(frozen=True, slots=True)
class World:
    """What the sensors can see, and where to drive. Metres.

    Attributes:
        walls: (m, 4) segments x0, y0, x1, y1 of everything that stands on the floor.
        heights: (m,) how far up from the floor each stands.
        colors: (m, 3) uint8 RGB of each.
        zones: (k, 4) rectangles x0, y0, x1, y1 of floor, in the plan's frame; the first one that holds a point counts.
        floors: (k,) int64 floor pattern of each zone, an index into :data:`pfslam_viz.simulation.floor.PATTERNS`.
        route: (w, 2) corners of the polyline the robot follows.
        plan: (3,) pose of the plan's frame, in the frame that walls and route are given in.
    """

    walls: Array
    heights: Array
    colors: NDArray[np.uint8]
    zones: Array
    floors: NDArray[np.int64]
    route: Array
    plan: Array

    def seen_from(self, pose: ArrayLike) -> "World":
        """The same world with walls, route and plan given in the frame of ``pose`` (3,)."""
        view = geometry.inverse(pose)
        ends = [geometry.transform(view, self.walls[:, k : k + 2]) for k in (0, 2)]
        return replace(
            self,
            walls=np.hstack(ends),
            route=geometry.transform(view, self.route),
            plan=geometry.compose(view, self.plan),
        )


class Plan:
    """Collects rooms, doors and furniture; the walls are the outline of all the rooms together.

    Rooms that touch or overlap form one space, so a door is a small room that bridges the wall between two others.
    """

    def __init__(self) -> None:
        self.rooms: list[tuple[float, float, float, float]] = []
        self.floors: list[int] = []
        self.paints: list[Color] = []
        self.segments: list[tuple[float, float, float, float]] = []
        self.heights: list[float] = []
        self.colors: list[Color] = []
        self.taken: list[tuple[float, float, float]] = []  # x, y, radius of what has been put up

    def room(self, x0: float, y0: float, x1: float, y1: float, floor: int = 0, paint: Color = PLASTER) -> None:
        """A rectangle of free floor. Where rooms overlap, the first one's floor and paint count."""
        self.rooms.append((x0, y0, x1, y1))
        self.floors.append(floor)
        self.paints.append(paint)

    def polyline(self, points: ArrayLike, height: float = WALL_HEIGHT, color: Color = PLASTER) -> None:
        """Walls along ``points`` (p, 2)."""
        xy = np.asarray(points, dtype=np.float64)
        for a, b in pairwise(xy):
            self.segments.append((float(a[0]), float(a[1]), float(b[0]), float(b[1])))
            self.heights.append(height)
            self.colors.append(color)

    def box(
        self, x: float, y: float, width: float, depth: float, yaw: float = 0.0, height: float = 1.0,
        color: Color = (139, 105, 70),
    ) -> None:  # fmt: skip
        """A piece of furniture with its centre at x, y."""
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [width / 2, depth / 2]
        self.polyline(geometry.transform((x, y, yaw), corners), height, color)
        self.taken.append((x, y, float(np.hypot(width, depth)) / 2))

    def column(self, x: float, y: float, radius: float, height: float = WALL_HEIGHT, color: Color = PLASTER) -> None:
        """A round column, as a regular dodecagon."""
        angles = np.linspace(0.0, 2.0 * np.pi, 13)
        self.polyline(np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], -1), height, color)
        self.taken.append((x, y, radius))

    def build(self, route: ArrayLike) -> World:
        """The World of everything drawn, in the plan's own frame."""
        walls, facing = outline(np.array(self.rooms))
        colors = [self.paints[k] for k in facing] + self.colors
        return World(
            walls=np.vstack([walls, np.array(self.segments).reshape(-1, 4)]),
            heights=np.array([WALL_HEIGHT] * len(walls) + self.heights),
            colors=np.array(colors, dtype=np.uint8),
            zones=np.array(self.rooms, dtype=np.float64),
            floors=np.array(self.floors, dtype=np.int64),
            route=np.asarray(route, dtype=np.float64),
            plan=np.zeros(3),
        )


def outline(rectangles: Array) -> tuple[Array, NDArray[np.int64]]:
    """The boundary of a union of ``rectangles`` (k, 4) as (m, 4) segments, and the rectangle (m,) that each bounds.

    The plane is cut along every edge of every rectangle; the boundary runs between free and solid pieces of that grid.
    """
    xs, ys = np.unique(rectangles[:, [0, 2]]), np.unique(rectangles[:, [1, 3]])
    owner = np.full((len(ys) + 1, len(xs) + 1), -1, dtype=np.int64)  # one ring of solid pieces around
    for k in range(len(rectangles) - 1, -1, -1):
        x0, x1 = np.searchsorted(xs, rectangles[k, [0, 2]])
        y0, y1 = np.searchsorted(ys, rectangles[k, [1, 3]])
        owner[y0 + 1 : y1 + 1, x0 + 1 : x1 + 1] = k
    horizontal = _runs(owner[:-1], owner[1:])
    vertical = _runs(owner[:, :-1].T, owner[:, 1:].T)
    # Piece column j lies between xs[j - 1] and xs[j].
    walls = [(xs[a - 1], ys[line], xs[b - 1], ys[line]) for line, a, b, _ in horizontal]
    walls += [(xs[line], ys[a - 1], xs[line], ys[b - 1]) for line, a, b, _ in vertical]
    return np.array(walls), np.array([k for *_, k in horizontal + vertical])


def _runs(below: NDArray[np.int64], above: NDArray[np.int64]) -> list[tuple[int, int, int, int]]:
    """Maximal runs ``(line, start, stop, owner)`` along which exactly one side is free, and the same side and owner."""
    out = []
    boundary = (below >= 0) != (above >= 0)
    label = np.where(boundary, 2 * np.maximum(below, above) + (above >= 0), -1)
    for line, row in enumerate(label):
        edges = np.flatnonzero(np.diff(row, prepend=-2, append=-2))
        out += [(line, int(a), int(b), int(row[a]) // 2) for a, b in pairwise(edges) if row[a] >= 0]
    return out


def distance_to_polyline(points: ArrayLike, line: ArrayLike) -> Array:
    """Distance in m of each of ``points`` (n, 2) to the polyline through ``line`` (w, 2)."""
    p, q = np.asarray(points, dtype=np.float64), np.asarray(line, dtype=np.float64)
    a, d = q[:-1], np.diff(q, axis=0)
    along = ((p[:, None] - a) * d).sum(-1) / np.maximum((d * d).sum(-1), 1e-12)
    nearest = a + np.clip(along, 0.0, 1.0)[..., None] * d
    return np.asarray(np.linalg.norm(p[:, None] - nearest, axis=-1).min(axis=1), dtype=np.float64)
