"""MRPT rawlogs as the catalog sees them."""

from pathlib import Path

from pfslam_viz.recordings import rawlog
from pfslam_viz.recordings.formats import LoadOptions, Place, Reader
from pfslam_viz.recordings.recording import Recording


class RawlogReader(Reader):
    """A rawlog is a file."""

    def load(self, place: Place, options: LoadOptions) -> Recording:
        """As :func:`pfslam_viz.recordings.rawlog.load`."""
        return rawlog.load(place.path, place.name)

    def looks_like(self, path: Path) -> bool:
        """Whether it begins with an object of MRPT's."""
        return rawlog.looks_like(path)


READER = RawlogReader()
