"""The kernels of scan matching against plain twins, numerical derivatives and scenes worked by hand."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam import point_to_line

Array = NDArray[np.float64]

CELL, ORIGIN, SHAPE = 0.1, (30, 20), (60, 50)


def empty_map() -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    return np.zeros((*SHAPE, 5), np.float32), np.zeros(SHAPE, np.uint8)


def cell_of(x: float, y: float) -> tuple[int, int]:
    return math.floor(-y / CELL) + ORIGIN[0], math.floor(x / CELL) + ORIGIN[1]


def draw(points: Array, normals: Array, pose: Array | None = None) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """A map in which the cells of these points are occupied and know their walls."""
    walls, occupied = empty_map()
    for x, y in geometry.transform(np.zeros(3) if pose is None else pose, points):
        occupied[cell_of(x, y)] = 1
    at = np.zeros(3) if pose is None else pose
    point_to_line.add_walls(walls, occupied, *ORIGIN, CELL, at, points, normals, 1000)
    return walls, occupied


def corner() -> tuple[Array, Array]:
    """End points on a wall x = 2.03 from y = -1 to 1 and on a wall y = 1.52 from x = 0 to 2, with their normals."""
    along = np.linspace(-1, 1, 120)
    ahead = np.stack([np.full(120, 2.03), along], axis=1)
    aside = np.stack([1 + along, np.full(120, 1.52)], axis=1)
    return np.vstack([ahead, aside]), np.repeat([[-1.0, 0.0], [0.0, -1.0]], 120, axis=0)


def random_scene() -> tuple[NDArray[np.float32], NDArray[np.uint8], Array, Array]:
    rng = np.random.default_rng(1)
    angle = rng.uniform(-math.pi, math.pi, 400)
    walls, occupied = draw(rng.uniform(-1.5, 2.5, (400, 2)), np.stack([np.cos(angle), np.sin(angle)], axis=1))
    angle = rng.uniform(-math.pi, math.pi, 150)
    return walls, occupied, rng.uniform(-4, 6, (150, 2)), np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_a_cell_keeps_the_mean_of_its_end_points() -> None:
    points = np.array([[1.02, 0.53], [1.06, 0.57], [1.55, 0.55]])
    normals = np.array([[1.0, 0.0], [0.6, 0.8], [0.0, 0.0]])  # the last one has no wall
    walls, _ = draw(points, normals)
    np.testing.assert_allclose(walls[cell_of(1.04, 0.55)], [2, 1.04, 0.55, 0.8, 0.4], rtol=1e-6)
    assert walls[..., 0].sum() == 2


def test_points_and_normals_turn_with_the_robot() -> None:
    pose = np.array([0.5, -0.2, math.pi / 2])
    walls, _ = draw(np.array([[1.0, 0.25]]), np.array([[-1.0, 0.0]]), pose)
    np.testing.assert_allclose(walls[cell_of(0.25, 0.8)], [1, 0.25, 0.8, 0, -1], atol=1e-6)


def test_memory_bounds_the_mean() -> None:
    walls, occupied = empty_map()
    occupied[cell_of(0.05, 0.05)] = 1
    for x in (0.01, 0.01, 0.01, 0.09):
        args = (np.zeros(3), np.array([[x, 0.05]]), np.array([[1.0, 0.0]]), 2)
        point_to_line.add_walls(walls, occupied, *ORIGIN, CELL, *args)
    assert walls[cell_of(0.05, 0.05)][0] == 2
    assert walls[cell_of(0.05, 0.05)][1] == pytest.approx(0.05)  # the newest counts half


def test_a_wall_seen_from_behind_gives_way_and_a_free_cell_forgets() -> None:
    point, front, back = np.array([[0.05, 0.05]]), np.array([[1.0, 0.0]]), np.array([[-1.0, 0.0]])
    walls, occupied = draw(point, front)
    wall = walls[cell_of(0.05, 0.05)]
    args = (walls, occupied, *ORIGIN, CELL, np.zeros(3), point)
    point_to_line.add_walls(*args, front, 1000)
    counts = []
    for _ in range(3):
        point_to_line.add_walls(*args, back, 1000)
        counts.append((float(wall[0]), float(wall[3])))
    assert counts == [(1, 1), (0, 1), (1, -1)]
    occupied[:] = 0
    point_to_line.add_walls(*args, back, 1000)
    assert wall[0] == 0


@pytest.mark.parametrize("search", [1, 4])
def test_find_walls(search: int) -> None:
    walls, occupied, points, normals = random_scene()
    occupied[::7] = 0
    pose = np.array([0.13, -0.21, 0.3])
    partners = np.full((150, 5), 9.0)
    found = point_to_line.find_walls(walls, occupied, *ORIGIN, CELL, pose, points, normals, search, partners)
    world = geometry.transform(pose, points)
    facing = geometry.transform(np.array([0, 0, 0.3]), normals)
    for (x, y), normal, partner in zip(world, facing, partners, strict=True):
        twin = nearest_twin(walls, occupied, x, y, normal, search)
        assert partner[4] == (twin is not None)
        if twin is not None:
            np.testing.assert_allclose(partner[:4], twin, atol=1e-6)
    assert found == partners[:, 4].sum() and 5 < found < 140


def nearest_twin(
    walls: NDArray[np.float32], occupied: NDArray[np.uint8], x: float, y: float, normal: Array, search: int
) -> Array | None:
    """Every cell in reach, with its ring; the nearest of those up to one ring beyond the first ring with any."""
    row, column = cell_of(x, y)
    candidates = []
    for i, j in np.argwhere(occupied & (walls[..., 0] > 0)):
        ring, wall = max(abs(i - row), abs(j - column)), walls[i, j].astype(np.float64)
        length = np.hypot(wall[3], wall[4])
        if ring <= search and length >= 0.5 and wall[3:] @ normal >= 0.7 * length:
            candidates.append((ring, np.hypot(wall[1] - x, wall[2] - y), [*wall[1:3], *(wall[3:] / length)]))
    if not candidates:
        return None
    first = min(ring for ring, _, _ in candidates)
    return np.array(min((d, w) for ring, d, w in candidates if ring <= first + 1)[1])


def test_normal_equations_are_the_likelihoods_gradient() -> None:
    walls, occupied, points, normals = random_scene()
    pose, sigma, step = np.array([0.13, -0.21, 0.3]), 0.03, 1e-6
    partners = np.zeros((150, 5))
    point_to_line.find_walls(walls, occupied, *ORIGIN, CELL, pose, points, normals, 4, partners)
    information, gradient = np.full((3, 3), 9.0), np.full(3, 9.0)
    total = point_to_line.normal_equations(pose, points, partners, sigma, information, gradient)

    def down(at: Array) -> float:
        return -float(point_to_line.log_likelihoods(at[None], points, partners, sigma)[0])

    numerical = [(down(pose + step * axis) - down(pose - step * axis)) / (2 * step) for axis in np.eye(3)]
    np.testing.assert_allclose(gradient, numerical, rtol=1e-4, atol=1e-3)
    distance, jacobian = twin_distances(pose, points, partners)
    weight = 1 / (1 + (distance / (2 * sigma)) ** 2) ** 2
    assert total == pytest.approx(weight.sum())
    np.testing.assert_allclose(information, (jacobian.T * weight) @ jacobian / sigma**2, rtol=1e-9)


def twin_distances(pose: Array, points: Array, partners: Array) -> tuple[Array, Array]:
    """Distances (k,) of the paired points to their lines, and how they change with x, y and heading (k, 3)."""
    paired = partners[:, 4] > 0
    normal, away = partners[paired, 2:4], geometry.transform(pose, points)[paired] - partners[paired, :2]
    arm = geometry.transform(np.array([0, 0, pose[2]]), points)[paired]
    turn = normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1]
    return (normal * away).sum(axis=1), np.column_stack([normal, turn])


def test_log_likelihoods_by_hand() -> None:
    """On the line, 2 sigma off it, far off it, and without a partner: 0, -1, almost -2 and -2."""
    partners = np.array([[1.0, 0, 1, 0, 1], [1.0, 0, 1, 0, 1], [1.0, 0, 1, 0, 1], [9.0, 9, 1, 0, 0]])
    points = np.array([[1.0, 5.0], [1.2, 0.0], [50.0, 0.0], [0.0, 0.0]])
    each = [
        point_to_line.log_likelihoods(np.zeros((1, 3)), points[k : k + 1], partners[k : k + 1], 0.1)[0]
        for k in range(4)
    ]
    np.testing.assert_allclose(each, [0, -1, -2, -2], atol=1e-4)
    poses = np.array([[0.0, 0, 0], [0.2, 0, 0]])
    both = point_to_line.log_likelihoods(poses, points[:2], partners[:2], 0.1)
    np.testing.assert_allclose(both, [-1, -1 - 2 * 0.16 / 0.2], atol=1e-9)


def test_solve() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        root, b = rng.normal(size=(3, 3)), rng.normal(size=3)
        a = root @ root.T + 0.1 * np.eye(3)
        np.testing.assert_allclose(point_to_line.solve(a, b), np.linalg.solve(a, b), rtol=1e-7)


def run(start: Array, prior: Array, guess: Array | None = None) -> tuple[Array, Array, float]:
    points, normals = corner()
    walls, occupied = draw(points, normals)
    begin = start if guess is None else guess
    return point_to_line.match(
        walls, occupied, *ORIGIN, CELL, begin, prior, start, points, normals, 4, 0.03, 0.1, np.zeros((240, 5))
    )  # fmt: skip


def test_match_finds_the_pose_far_below_the_size_of_a_cell() -> None:
    pose, information, score = run(np.array([0.04, -0.05, 0.03]), 1e-3 * np.eye(3))
    np.testing.assert_allclose(pose, 0, atol=1e-4)
    assert score > 0.99
    # Per wall 120 points, tempered by 0.1, of 0.03 m: 120 * 0.1 / 0.0009.
    np.testing.assert_allclose(information[[0, 1], [0, 1]], 13333, rtol=0.01)


def test_the_prior_holds_the_match_in_proportion() -> None:
    """A prior as informative as the scan, 0.02 m away: the match ends half way."""
    pose, _, _ = run(np.array([0.02, 0.0, 0.0]), np.diag([13333.0, 13333.0, 1e9]))
    np.testing.assert_allclose(pose, [0.01, 0, 0], atol=1e-3)


def test_a_start_of_its_own_does_not_move_the_prior() -> None:
    prior = np.diag([13333.0, 13333.0, 1e9])
    pose, _, _ = run(np.array([-0.03, 0.0, 0.0]), prior, guess=np.array([0.02, 0.0, 0.0]))
    np.testing.assert_allclose(pose, [0.01, 0, 0], atol=1e-3)


def test_a_bare_wall_says_nothing_along_it() -> None:
    points, normals = corner()
    points, normals = points[:120], normals[:120]
    walls, occupied = draw(points, normals)
    guess = np.array([0.03, 0.02, 0.0])
    pose, information, _ = point_to_line.match(
        walls, occupied, *ORIGIN, CELL, guess, np.diag([1e-3, 1e-3, 1e6]), guess, points, normals, 4, 0.03, 0.1,
        np.zeros((120, 5)),
    )  # fmt: skip
    np.testing.assert_allclose(pose, [0, 0.02, 0], atol=2e-3)
    assert information[1, 1] < 1e-9 * information[0, 0]


def test_nothing_to_match_leaves_the_guess() -> None:
    walls, occupied = empty_map()
    guess = np.array([0.5, 0.5, 0.1])
    for m in (0, 5):
        pose, information, score = point_to_line.match(
            walls, occupied, *ORIGIN, CELL, guess, np.eye(3), guess, np.ones((m, 2)), np.ones((m, 2)), 4, 0.03, 0.1,
            np.zeros((m, 5)),
        )  # fmt: skip
        np.testing.assert_array_equal(pose, guess)
        assert score == 0 and not information.any()
