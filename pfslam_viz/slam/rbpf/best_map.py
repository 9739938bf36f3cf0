"""One particle's map, looked at as an occupancy grid."""

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import Array, OccupancyGrid
from pfslam_viz.slam.rbpf.tile_maps import TileMaps
from pfslam_viz.slam.tiles import Box, Tiled


class BestMap(OccupancyGrid):
    """The occupancy grid of one map of :class:`TileMaps`: copied out of the tiles when somebody looks, not before.

    :meth:`tiled` copies nothing.
    """

    def __init__(self, config: MapConfig, maps: TileMaps) -> None:
        super().__init__(config)
        self._numbers[3] = np.float32(config.threshold)
        self._maps, self._index, self._stale = maps, 0, False
        self._dense = self._cells.arrays["log_odds"], self._cells.origin

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

    def tiled(self) -> Tiled:
        """As in :class:`OccupancyGrid`, without a copy."""
        return self._maps.tiled(self._index)

    def box(self) -> Box:
        """As in :class:`OccupancyGrid`, without a copy."""
        return self._maps.box()

    def window(self) -> tuple[NDArray[np.uint8], tuple[int, int]]:
        """All of the map, and where its origin lies."""
        return self.occupied, self.origin

    @property
    def log_odds(self) -> NDArray[np.float32]:
        """(rows, columns); 0 is unknown."""
        return self._refresh()[0]

    @property
    def occupied(self) -> NDArray[np.uint8]:
        """(rows, columns); 1 where log_odds > threshold, (29)."""
        return (self.log_odds > self._numbers[3]).view(np.uint8)

    @property
    def origin(self) -> tuple[int, int]:
        """Row and column of the cell at the world's origin, (24) and (25)."""
        return self._refresh()[1]

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.log_odds.shape
        return rows, columns

    def _refresh(self) -> tuple[NDArray[np.float32], tuple[int, int]]:
        if self._stale:
            self._stale = False
            self._dense = self._maps.log_odds_of(self._index)
        return self._dense
