"""The buildings that can be simulated, each drawn anew from a seed."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from pfslam_viz.errors import InputError
from pfslam_viz.simulation.floor import BLUE_CARPET, CHECKER, GREEN_CARPET, PLANKS, SLABS
from pfslam_viz.simulation.world import Array, Color, Plan, World, distance_to_polyline

Rectangle = tuple[float, float, float, float]

WALL = 0.16  # m thick
DOOR = 1.0  # m wide
CLEARANCE = 0.62  # m from the route to any furniture: the robot is half a metre wide, and corners are cut
WOOD: Color = (150, 111, 72)
PALE: Color = (224, 220, 208)
STEEL: Color = (120, 128, 138)
CLAY: Color = (196, 138, 108)
SAGE: Color = (164, 178, 150)
SKY: Color = (158, 180, 200)
SAND: Color = (214, 196, 158)


def office(rng: np.random.Generator) -> World:
    """Rooms with furniture round a loop of corridors, and a long bare hallway that ends blind, with a U-turn in it.

    The route leaves a room, goes down the hallway and back, round the loop, through the open-plan room, and home.
    """
    plan = Plan()
    w = 2.2
    length, height = rng.uniform(9.8, 10.6), rng.uniform(7.8, 8.3)
    hall = length + rng.uniform(8.4, 9.4)
    south, north, west = -WALL, height + WALL, -WALL
    deep = rng.uniform(3.6, 4.2)
    split = rng.uniform(3.4, 3.8), rng.uniform(6.6, 7.2)
    start_x = split[0] / 2 + rng.uniform(0.1, 0.4)
    first, second = rng.uniform(6.9, 7.2), rng.uniform(3.2, 3.5)  # the open-plan room's two doors
    lane = 0.42
    turn = hall - 1.25
    route = np.array([
        (start_x + rng.uniform(-0.3, 0.3), south - 2.3), (start_x, w / 2 - 0.1), (length, w / 2 - 0.25),
        (length + 1.5, w / 2 - lane), (turn, w / 2 - lane), (turn, w / 2 + lane),
        (length + 1.0, w / 2 + lane), (length - w / 2, w / 2 + lane),
        (length - w / 2, height - w / 2), (first, height - w / 2), (first, north + 1.5), (second, north + 1.5),
        (second, height - w / 2), (w / 2, height - w / 2), (w / 2, w / 2), (start_x, w / 2),
        (start_x, south - 2.2),
    ])  # fmt: skip

    plan.room(0, 0, length, w, CHECKER)
    plan.room(0, height - w, length, height, CHECKER)
    plan.room(0, 0, w, height, CHECKER)
    plan.room(length - w, 0, length, height, CHECKER)
    plan.room(length, 0, hall, w, SLABS, PALE)

    rooms: list[Rectangle] = []

    def add(x0: float, y0: float, x1: float, y1: float, floor: int, paint: Color) -> Rectangle:
        plan.room(x0, y0, x1, y1, floor, paint)
        rooms.append((x0, y0, x1, y1))
        return rooms[-1]

    home = add(0, south - deep, split[0], south, PLANKS, SAND)
    add(split[0] + WALL, south - deep, split[1], south, BLUE_CARPET, SKY)
    add(split[1] + WALL, south - deep, length, south, GREEN_CARPET, SAGE)
    large = add(1.2, north, 8.9, north + rng.uniform(4.2, 4.8), PLANKS, SKY)
    core = add(w + WALL, w + WALL, length - w - WALL, height - w - WALL, BLUE_CARPET, CLAY)
    lounge = add(west - rng.uniform(2.8, 3.4), 1.2, west, height - 1.4, GREEN_CARPET, SAND)
    side = add(length + WALL, w + WALL, length + WALL + rng.uniform(3.4, 4.2), height - 0.6, PLANKS, SAGE)

    _door(plan, start_x, south, 0.0)
    _door(plan, (split[0] + split[1]) / 2 + rng.uniform(-0.6, 0.6), south, 0.0)
    _door(plan, (split[1] + length) / 2 + rng.uniform(-0.6, 0.6), south, 0.0)
    _door(plan, first, height, north)
    _door(plan, second, height, north)
    _door(plan, length / 2 + rng.uniform(-1.2, 1.2), w, w + WALL)
    plan.room(west, 2.6, 0, height - 2.9, GREEN_CARPET, SAND)  # the lounge's wide opening
    plan.room(length, height / 2, length + WALL, height / 2 + DOOR, CHECKER)
    _recess(plan, 0.55, height, up=True)
    _recess(plan, 0.55, 0.0, up=False)

    _desks(plan, large, route, rng, 4)
    _against_walls(plan, home, route, rng, 5)
    _against_walls(plan, lounge, route, rng, 5)
    _against_walls(plan, large, route, rng, 6)
    for room in rooms[1:3]:
        _desks(plan, room, route, rng, 1)
        _against_walls(plan, room, route, rng, 4)
    _against_walls(plan, side, route, rng, 5)
    x, y = (core[0] + core[2]) / 2, (core[1] + core[3]) / 2
    plan.box(x, y, 2.2, 1.0, rng.uniform(-0.05, 0.05), 0.75, WOOD)
    for dx in (-0.7, 0.0, 0.7):
        for side_y in (-0.85, 0.85):
            plan.box(x + dx, y + side_y, 0.42, 0.42, rng.uniform(-0.5, 0.5), 0.85, STEEL)
    _against_walls(plan, core, route, rng, 3)
    return plan.build(route)


def ring(rng: np.random.Generator) -> World:
    """One closed corridor of over 100 m, mostly bare: drift shows only when it closes."""
    plan = Plan()
    w = rng.uniform(2.1, 2.5)
    long, wide = rng.uniform(36.0, 40.0), rng.uniform(17.0, 20.0)
    notch_x, notch_y = long * rng.uniform(0.45, 0.6), wide * rng.uniform(0.35, 0.5)
    # An L-shaped ring: a rectangle with one corner set back.
    corners = np.array([
        (0, 0), (long, 0), (long, wide - notch_y), (long - notch_x, wide - notch_y), (long - notch_x, wide), (0, wide),
    ])  # fmt: skip
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        low, high = np.minimum(a, b) - w / 2, np.maximum(a, b) + w / 2
        plan.room(low[0], low[1], high[0], high[1], SLABS)
    for x in np.sort(rng.uniform(2.0, long - 2.0, 4)):
        _recess(plan, x, -w / 2, up=False)
    for y in rng.uniform(2.0, wide - 2.0, 2):
        plan.room(-w / 2 - 0.12, y, -w / 2, y + 0.95, SLABS, WOOD)
    # An alcove with a few things in it where the drive starts and ends.
    at = long * rng.uniform(0.25, 0.35)
    alcove = (at - 2.2, -w / 2 - 2.6, at + 2.2, -w / 2)
    plan.room(*alcove, floor=PLANKS, paint=SAND)
    route = np.vstack([[(at, 0.0)], corners[1:], corners[:1], [(at + 5.0, 0.0)]])
    _against_walls(plan, alcove, route, rng, 5)
    return plan.build(route)


def hallway(rng: np.random.Generator) -> World:
    """A long bare hallway with a U-turn at each end; the drive starts and ends in the lobby at its middle."""
    plan = Plan()
    w = rng.uniform(2.3, 2.7)
    east, west = rng.uniform(18.0, 24.0), -rng.uniform(14.0, 18.0)
    plan.room(west, -w / 2, east, w / 2, SLABS, PALE)
    lobby = (-3.4, w / 2, 3.2, w / 2 + rng.uniform(3.6, 4.6))
    plan.room(*lobby, floor=PLANKS, paint=SAND)
    for end, sign in ((east, 1.0), (west, -1.0)):  # rounded blind ends
        angles = np.linspace(-np.pi / 2, np.pi / 2, 13)
        plan.polyline(np.stack([end + sign * (w / 2) * (np.cos(angles) - 1.0), w / 2 * np.sin(angles)], -1), color=PALE)
    lane, back = 0.45, rng.uniform(1.3, 1.6)
    home = (0.4, w / 2 + 1.9)
    route = np.array([
        home, (0.4 + rng.uniform(-0.2, 0.2), -0.2), (2.0, -lane), (east - back, -lane), (east - back, lane),
        (west + back, lane), (west + back, -lane), (-1.0, -lane), (0.2, 0.0), (0.2, home[1]),
    ])  # fmt: skip
    for x in rng.uniform(west + 5.0, -5.0, 2):
        _recess(plan, x, -w / 2, up=False)
    _against_walls(plan, lobby, route, rng, 6)
    return plan.build(route)


def campus(rng: np.random.Generator) -> World:
    """Streets between blocks of buildings, 0.4 km across, and a drive of 2 km along them that comes back five times.

    For long drives: thin them with a lower scan rate.
    """
    plan = Plan()
    xs = np.concatenate([[0.0], np.cumsum(rng.uniform(88.0, 102.0, 4))])
    ys = np.concatenate([[0.0], np.cumsum(rng.uniform(78.0, 92.0, 3))])
    corners = [(0, 0), (4, 0), (4, 3), (3, 3), (3, 1), (1, 1), (1, 3), (0, 3), (0, 0), (1, 0), (1, 1), (2, 1), (2, 0)]
    route = np.array([(xs[i], ys[j]) for i, j in corners])
    for along_x, lines, crossings in ((True, ys, xs), (False, xs, ys)):
        for middle in lines:
            half = rng.uniform(3.5, 5.5)
            _street(plan, along_x, middle, half, crossings[0] - half, crossings[-1] + half)
            for start, end in pairwise(crossings):
                for side in (-1.0, 1.0):
                    _facade(plan, along_x, middle, side * half, start + 8.0, end - 8.0, rng)
    return plan.build(route)


BUILDINGS: dict[str, Callable[[np.random.Generator], World]] = {
    "office": office,
    "ring": ring,
    "hallway": hallway,
    "campus": campus,
}


def build(name: str, rng: np.random.Generator) -> World:
    """The World of the building called ``name``. Raises InputError for a name that is not in :data:`BUILDINGS`."""
    if name not in BUILDINGS:
        raise InputError(f"no building is called '{name}'; there are {', '.join(BUILDINGS)}")
    return BUILDINGS[name](rng)


def _door(plan: Plan, x: float, y0: float, y1: float) -> None:
    """An open door, centred on x, in a wall between y0 and y1."""
    plan.room(x - DOOR / 2, y0, x + DOOR / 2, y1, CHECKER, WOOD)


def _street(plan: Plan, along_x: bool, middle: float, half: float, start: float, end: float) -> None:
    """A street from ``start`` to ``end``, so wide to both sides of its middle, along x or along y."""
    low, high = middle - half, middle + half
    x0, y0, x1, y1 = (start, low, end, high) if along_x else (low, start, high, end)
    plan.room(x0, y0, x1, y1, SLABS)


def _facade(
    plan: Plan, along_x: bool, middle: float, edge: float, start: float, end: float, rng: np.random.Generator
) -> None:
    """Doorways, passages and lamp posts along one side of a street; ``edge`` is how far that is from the middle."""
    at = start + rng.uniform(0.0, 6.0)
    while at < end:
        width, depth = rng.uniform(1.2, 5.0), rng.choice([0.3, 0.6, 1.5, 4.0]) * rng.uniform(0.7, 1.3)
        low, high = sorted((middle + edge, middle + edge + np.sign(edge) * depth))
        x0, y0, x1, y1 = (at, low, at + width, high) if along_x else (low, at, high, at + width)
        plan.room(x0, y0, x1, y1, SLABS, SAND)
        along, across = at + width + rng.uniform(0.5, 2.0), middle + edge - np.sign(edge) * rng.uniform(0.5, 1.2)
        if rng.random() < 0.6:
            size = rng.uniform(0.2, 0.5)
            x, y = (along, across) if along_x else (across, along)
            plan.box(x, y, size, size, rng.uniform(0.0, 1.5), 2.0, STEEL)
        at += width + rng.uniform(3.0, 12.0)


def _recess(plan: Plan, x: float, y: float, up: bool) -> None:
    """A shut door, set back 12 cm into the wall at y."""
    plan.room(x - 0.47, y if up else y - 0.12, x + 0.47, y + 0.12 if up else y, CHECKER, WOOD)


def _fits(plan: Plan, x: float, y: float, radius: float, route: Array, gap: float = 0.05) -> bool:
    clear = distance_to_polyline([(x, y)], route)[0] > radius + CLEARANCE
    return bool(clear and all(np.hypot(x - a, y - b) > radius + r + gap for a, b, r in plan.taken))


def _against_walls(plan: Plan, room: Rectangle, route: Array, rng: np.random.Generator, count: int) -> None:
    """Up to ``count`` cupboards, shelves, seats and plants along a room's walls, clear of route and doors."""
    kinds = [(1.1, 0.42, 1.9, WOOD), (0.8, 0.45, 1.1, STEEL), (1.5, 0.7, 0.8, (86, 104, 132)), (0.6, 0.6, 0.75, WOOD)]
    x0, y0, x1, y1 = room
    for _ in range(40 * count):
        if count == 0:
            return
        if rng.random() < 0.25:
            r = rng.uniform(0.16, 0.24)
            x, y = rng.choice([x0 + r + 0.1, x1 - r - 0.1]), rng.choice([y0 + r + 0.1, y1 - r - 0.1])
            if _fits(plan, x, y, r, route) and _clear_of_doors(plan, room, x, y, r):
                plan.column(x, y, r, 1.2, (70, 120, 72))
                count -= 1
            continue
        width, depth, height, color = kinds[rng.integers(len(kinds))]
        gap = depth / 2 + rng.uniform(0.03, 0.10)
        if rng.random() < (x1 - x0) / (x1 - x0 + y1 - y0):
            x, y, yaw = rng.uniform(x0 + width / 2, x1 - width / 2), rng.choice([y0 + gap, y1 - gap]), 0.0
        else:
            x, y, yaw = rng.choice([x0 + gap, x1 - gap]), rng.uniform(y0 + width / 2, y1 - width / 2), np.pi / 2
        radius = float(np.hypot(width, depth)) / 2
        if _fits(plan, x, y, radius, route) and _clear_of_doors(plan, room, x, y, radius):
            plan.box(x, y, width, depth, yaw + rng.uniform(-0.03, 0.03), height, color)
            count -= 1


