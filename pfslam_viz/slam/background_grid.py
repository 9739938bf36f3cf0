"""An occupancy grid that is written beside the loop."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid, Seen
from pfslam_viz.slam.worker import Task, Worker

Array = NDArray[np.float64]

BATCH = 16  # scans that are handed over at a time: waking a thread costs as much as writing one


class BackgroundGrid(OccupancyGrid):
    """An :class:`OccupancyGrid` whose scans a worker's other thread writes, some at a time; looked at, it has them all.

    For a map that every scan changes and few look at, as dead reckoning's.
    """

    def __init__(self, config: MapConfig, worker: Worker) -> None:
        self._written_grid, self._worker = OccupancyGrid(config), worker
        self._waiting: list[Seen] = []
        self._task: Task[None] = Task(lambda: None)

    def __getattr__(self, name: str) -> Any:
        """What a grid has and this one has not is the written one's, with every scan so far."""
        self._task.result()
        if self._waiting:
            waiting, self._waiting = self._waiting, []
            self._written_grid.add_all(waiting)
        return getattr(self._written_grid, name)

    def add(self, pose: Array, points: Array, lidar_position: Array) -> Array:
        """As in :class:`OccupancyGrid`; the arrays must not change any more."""
        from pfslam_viz.slam import kernels

        self._waiting.append((pose, points, lidar_position))
        if len(self._waiting) == BATCH:
            self.catch_up()
        return kernels.transform(pose, points)

    def catch_up(self) -> None:
        """Hand over the scans that wait, so that they are written when somebody looks."""
        if self._waiting:
            self._task.result()
            self._task = self._worker.submit(partial(self._written_grid.add_all, self._waiting))
            self._waiting = []
