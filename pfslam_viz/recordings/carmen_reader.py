"""CARMEN logs as the catalog sees them."""

from pathlib import Path

from pfslam_viz.recordings import carmen
from pfslam_viz.recordings.formats import Glance, LoadOptions, Place, Reader
from pfslam_viz.recordings.recording import Recording


class CarmenReader(Reader):
    """A log is a file; true relations may lie beside it."""

    def load(self, place: Place, options: LoadOptions) -> Recording:
        """As :func:`pfslam_viz.recordings.carmen.load`."""
        return carmen.load(place.path, place.name)

    def looks_like(self, path: Path) -> bool:
        """Whether it begins like a log of CARMEN's rather than of some other program."""
        return carmen.looks_like_log(path)

    def glance(self, place: Place) -> Glance:
        """Its length is not known without reading it."""
        relations = place.path.with_name(f"{carmen.log_name(place.path)}.relations").exists()
        return Glance("lidar, odometry" + (", relations" if relations else ""))


READER = CarmenReader()
