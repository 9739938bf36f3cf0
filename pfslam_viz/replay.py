"""The loop: a recording goes in, a Step for every scan comes out."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.step import Step

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Result:
    """What is known when the last scan is in. Poses are (n, 3) in the frame of the first pose.

    Attributes:
        recording: what was replayed.
        config: with which settings.
        stamps: (n,) s, the scans'.
        estimate: the whole trajectory as known at the end.
        online: each pose as it was estimated then (the best particle).
        dead_reckoning: by odometry alone.
        truth: (n, 3) at the scans' stamps, moved to start at the origin, if known.
        grid: the final map.
        dead_reckoning_grid: dead reckoning's.
        seconds: (n,) per phase.
        resamplings: how many scans were followed by resampling.
        uninformative: how many scans had no correlation with the map.
        interrupted: whether the run was stopped before the last scan.
    """

    recording: Recording
    config: Config
    stamps: Array
    estimate: Array
    online: Array
    dead_reckoning: Array
    truth: Array | None
    grid: OccupancyGrid
    dead_reckoning_grid: OccupancyGrid
    seconds: dict[str, Array]
    resamplings: int
    uninformative: int
    interrupted: bool


class Replay:
    """Iterate over it for the Steps; then ask it for the Result."""

    def __init__(self, recording: Recording, config: Config) -> None: ...

    def __iter__(self) -> Iterator[Step]: ...

    def result(self) -> Result:
        """The Result after the iteration, or of what was done so far."""
        ...
