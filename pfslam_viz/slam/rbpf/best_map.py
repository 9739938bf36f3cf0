"""One particle's map, looked at as an occupancy grid."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import Array, OccupancyGrid
from pfslam_viz.slam.rbpf.tile_maps import TileMaps

LOOKED_AT = frozenset({"log_odds", "occupied", "origin", "shape", "lower_left"})


class BestMap(OccupancyGrid):
    """The occupancy grid of one map of :class:`TileMaps`: copied out of the tiles when somebody looks, not before."""

    def __init__(self, config: MapConfig, maps: TileMaps) -> None:
        self._stale = False
        super().__init__(config)
        self._maps, self._index = maps, 0

    def follow(self, index: int) -> None:
        """From now on this is map ``index``, as it will be when looked at."""
        self._index, self._stale = index, True

    def show(self, maps: TileMaps, index: int) -> None:
        """From now on this is a map of other ``maps``."""
        self._maps = maps
        self.follow(index)

    def project(self, pose: Array, points: Array) -> tuple[Array, NDArray[np.bool_]]:
        """As in :class:`OccupancyGrid`, straight from the tiles."""
        return self._maps.project(self._index, pose, points)

    def __getattribute__(self, name: str) -> object:
        if name in LOOKED_AT and super().__getattribute__("_stale"):
            self._refresh()
        return super().__getattribute__(name)

    def _refresh(self) -> None:
        self._stale = False
        self.log_odds, self.origin = self._maps.log_odds_of(self._index)
        self.occupied = (self.log_odds > self.config.threshold).view("uint8")
