"""The grid that another thread draws, against one that is drawn at once."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.background_grid import BATCH, BackgroundGrid
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.worker import Worker

CONFIG = MapConfig(cell=0.05)
SCANS = 3 * BATCH + 5


@pytest.fixture(params=[1, 2], ids=["one thread", "two threads"])
def worker(request: pytest.FixtureRequest) -> Iterator[Worker]:
    made = Worker(request.param)
    yield made
    made.close()


def scans() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """A drive of 27 m to the upper left, so that the grid grows, also in mid-batch; one scan is empty."""
    rng = np.random.default_rng(4)
    for k in range(SCANS):
        angles = np.linspace(-2, 2, 50)
        points = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * rng.uniform(0.5, 6, (50, 1))
        yield np.array([-0.8 * k, 0.5 * k, 0.1 * k]), points[: 0 if k == 7 else 50], np.array([0.1, 0.02])


def assert_same(grid: OccupancyGrid, plain: OccupancyGrid) -> None:
    assert grid.origin == plain.origin and grid.shape == plain.shape and grid.cell == plain.cell
    assert grid.lower_left == plain.lower_left
    np.testing.assert_array_equal(grid.log_odds, plain.log_odds)
    np.testing.assert_array_equal(grid.occupied, plain.occupied)


def test_it_holds_what_a_plain_grid_holds(worker: Worker) -> None:
    """Looked at only at the end, when some scans wait for their batch to fill."""
    grid, plain = BackgroundGrid(CONFIG, worker), OccupancyGrid(CONFIG)
    for scan in scans():
        np.testing.assert_allclose(grid.add(*scan), plain.add(*scan), atol=1e-12)
    assert plain.shape[1] > 600
    assert_same(grid, plain)


@pytest.mark.parametrize("every", [1, BATCH - 1, BATCH, BATCH + 1])
def test_every_look_is_up_to_date(worker: Worker, every: int) -> None:
    grid, plain = BackgroundGrid(CONFIG, worker), OccupancyGrid(CONFIG)
    assert_same(grid, plain)
    for k, scan in enumerate(scans()):
        grid.add(*scan)
        plain.add(*scan)
        if k % every == 0:
            assert_same(grid, plain)


def test_a_full_batch_is_drawn_without_a_look_and_a_part_is_not() -> None:
    worker = Worker(2)
    grid, plain = BackgroundGrid(CONFIG, worker), OccupancyGrid(CONFIG)
    for k, scan in enumerate(scans()):
        grid.add(*scan)
        if k < BATCH:
            plain.add(*scan)
        if k == BATCH + 1:
            break
    deadline = time.monotonic() + 20
    while not np.array_equal(grid._written_grid.log_odds, plain.log_odds) and time.monotonic() < deadline:
        time.sleep(0.001)
    np.testing.assert_array_equal(grid._written_grid.log_odds, plain.log_odds)
    worker.close()


def test_looking_starts_no_thread_again() -> None:
    """A replay closes its worker before anybody asks for the last scans."""
    worker = Worker(2)
    grid = BackgroundGrid(CONFIG, worker)
    for scan in scans():
        grid.add(*scan)
    worker.close()
    assert grid.log_odds.any() and worker._thread is None


def test_a_failure_shows_at_the_next_look(worker: Worker, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = BackgroundGrid(CONFIG, worker)

    def fail(self: OccupancyGrid, waiting: object) -> None:
        raise MemoryError

    monkeypatch.setattr(OccupancyGrid, "add_all", fail)
    for _, scan in zip(range(BATCH), scans(), strict=False):
        grid.add(*scan)
    with pytest.raises(MemoryError):
        grid.log_odds  # noqa: B018
