"""The filter's increments as constraints: along which walls a scan knows its way, and how firmly. Numbers by hand."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph.filter_constraints import filter_constraints, walls_of
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import FilterConstraintsConfig, ScanMatchingConfig

Array = NDArray[np.float64]

CONFIG = FilterConstraintsConfig(
    least_angle=0.01, noise_angle=0.1, least_distance=0.1, noise_distance=0.5, least_share=0.1, fewest_walls=10
)


def wall(x0: float, y0: float, x1: float, y1: float, points: int) -> Array:
    """End points in the order of beams; walls are far enough from each other for none to be a neighbour's."""
    return np.column_stack([np.linspace(x0, x1, points), np.linspace(y0, y1, points)])


def corridor(heading: float = 0.0) -> Array:
    """Two walls of 40 points, seen by a robot that faces ``heading`` rad away from their direction."""
    points = np.vstack([wall(-2, -1, 2, -1, 40), wall(2, 1, -2, 1, 40)])
    return geometry.transform(np.array([0.0, 0.0, -heading]), points)


# 60 points on walls along x, 30 on walls along y, each end 0.5 m from the next wall
ROOM = np.vstack([wall(-1.5, -2, 1.5, -2, 30), wall(2, -1.45, 2, 1.45, 30), wall(1.5, 2, -1.5, 2, 30)])


def store_of(*scans: Array) -> ScanStore:
    store = ScanStore(np.zeros(2), ScanMatchingConfig(wall_spacings=0.1))
    for points in scans:
        store.add(points)
    return store


def test_a_corridor_says_nothing_along_it() -> None:
    np.testing.assert_allclose(walls_of(store_of(corridor()), 0, CONFIG), np.diag([0.0, 1.0]), atol=1e-6)


def test_a_corridor_seen_askew_is_in_the_robots_frame() -> None:
    """Facing 30° to its left, the corridor's left wall lies across (sin 30°, cos 30°) as the robot sees it."""
    across = np.array([0.5, math.sqrt(0.75)])
    known = walls_of(store_of(corridor(math.radians(30))), 0, CONFIG)
    np.testing.assert_allclose(known, np.outer(across, across), atol=1e-6)


def test_a_room_is_known_both_ways_as_its_walls_are() -> None:
    """60 end points tell y, 30 tell x: half as much."""
    np.testing.assert_allclose(walls_of(store_of(ROOM), 0, CONFIG), np.diag([0.5, 1.0]), atol=1e-6)


@pytest.mark.parametrize(("across", "share"), [(7, 0.0), (9, 9 / 80)])
def test_a_small_share_of_the_walls_is_nothing(across: int, share: float) -> None:
    """7 of 87 end points at the corridor's end are 0.0875 of the other wall's, 9 are 0.1125; a tenth is asked."""
    points = np.vstack([corridor(), wall(-4, 0.3, -4, -0.3, across)])
    np.testing.assert_allclose(walls_of(store_of(points), 0, CONFIG), np.diag([share, 1.0]), atol=1e-6)


@pytest.mark.parametrize(("points", "known"), [(9, False), (10, True)])
def test_too_few_walls_say_nothing(points: int, known: bool) -> None:
    """Stray points, which lie on no wall, do not count."""
    stray = np.column_stack([np.arange(3.0, 43.0), np.full(40, 5.0)])
    store = store_of(np.vstack([wall(-1, -1, 0, -1, points), stray]))
    np.testing.assert_allclose(walls_of(store, 0, CONFIG), np.diag([0.0, float(known)]), atol=1e-6)


def test_a_scan_that_sees_nothing_says_nothing() -> None:
    assert not walls_of(store_of(np.zeros((0, 2))), 0, FilterConstraintsConfig(fewest_walls=1)).any()


def test_each_scan_has_its_own_walls() -> None:
    store = store_of(ROOM, corridor(), ROOM[:5])
    np.testing.assert_allclose(walls_of(store, 1, CONFIG), np.diag([0.0, 1.0]), atol=1e-6)
    np.testing.assert_allclose(walls_of(store, 0, CONFIG), np.diag([0.5, 1.0]), atol=1e-6)
    assert not walls_of(store, 2, CONFIG).any()


def test_the_increments_are_as_firm_as_configured_by_hand() -> None:
    """0.5 m and 0.2 rad on: 0.1 + 0.5 · 0.5 m = 0.35 m and 0.01 + 0.1 · 0.2 = 0.03 rad. At rest 0.1 m and 0.01 rad.

    The walls are those of the scan that was matched with the map, the later one.
    """
    increments = np.array([[0.3, -0.4, -0.2], [0.0, 0.0, 0.0]])
    store = store_of(np.zeros((0, 2)), ROOM, corridor())
    c = filter_constraints(store, increments, np.arange(2), CONFIG)
    assert (c.start.tolist(), c.end.tolist(), c.robust.tolist()) == ([0, 1], [1, 2], [True, True])
    np.testing.assert_allclose(c.measured, np.array([[0.3, -0.4, -0.2], [0.0, 0.0, 0.0]]), atol=1e-12)
    np.testing.assert_allclose(c.information[0], np.diag([0.5 / 0.35**2, 1 / 0.35**2, 1 / 0.03**2]), atol=1e-4)
    np.testing.assert_allclose(c.information[1], np.diag([0.0, 100.0, 1e4]), atol=1e-3)


def test_a_scan_without_walls_gives_no_constraint_at_all() -> None:
    """Not even on the heading: there the odometry led the particles."""
    nothing = np.zeros((0, 2))
    increments = np.tile([0.2, 0.0, 0.1], (4, 1))
    store = store_of(ROOM, nothing, corridor(), ROOM[:5], ROOM)
    c = filter_constraints(store, increments, np.arange(4), CONFIG)
    assert (c.start.tolist(), c.end.tolist()) == ([1, 3], [2, 4])
    np.testing.assert_allclose(c.measured, np.tile([0.2, 0.0, 0.1], (2, 1)), atol=1e-12)
    assert c.information.shape == (2, 3, 3) and c.robust.shape == (2,)
    assert len(filter_constraints(store_of(nothing, nothing), increments[:1], np.arange(1), CONFIG)) == 0
    assert filter_constraints(store, increments, np.array([3]), CONFIG).start.tolist() == [3]
