"""ROS bags as the catalog sees them: a file, or the folder that ROS 2 records into."""

from pathlib import Path

from pfslam_viz.recordings import ros_claims
from pfslam_viz.recordings.formats import Contents, Format, Glance, LoadOptions, Place, Reader
from pfslam_viz.recordings.recording import Recording


class RosReader(Reader):
    """A bag is a .bag, .db3 or .mcap file, or a folder with metadata.yaml; what is in it, rosbags reads."""

    def load(self, place: Place, options: LoadOptions) -> Recording:
        """As :func:`pfslam_viz.recordings.ros.load`."""
        from pfslam_viz.recordings import ros

        return ros.load(
            place.path,
            place.name,
            scan_topic=options.scan_topic,
            odom_topic=options.odom_topic,
            base_frame=options.base_frame,
        )

    def contents(self, place: Place, options: LoadOptions) -> Contents:
        """Topics, types, counts and rates, and what of them is read."""
        from pfslam_viz.recordings import ros

        about = ros.describe(
            place.path,
            scan_topic=options.scan_topic,
            odom_topic=options.odom_topic,
            base_frame=options.base_frame,
        )
        return Contents(about.topics, about.used, about.problem)

    def find(self, folder: Path, row: Format) -> list[Place]:
        """The folder itself if it is a ROS 2 bag, else the bags in it."""
        if ros_claims.claims(folder):
            return [self.place(folder, row)]
        return super().find(folder, row)

    def place(self, path: Path, row: Format) -> Place:
        """The bag, called as its file or folder."""
        return Place(ros_claims.recording_name(path.resolve()), path, row.name)

    def looks_like(self, path: Path) -> bool:
        """Whether it is a bag; an .mcap only if it holds a LaserScan, since Rerun opens others itself."""
        return ros_claims.looks_like(path)

    def glance(self, place: Place) -> Glance:
        """What is in a bag is not known without opening it."""
        return Glance("ROS topics")


READER = RosReader()
