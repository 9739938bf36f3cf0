"""Every kernel against a plain NumPy twin on random input."""

import math
import threading

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam import kernels

Array = NDArray[np.float64]

ORIGIN = (23, 17)
CELL = 0.1
SHAPE = (40, 50)


def random_map(rng: np.random.Generator, share: float = 0.3) -> NDArray[np.uint8]:
    """A map with random occupied cells, but for the outermost ring."""
    occupied = (rng.random(SHAPE) < share).astype(np.uint8)
    occupied[[0, -1]] = 0
    occupied[:, [0, -1]] = 0
    return occupied


def random_poses(rng: np.random.Generator, n: int) -> Array:
    return rng.uniform([-1.0, -1.0, -math.pi], [2.0, 1.5, math.pi], (n, 3))


def scan(rng: np.random.Generator, kind: str) -> Array:
    """End points (m, 2) in the robot's frame."""
    if kind == "empty":
        return np.zeros((0, 2))
    if kind == "axes":  # rays along the axes, and end points on the robot itself
        return np.array([[1.03, 0.0], [0.0, 1.03], [-1.03, 0.0], [0.0, -1.03], [0.0, 0.0], [0.52, 0.52], [-0.52, 0.52]])
    reach = 30.0 if kind == "outside" else 1.5
    angles = np.linspace(-2.4, 2.4, 271)
    points: Array = rng.uniform(0.1, reach, (271, 1)) * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return points


def cells_of(world: Array) -> NDArray[np.int64]:
    """(24) and (25) as printed."""
    i = np.floor(-world[:, 1] / CELL) + ORIGIN[0]
    j = np.floor(world[:, 0] / CELL) + ORIGIN[1]
    return np.stack([i, j], axis=1).astype(np.int64)


def correlation_twin(poses: Array, points: Array, occupied: NDArray[np.uint8]) -> list[int]:
    counts = []
    for pose in poses:
        marked = {tuple(c) for c in cells_of(geometry.transform(pose, points)).tolist()}
        counts.append(sum(occupied[i, j] for i, j in marked if 0 <= i < SHAPE[0] and 0 <= j < SHAPE[1]))
    return counts


def clear_of_edges(poses: Array, point: Array) -> bool:
    """Whether the end point falls well inside a cell from every pose: the kernel rounds to float32."""
    world = np.array([geometry.transform(pose, point[None])[0] for pose in poses]) / CELL
    return bool((np.abs(world - np.round(world)) > 2e-4).all())


def correlate(poses: Array, points: Array, occupied: NDArray[np.uint8], marks: NDArray[np.uint8]) -> NDArray[np.int64]:
    counts = np.full(len(poses), -1)
    kernels.correlate(poses, points, occupied, *ORIGIN, CELL, marks, counts, np.zeros(2, np.int64))
    return counts


