import numpy as np
import pytest

from pfslam_viz.simulation.world import Plan, distance_to_polyline, outline


def lengths(walls: np.ndarray) -> np.ndarray:
    found: np.ndarray = np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])
    return found


def test_outline_of_one_rectangle() -> None:
    walls, facing = outline(np.array([[0.0, 0.0, 3.0, 2.0]]))
    assert sorted(lengths(walls)) == [2.0, 2.0, 3.0, 3.0]
    assert (facing == 0).all()


def test_outline_has_no_wall_where_a_door_bridges_two_rooms() -> None:
    # Two 2 x 2 rooms, 0.2 m apart, and a 1 m wide door between them.
    walls, facing = outline(np.array([[0.0, 0.0, 2.0, 2.0], [2.2, 0.0, 4.2, 2.0], [2.0, 0.5, 2.2, 1.5]]))
    # Each room's 8 m less the door's 1 m, and the door's two 0.2 m cheeks.
    assert lengths(walls).sum() == pytest.approx(2 * (8.0 - 1.0) + 2 * 0.2)
    assert lengths(walls[facing == 2]).tolist() == pytest.approx([0.2, 0.2])
    crosses_door = (walls[:, 0] == walls[:, 2]) & (np.minimum(walls[:, 1], walls[:, 3]) < 1.0)
    crosses_door &= (np.maximum(walls[:, 1], walls[:, 3]) > 1.0) & (walls[:, 0] > 1.9) & (walls[:, 0] < 2.3)
    assert not crosses_door.any()


def test_outline_of_overlapping_rectangles_is_that_of_their_union() -> None:
    walls, _ = outline(np.array([[0.0, 0.0, 3.0, 1.0], [1.0, 0.0, 2.0, 4.0]]))  # an upside-down T
    assert lengths(walls).sum() == pytest.approx(2 * (3.0 + 4.0))


def test_distance_to_polyline() -> None:
    line = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0)]
    assert distance_to_polyline([(1.0, 0.5), (3.0, 1.0), (-3.0, -4.0), (1.5, 1.0)], line) == pytest.approx(
        [0.5, 1.0, 5.0, 0.5]
    )


def test_seen_from_moves_walls_and_plan_alike() -> None:
    plan = Plan()
    plan.room(0.0, 0.0, 4.0, 3.0)
    world = plan.build([(1.0, 1.0), (3.0, 1.0)])
    moved = world.seen_from((1.0, 1.0, np.pi / 2))  # facing north: north is x, west is y
    assert moved.route == pytest.approx(np.array([[0.0, 0.0], [0.0, -2.0]]))
    assert moved.plan == pytest.approx([-1.0, 1.0, -np.pi / 2])
    assert (moved.walls[:, ::2].min(), moved.walls[:, ::2].max()) == pytest.approx((-1.0, 2.0))
    assert (moved.walls[:, 1::2].min(), moved.walls[:, 1::2].max()) == pytest.approx((-3.0, 1.0))
