"""Each kernel at the paper's size, beside the same in plain NumPy. Run it by name, it is not part of the tests:

python -m pytest benchmarks/test_kernels.py -o addopts=
"""

import math

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from benchmarks.literal_filter import LiteralMap, world
from pfslam_viz.compiling.compile import compile_all
from pfslam_viz.compiling.needed import needed
from pfslam_viz.config import Config, load_config
from pfslam_viz.slam import kernels, resampling
from pfslam_viz.slam.occupancy_grid import OccupancyGrid

pytest.importorskip("pytest_benchmark")

PARTICLES, BEAMS = 500, 1081
Array = NDArray[np.float64]
Line = NDArray[np.float32]


@pytest.fixture(scope="module")
def config() -> Config:
    paper = load_config("paper")
    compile_all(needed([paper]))
    return paper


@pytest.fixture(scope="module")
def scan() -> Array:
    """End points (m, 2) in a room of 12 x 8 m, seen from its middle, 270 degrees wide."""
    angles = np.radians(np.linspace(-135, 135, BEAMS))
    with np.errstate(divide="ignore"):
        ranges = np.minimum(6.0 / np.abs(np.cos(angles)), 4.0 / np.abs(np.sin(angles)))
    return np.stack([ranges * np.cos(angles), ranges * np.sin(angles)], axis=-1)


@pytest.fixture(scope="module")
def particles() -> Array:
    return np.random.default_rng(0).normal(0.0, [0.05, 0.05, 0.03], (PARTICLES, 3))


@pytest.fixture
def grid(config: Config, scan: Array) -> OccupancyGrid:
    grid = OccupancyGrid(config.map)
    grid.add(np.zeros(3), scan, np.zeros(2))
    return grid


@pytest.fixture
def literal(config: Config, scan: Array) -> LiteralMap:
    literal = LiteralMap(config)
    literal.add(np.zeros(3), scan, np.zeros(2))
    return literal


def test_correlate(benchmark, grid: OccupancyGrid, particles: Array, scan: Array) -> None:  # type: ignore[no-untyped-def]
    benchmark.group = "correlation, (26)"
    assert benchmark(grid.correlation, particles, scan).max() > 0


@njit(nogil=True, fastmath=True)
def _look_up(occupied: NDArray[np.uint8], size: int, particles: NDArray[np.float32], xs: Line, ys: Line) -> int:
    """What no correlation can do without: every end point turned by every particle, its cell found and read.

    ``occupied`` (size²,) is a square map round the origin, all else is in cells.
    """
    total = 0
    for k in range(len(particles)):
        x, y = particles[k, 0] + np.float32(size / 2), particles[k, 1] + np.float32(size / 2)
        c, s = np.float32(math.cos(particles[k, 2])), np.float32(math.sin(particles[k, 2]))
        hits = np.int32(0)
        for b in range(len(xs)):
            column = np.int32(x + c * xs[b] - s * ys[b])  # positive, so that to cut is to floor
            row = np.int32(y + s * xs[b] + c * ys[b])
            hits += np.int32(occupied[row * np.int32(size) + column])
        total += int(hits)
    return total


def test_correlate_limit(benchmark, grid: OccupancyGrid, particles: Array, scan: Array) -> None:  # type: ignore[no-untyped-def]
    """A loop that only turns, floors and looks up, on one thread; cells count as often as they are hit."""
    benchmark.group = "correlation, (26)"
    cells = 1.0 / grid.cell
    turned = (particles * [cells, cells, 1.0]).astype(np.float32)
    xs, ys = np.ascontiguousarray((scan * cells).astype(np.float32).T)
    assert benchmark(_look_up, np.ones(512 * 512, np.uint8), 512, turned, xs, ys) == PARTICLES * len(scan)


def test_correlate_numpy(benchmark, literal: LiteralMap, particles: Array, scan: Array) -> None:  # type: ignore[no-untyped-def]
    benchmark.group = "correlation, (26)"
    assert benchmark(lambda: literal.correlation(*world(particles, scan))).max() > 0


def test_write_scan(benchmark, grid: OccupancyGrid, scan: Array) -> None:  # type: ignore[no-untyped-def]
    benchmark.group = "map update, (28)"
    benchmark(grid.add, np.zeros(3), scan, np.zeros(2))


def test_write_scan_numpy(benchmark, literal: LiteralMap, scan: Array) -> None:  # type: ignore[no-untyped-def]
    benchmark.group = "map update, (28)"
    benchmark(literal.add, np.zeros(3), scan, np.zeros(2))


def test_project(benchmark, grid: OccupancyGrid, scan: Array) -> None:  # type: ignore[no-untyped-def]
    benchmark.group = "end points, (23)"
    benchmark(grid.project, np.array([0.1, 0.2, 0.3]), scan)


def test_moments(benchmark, particles: Array) -> None:  # type: ignore[no-untyped-def]
    benchmark.group = "mean, covariance, N_eff, (30) and (33)"
    benchmark(kernels.moments, particles, np.full(PARTICLES, 1 / PARTICLES))


@pytest.mark.parametrize("scheme", sorted(resampling.SCHEMES))
def test_resample(benchmark, scheme: str) -> None:  # type: ignore[no-untyped-def]
    benchmark.group = "resampling, (31)"
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(PARTICLES))
    benchmark(resampling.SCHEMES[scheme], weights, rng)