@pytest.mark.parametrize("kind", ["inside", "outside", "axes", "empty"])
@pytest.mark.parametrize("count", [40, 254, 600])  # marks are used up after 254 poses
def test_correlate(kind: str, count: int) -> None:
    rng = np.random.default_rng(3)
    occupied, points, poses = random_map(rng), scan(rng, kind), random_poses(rng, count)
    points = points[:: 1 + count // 200] if len(points) > 100 else points
    if kind == "axes":
        poses[:20, 2] = 0.0
        poses[:5, :2] = 0.013, 0.017  # well inside a cell, so that no rounding decides
    points = points[[clear_of_edges(poses, point) for point in points]] if len(points) else points
    assert kind == "empty" or len(points) > 0
    twin, marks = correlation_twin(poses, points, occupied), rng.integers(0, 256, SHAPE).astype(np.uint8)
    for _ in range(2):  # whatever the scratch grid holds
        assert correlate(poses, points, occupied, marks).tolist() == twin


@pytest.mark.parametrize("y", [-30.0, -1.6, -1.2, 0.0, 1.9, 2.2, 40.0])
def test_correlate_from_any_height_in_the_grid_and_beyond(y: float) -> None:
    """Only the rows within the scan's reach are prepared: here 3 of the grid's 40 and some to spare, or none."""
    rng = np.random.default_rng(11)
    occupied, marks = random_map(rng, share=0.8), np.full(SHAPE, 7, np.uint8)
    poses = np.column_stack([np.full(20, 0.043), rng.uniform(y - 0.05, y + 0.05, 20), rng.uniform(-3, 3, 20)])
    points = rng.uniform(-0.1, 0.1, (30, 2))
    points = points[[clear_of_edges(poses, point) for point in points]]
    counts = correlate(poses, points, occupied, marks)
    assert counts.tolist() == correlation_twin(poses, points, occupied)
    assert max(counts) > 0 or not -1.7 < y < 2.3


def test_correlate_does_not_depend_on_which_other_poses_there_are() -> None:
    """Bit for bit, on the very edges of cells too: threads may share the poses as they like."""
    rng = np.random.default_rng(12)
    occupied, marks = random_map(rng), np.zeros(SHAPE, np.uint8)
    points, poses = np.round(scan(rng, "inside"), 1), random_poses(rng, 300)
    poses[:, :2], poses[:, 2] = np.round(poses[:, :2], 1), rng.integers(-2, 2, 300) * (math.pi / 2)
    together = correlate(poses, points, occupied, marks)
    apart = [correlate(poses[k : k + 7], points, occupied, marks) for k in range(0, 300, 7)]
    assert together.max() > 0
    np.testing.assert_array_equal(np.concatenate(apart), together)


@pytest.mark.parametrize("count", [1, 16, 17, 1000])
def test_threads_that_share_their_progress_correlate_every_pose_once(count: int) -> None:
    """Whoever comes to it first: three threads at the same time, and one that comes when all is done."""
    rng = np.random.default_rng(13)
    occupied, points, poses = random_map(rng), scan(rng, "inside"), random_poses(rng, count)
    expected = correlate(poses, points, occupied, np.zeros(SHAPE, np.uint8))
    counts, progress, seen = np.full(count, -1), np.zeros(2, np.int64), []

    def take(together: threading.Barrier) -> None:
        marks = np.full(SHAPE, 9, np.uint8)
        together.wait()
        kernels.correlate(poses, points, occupied, *ORIGIN, CELL, marks, counts, progress)
        seen.append(counts.copy())  # whoever returns finds everything done

    together, alone = threading.Barrier(3), threading.Barrier(1)
    threads = [threading.Thread(target=take, args=(together,)) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    take(alone)
    assert progress[1] == count
    assert len(seen) == 4
    for found in seen:
        np.testing.assert_array_equal(found, expected)


def test_correlate_returns_when_other_threads_are_done_too() -> None:
    rng, progress, marks = np.random.default_rng(14), np.array([20, 15]), np.zeros(SHAPE, np.uint8)  # 5 are worked on
    occupied, points, poses, counts = random_map(rng), scan(rng, "inside"), random_poses(rng, 20), np.full(20, -1)
    arguments = (poses, points, occupied, *ORIGIN, CELL, marks, counts, progress)
    thread = threading.Thread(target=kernels.correlate, args=arguments)
    thread.start()
    thread.join(0.05)
    waiting = thread.is_alive()
    progress[1] = 20
    thread.join(20)
    assert waiting and not thread.is_alive()
    assert counts.tolist() == 20 * [-1]  # none was left for it


def test_correlate_counts_a_cell_once_wherever_its_beams_are_in_the_scan() -> None:
    occupied = np.zeros(SHAPE, np.uint8)
    occupied[20, 20] = occupied[20, 21] = 1
    a, b = [0.35, 0.25], [0.45, 0.25]  # columns 20 and 21 of row 20
    points = np.array([a, a, b, a, [0.31, 0.29], *(60 * [[5.0, 5.0]]), a, b])
    assert correlate(np.zeros((1, 3)), points, occupied, np.zeros(SHAPE, np.uint8)).tolist() == [2]


@pytest.mark.parametrize("kind", ["inside", "outside", "axes", "empty"])
def test_project(kind: str) -> None:
    rng = np.random.default_rng(4)
    occupied, points, pose = random_map(rng), scan(rng, kind), np.array([0.213, -0.117, 0.4])
    world, hits = kernels.project(pose, points, occupied, *ORIGIN, CELL)
    twin = geometry.transform(pose, points)
    np.testing.assert_allclose(world, twin, atol=1e-12)
    expected = [0 <= i < SHAPE[0] and 0 <= j < SHAPE[1] and bool(occupied[i, j]) for i, j in cells_of(twin).tolist()]
    assert hits.tolist() == expected


@pytest.mark.parametrize("beams", [0, 1, 200])
def test_transform(beams: int) -> None:
    rng = np.random.default_rng(16)
    pose, points = np.array([0.4, -2.0, 2.2]), rng.normal(size=(beams, 2))
    np.testing.assert_allclose(kernels.transform(pose, points), geometry.transform(pose, points), atol=1e-12)


@pytest.mark.parametrize("beams", [0, 1, 200])
def test_read_scan(beams: int) -> None:
    rng = np.random.default_rng(9)
    ranges, directions = rng.uniform(0, 12, beams).astype(np.float32), rng.normal(size=(beams, 2))
    points = kernels.read_scan(ranges, directions, np.array([0.3, -0.1]), 1.0, 10.0)
    used = (ranges >= 1) & (ranges <= 10)
    np.testing.assert_allclose(points, np.array([0.3, -0.1]) + ranges[used, None] * directions[used], atol=1e-12)
    assert beams == 0 or beams == 1 or 0 < len(points) < beams


def test_move() -> None:
    rng = np.random.default_rng(6)
    poses, noise, increment = random_poses(rng, 50), rng.normal(0, 0.1, (50, 3)), np.array([0.3, -0.1, 2.5])
    moved = kernels.move(poses, increment, noise)
    twin = geometry.compose(poses, increment) + noise
    np.testing.assert_allclose(moved[:, :2], twin[:, :2], atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * moved[:, 2]), np.exp(1j * twin[:, 2]), atol=1e-12)
    assert (moved[:, 2] >= -math.pi).all() and (moved[:, 2] < math.pi).all()


def test_compose() -> None:
    rng = np.random.default_rng(10)
    for pose, increment in zip(random_poses(rng, 20), random_poses(rng, 20), strict=True):
        np.testing.assert_allclose(kernels.compose(pose, increment), geometry.compose(pose, increment), atol=1e-12)


def test_moments() -> None:
    rng = np.random.default_rng(7)
    poses, weights = random_poses(rng, 60), rng.random(60)
    poses[:, 2] = geometry.wrap(3.1 + rng.normal(0, 0.2, 60))  # across the seam at pi
    weights /= weights.sum()
    mean, covariance, n_eff = kernels.moments(poses, weights)
    np.testing.assert_allclose(mean, geometry.mean_pose(poses, weights), atol=1e-12)
    off = poses - mean
    off[:, 2] = geometry.wrap(off[:, 2])
    np.testing.assert_allclose(covariance, np.einsum("n,ni,nj->ij", weights, off, off), atol=1e-12)
    assert n_eff == pytest.approx(1 / np.sum(weights**2))


def test_pick() -> None:
    """Sorted positions against searchsorted; never a particle without weight, however the sums round."""
    rng = np.random.default_rng(14)
    for n in (1, 2, 50, 500):
        weights = rng.random(n) * (rng.random(n) < 0.6)
        weights[rng.integers(n)] = 0.5
        positions = np.sort(rng.random(200))
        drawn = kernels.pick(weights, positions)
        np.testing.assert_array_equal(drawn, np.searchsorted(np.cumsum(weights), positions * weights.sum(), "right"))
    ends = np.array([0.0, np.nextafter(1.0, 0.0), 1.0, 2.0])
    assert kernels.pick(np.array([0.0, 0.0, 0.1, 0.0, 0.2, 0.0]), ends).tolist() == [2, 4, 4, 4]