def _clear_of_doors(plan: Plan, room: Rectangle, x: float, y: float, radius: float) -> bool:
    """Whether nothing that opens into ``room`` is blocked by a piece of the given radius."""
    for a0, b0, a1, b1 in plan.rooms:
        if (a0, b0, a1, b1) == room:
            continue
        touches = a0 <= room[2] and room[0] <= a1 and b0 <= room[3] and room[1] <= b1
        dx, dy = max(a0 - x, 0.0, x - a1), max(b0 - y, 0.0, y - b1)
        if touches and np.hypot(dx, dy) < radius + 0.1:
            return False
    return True


def _desks(plan: Plan, room: Rectangle, route: Array, rng: np.random.Generator, count: int) -> None:
    """Up to ``count`` desks inside a room, each with a chair."""
    x0, y0, x1, y1 = room
    for _ in range(60 * count):
        if count == 0:
            return
        x, y = rng.uniform(x0 + 1.0, x1 - 1.0), rng.uniform(y0 + 0.9, y1 - 1.15)
        if _fits(plan, x, y, 0.95, route):
            plan.box(x, y, 1.4, 0.7, rng.uniform(-0.06, 0.06), 0.75, WOOD)
            plan.box(x + rng.uniform(-0.3, 0.3), y + 0.7, 0.44, 0.44, rng.uniform(-0.6, 0.6), 0.9, STEEL)
            count -= 1
