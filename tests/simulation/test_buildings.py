from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.simulation.buildings import BUILDINGS, build
from pfslam_viz.simulation.drive import DriveConfig, drive_along
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.simulation.world import World

Colors = Callable[[World, NDArray[np.float64]], NDArray[np.float64]]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", BUILDINGS)
def test_the_route_is_clear_and_the_building_closed(name: str, seed: int, floor_colors: Colors) -> None:
    rng = np.random.default_rng(seed)
    world = build(name, rng)
    drive = drive_along(world.route, rng, DriveConfig())
    poses = drive.poses[:: max(40, len(drive.poses) // 1500)]
    ranges, _ = true_ranges(world.walls, poses, np.linspace(-np.pi, np.pi, 361)[:-1])
    assert np.isfinite(ranges).all()
    assert ranges.min() > 0.33  # the robot is half a metre wide
    assert (floor_colors(world, poses[:, :2]).sum(axis=1) > 0).all()
    assert len(world.walls) == len(world.heights) == len(world.colors)


def test_office_returns_to_its_start_and_turns_round_in_a_bare_hallway() -> None:
    world = build("office", np.random.default_rng(0))
    assert np.hypot(*(world.route[0] - world.route[-1])) < 0.5
    turned = int(np.argmax(world.route[:, 0]))
    hall = world.walls[(world.walls[:, [0, 2]].max(axis=1) > world.route[turned, 0])]
    assert len(hall) == 3  # two sides and the end, nothing else


def test_ring_is_over_100_m_round() -> None:
    for seed in range(5):
        route = build("ring", np.random.default_rng(seed)).route
        assert geometry.path_length(np.column_stack([route, np.zeros(len(route))])) > 105.0


def test_hallway_has_a_u_turn_at_each_end() -> None:
    route = build("hallway", np.random.default_rng(0)).route
    east, west = route[route[:, 0] == route[:, 0].max()], route[route[:, 0] == route[:, 0].min()]
    for end in (east, west):
        assert len(end) == 2 and abs(end[0, 1] - end[1, 1]) == pytest.approx(0.9)
    assert route[:, 0].max() - route[:, 0].min() > 25.0


def test_campus_is_2_km_that_cross_themselves() -> None:
    route = build("campus", np.random.default_rng(0)).route
    assert geometry.path_length(np.column_stack([route, np.zeros(len(route))])) == pytest.approx(2000.0, abs=150.0)
    assert np.ptp(route[:, 0]) > 350.0 and np.ptp(route[:, 1]) > 230.0
    assert len(np.unique(route.round(3), axis=0)) < len(route)  # a corner that it comes back to


def test_seeds_differ_and_repeat() -> None:
    first, again, other = (build("office", np.random.default_rng(s)).walls for s in (1, 1, 2))
    assert np.array_equal(first, again)
    assert first.shape != other.shape or not np.allclose(first, other)


def test_unknown_building_is_an_input_error() -> None:
    with pytest.raises(InputError, match="'castle'; there are office, ring, hallway, campus"):
        build("castle", np.random.default_rng(0))
