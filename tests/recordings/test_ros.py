"""Bags written by rosbags itself, with numbers that can be worked out by hand."""

import math
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import carmen, ros
from pfslam_viz.recordings.recording import Recording

pytest.importorskip("rosbags.rosbag1", reason="needs rosbags: pip install 'pfslam-viz[ros]'")

KINDS = ("bag", "db3", "mcap")
Pose = tuple[float, float, float]
LEVEL = (0.0, 0.0, 0.0, 1.0)
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)  # roll pi


def yaw(angle: float) -> tuple[float, float, float, float]:
    return (0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))


class Writer:
    """Collects messages, and writes them as a ROS 1 bag or as a folder of sqlite3 or MCAP."""

    def __init__(self, kind: str) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.kind = kind
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
        if kind == "bag":
            definition = "geometry_msgs/TransformStamped[] transforms"
            self.store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
        self.messages: list[tuple[str, Any, float]] = []
        self.silent: list[tuple[str, str]] = []  # topics without messages, and their types

    def make(self, name: str, **fields: Any) -> Any:
        return self.store.types[name](**fields)

    def header(self, stamp: float, frame: str) -> Any:
        seconds = math.floor(stamp)
        time = self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=round((stamp - seconds) * 1e9))
        sequence = {"seq": 0} if self.kind == "bag" else {}
        return self.make("std_msgs/msg/Header", **sequence, stamp=time, frame_id=frame)

    def scan(
        self,
        stamp: float,
        ranges: Sequence[float],
        first: float = -math.pi / 2,
        step: float = math.pi / 2,
        topic: str = "/scan",
        frame: str = "laser",
        received: float | None = None,
        **fields: float,
    ) -> None:
        limits = {"range_min": 0.1, "range_max": 30.0, "time_increment": 0.0, "scan_time": 0.0, **fields}
        message = self.make(
            "sensor_msgs/msg/LaserScan",
            header=self.header(stamp, frame),
            angle_min=first,
            angle_max=2 * math.pi,  # wrong, as it often is
            angle_increment=step,
            ranges=np.array(ranges, dtype=np.float32),
            intensities=np.zeros(0, dtype=np.float32),
            **limits,
        )
        self.messages.append((topic, message, stamp if received is None else received))

    def odometry(
        self, stamp: float, pose: Pose, child: str = "base_link", topic: str = "/odom", received: float | None = None
    ) -> None:
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        place = self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=pose[0], y=pose[1], z=0.0),
            orientation=self.quaternion(yaw(pose[2])),
        )
        none = np.zeros(36)
        message = self.make(
            "nav_msgs/msg/Odometry",
            header=self.header(stamp, "odom"),
            child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=none),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero),
                covariance=none,
            ),
        )
        self.messages.append((topic, message, stamp if received is None else received))

    def quaternion(self, turn: Sequence[float]) -> Any:
        x, y, z, w = turn
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def transform(
        self,
        parent: str,
        child: str,
        place: Sequence[float],
        turn: Sequence[float] = LEVEL,
        stamp: float = 100.0,
        topic: str = "/tf_static",
    ) -> None:
        x, y, z = place
        one = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp, parent),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
                rotation=self.quaternion(turn),
            ),
        )
        self.messages.append((topic, self.make("tf2_msgs/msg/TFMessage", transforms=[one]), stamp))

    def write(self, folder: Path, name: str = "drive", chunk: int = 1 << 20) -> Path:
        if self.kind == "bag":
            from rosbags.rosbag1 import Writer as Writer1

            path = folder / f"{name}.bag"
            writer: Any = Writer1(path)
            writer.chunk_threshold = chunk
            pack = self.store.serialize_ros1
        else:
            from rosbags.rosbag2 import StoragePlugin
            from rosbags.rosbag2 import Writer as Writer2

            path = folder / name
            plugin = StoragePlugin.SQLITE3 if self.kind == "db3" else StoragePlugin.MCAP
            writer = Writer2(path, version=9, storage_plugin=plugin)
            pack = self.store.serialize_cdr
        with writer:
            connections: dict[str, Any] = {}
            for topic, kind in self.silent:
                writer.add_connection(topic, kind, typestore=self.store)
            for topic, message, received in self.messages:
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=self.store)
                writer.write(connections[topic], round(received * 1e9), pack(message, kind))
        return path


def drive(kind: str = "bag") -> Writer:
    """Three scans from 100.5 s on, a metre ahead between the first two, a left turn of 90 degrees after it."""
    bag = Writer(kind)
    bag.transform("base_link", "laser", (0.25, 0.0, 0.5))
    for stamp, pose in ((100.0, (0, 0, 0)), (101.0, (2, 0, 0)), (102.0, (2, 0, 0)), (103.0, (2, 0, math.pi))):
        bag.odometry(stamp, pose)
    for stamp in (100.5, 101.0, 102.5):
        bag.scan(stamp, (1.0, 2.0, 3.0))
    return bag


def end_points(recording: Recording, scan: int = 0) -> NDArray[np.float64]:
    """(B, 2) in the robot's frame, by the definition of Lidar."""
    lidar, ranges = recording.lidar, recording.ranges[scan]
    points = np.stack([np.cos(lidar.angles), np.sin(lidar.angles)], axis=1) * ranges[:, None]
    return geometry.transform(lidar.pose, points)


@pytest.mark.parametrize("kind", KINDS)
def test_a_drive(tmp_path: Path, kind: str) -> None:
    path = drive(kind).write(tmp_path)
    assert ros.claims(path) and ros.looks_like(path)
    recording = ros.load(path)
    assert (recording.name, recording.format, recording.path) == ("drive", "ros", path)
    assert recording.stamps.tolist() == [100.5, 101.0, 102.5]
    assert recording.ranges.dtype == np.float32
    assert recording.ranges.tolist() == [[1.0, 2.0, 3.0]] * 3
    np.testing.assert_allclose(recording.lidar.angles, [-math.pi / 2, 0, math.pi / 2], atol=1e-6)
    assert (recording.lidar.range_min, recording.lidar.range_max) == (0.1, 30.0)
    assert recording.lidar.pose.tolist() == [0.25, 0.0, 0.0]
    assert recording.lidar.height == 0.5
    np.testing.assert_allclose(recording.odometry, np.array([(0, 0, 0), (1, 0, 0), (0, 0, math.pi / 2)]), atol=1e-9)
    assert recording.notes == ()
    assert [(s.name, len(s.stamps)) for s in recording.streams] == [("lidar", 3), ("odometry", 4)]


@pytest.mark.parametrize("kind", KINDS)
def test_description(tmp_path: Path, kind: str) -> None:
    told = ros.describe(drive(kind).write(tmp_path))
    assert list(told.topics) == [
        {"name": "/odom", "type": "nav_msgs/Odometry", "messages": 4, "rate_hz": 1.0},
        {"name": "/scan", "type": "sensor_msgs/LaserScan", "messages": 3, "rate_hz": 0.67},
        {"name": "/tf_static", "type": "tf2_msgs/TFMessage", "messages": 1, "rate_hz": None},
    ]
    used = told.used
    assert [used[key] for key in ("scan_topic", "scan_frame", "odometry", "base_frame")] == [
        "/scan",
        "laser",
        "/odom",
        "base_link",
    ]
    assert told.problem is None


@pytest.mark.parametrize("kind", KINDS)
def test_several_scan_topics_are_asked_for(tmp_path: Path, kind: str) -> None:
    bag = drive(kind)
    bag.scan(100.7, (4.0, 5.0), topic="/rear/scan", frame="/rear_laser")
    path = bag.write(tmp_path)
    expected = r"/rear/scan \(frame rear_laser, 1 messages\), /scan \(frame laser, 3 messages\); .*--scan-topic"
    with pytest.raises(InputError, match=expected):
        ros.load(path)
    told = ros.describe(path)
    assert "--scan-topic" in str(told.problem) and told.used == {}
    assert ros.load(path, scan_topic="rear/scan").ranges.tolist() == [[4.0, 5.0]]
    with pytest.raises(
        InputError, match=r"--scan-topic /odom: /odom is of type nav_msgs/Odometry; .*: /rear/scan, /sc"
    ):
        ros.load(path, scan_topic="/odom")
    with pytest.raises(InputError, match="no such topic"):
        ros.load(path, scan_topic="/nothing")


def test_several_odometry_topics_are_asked_for(tmp_path: Path) -> None:
    bag = drive()
    bag.odometry(100.0, (0, 0, 0), child="base_footprint", topic="/odom_filtered")
    bag.odometry(104.0, (4, 0, 0), child="base_footprint", topic="/odom_filtered")
    path = bag.write(tmp_path)
    expected = r"/odom \(child frame base_link, 4 messages\), /odom_filtered \(child frame base_f.*--odom-topic"
    with pytest.raises(InputError, match=expected):
        ros.load(path)
    assert ros.load(path, odom_topic="/odom_filtered").odometry[1].tolist() == [0.5, 0.0, 0.0]
    without = ros.load(path, odom_topic="none")
    assert not without.odometry.any()


def test_topics_without_messages_are_no_choice(tmp_path: Path) -> None:
    bag = drive()
    bag.silent = [("/scan_rear", "sensor_msgs/msg/LaserScan"), ("/odom_filtered", "nav_msgs/msg/Odometry")]
    path = bag.write(tmp_path)
    assert len(ros.load(path)) == 3
    with pytest.raises(InputError, match="the topic holds no messages"):
        ros.load(path, scan_topic="/scan_rear")


@pytest.mark.parametrize("kind", KINDS)
def test_odometry_from_transforms(tmp_path: Path, kind: str) -> None:
    """odom -> base_footprint moves, base_footprint -> base_link does not; /tf holds others too."""
    bag = Writer(kind)
    bag.transform("base_footprint", "base_link", (0.0, 0.0, 0.1))
    bag.transform("base_link", "laser", (0.2, 0.0, 0.3))
    for stamp, x, heading in ((100.0, 0.0, 0.0), (101.0, 1.0, 0.0), (102.0, 1.0, math.pi / 2)):
        bag.transform("odom", "base_footprint", (x, 0.0, 0.0), yaw(heading), stamp, "/tf")
        bag.transform("map", "odom", (stamp, 0.0, 0.0), LEVEL, stamp, "/tf")
        bag.transform("base_link", "wheel", (0.0, 0.2, 0.0), yaw(stamp), stamp, "/tf")
    for stamp in (100.5, 101.0, 101.5):
        bag.scan(stamp, (1.0, 2.0, 3.0))
    path = bag.write(tmp_path)
    recording = ros.load(path)
    # A rotation between 0 and 90 degrees, interpolated in its quaternion, is halfway at 45 degrees.
    np.testing.assert_allclose(recording.odometry, np.array([(0, 0, 0), (0.5, 0, 0), (0, 0, math.pi / 4)]), atol=1e-6)
    assert recording.lidar.pose.tolist() == [0.2, 0.0, 0.0]
    assert recording.lidar.height == pytest.approx(0.4)
    told = ros.describe(path).used
    assert (told["odometry"], told["base_frame"]) == ("transforms odom -> base_footprint", "base_footprint")


def test_odometry_in_transforms_turns_the_short_way(tmp_path: Path) -> None:
    bag = Writer("bag")
    for stamp, heading, sign in ((100.0, 3.0, 1), (101.0, 3.2, -1), (102.0, 3.4, 1)):
        turn = [sign * v for v in yaw(heading)]
        bag.transform("odom", "base_link", (0.0, 0.0, 0.0), turn, stamp, "/tf")
    for stamp in (100.0, 100.5, 101.5):
        bag.scan(stamp, (1.0, 2.0, 3.0), frame="base_link")
    np.testing.assert_allclose(ros.load(bag.write(tmp_path)).odometry[1:, 2], [0.1, 0.2], atol=1e-3)


def test_no_odometry_is_said(tmp_path: Path) -> None:
    bag = Writer("bag")
    bag.scan(100.0, (1.0, 2.0, 3.0))
    bag.scan(101.0, (1.0, 2.0, 3.0))
    recording = ros.load(bag.write(tmp_path))
    assert not recording.odometry.any()
    assert recording.lidar.pose.tolist() == [0.0, 0.0, 0.0]
    assert any("odometry: none" in note for note in recording.notes)
    assert any("no transform" in note and "'laser'" in note for note in recording.notes)


@pytest.mark.parametrize("topic", ["/tf_static", "/tf"])
def test_a_lidar_behind_and_upside_down(tmp_path: Path, topic: str) -> None:
    """Three links: up by 0.1 m; 0.2 m back and 0.05 m left, looking back; up by 0.3 m and rolled over.

    Looking back, the lidar's x axis is the robot's -x and its y axis the robot's -y; rolled over about x, y is the
    robot's +y again. So the beam ahead of 2 m ends at -0.2 - 2, that at +90 degrees of 3 m at 0.05 + 3 to the left,
    that at -90 degrees of 1 m at 0.05 - 1; that behind it of 4 m at -0.2 + 4, ahead of the robot.
    """
    bag = Writer("bag")
    bag.transform("base_footprint", "base_link", (0.0, 0.0, 0.1), topic=topic)
    bag.transform("base_link", "mast", (-0.2, 0.05, 0.0), yaw(math.pi), topic=topic)
    bag.transform("mast", "laser", (0.0, 0.0, 0.3), UPSIDE_DOWN, topic=topic)
    bag.odometry(100.0, (0, 0, 0), child="base_footprint")
    bag.scan(100.0, (1.0, 2.0, 3.0, 4.0), time_increment=0.001)
    bag.scan(101.0, (1.0, 2.0, 3.0, 4.0), time_increment=0.001)
    read = ros.read(bag.write(tmp_path))
    recording = read.recording
    assert recording.ranges[0].tolist() == [4.0, 3.0, 2.0, 1.0]
    expected = [[3.8, 0.05], [-0.2, 3.05], [-2.2, 0.05], [-0.2, -0.95]]
    np.testing.assert_allclose(end_points(recording), expected, atol=1e-6)
    assert (np.diff(recording.lidar.angles) > 0).all()
    assert recording.lidar.height == pytest.approx(0.4)
    # The message's first beam, of 1 m, is the last of the recording's.
    assert read.recording.beam_times is not None
    np.testing.assert_allclose(read.recording.beam_times, [0.003, 0.002, 0.001, 0.0])
    assert any("upside down" in note for note in recording.notes)


def test_the_base_is_linked_to_the_lidar_through_both_topics(tmp_path: Path) -> None:
    """/tf_static knows the lidar's place on base_link; where that is in the odometry's frame stands in /tf."""
    bag = Writer("bag")
    bag.transform("base_footprint", "base_link", (0.5, 0.0, 0.0), topic="/tf")
    bag.transform("base_link", "laser", (0.1, 0.0, 0.0))
    bag.odometry(100.0, (0, 0, 0), child="base_footprint")
    bag.scan(100.0, (1.0, 2.0, 3.0))
    recording = ros.load(bag.write(tmp_path))
    np.testing.assert_allclose(recording.lidar.pose, [0.6, 0, 0])
    assert recording.notes == ()


def test_leading_slashes(tmp_path: Path) -> None:
    bag = Writer("bag")
    bag.transform("/base_link", "/laser", (0.3, 0.0, 0.0))
    bag.odometry(100.0, (0, 0, 0), child="base_link")
    bag.scan(100.0, (1.0, 2.0, 3.0), frame="//laser")
    assert ros.load(bag.write(tmp_path)).lidar.pose.tolist() == [0.3, 0.0, 0.0]


def test_another_base_frame_than_that_of_the_odometry(tmp_path: Path) -> None:
    """base_link is 0.5 m ahead of base_footprint: as that turns left by 90°, it goes from (0.5, 0) to (0, 0.5)."""
    bag = Writer("bag")
    bag.transform("base_footprint", "base_link", (0.5, 0.0, 0.0))
    bag.transform("base_link", "laser", (0.1, 0.0, 0.0))
    bag.odometry(100.0, (0, 0, 0), child="base_footprint")
    bag.odometry(101.0, (0, 0, math.pi / 2), child="base_footprint")
    bag.scan(100.0, (1.0, 2.0, 3.0))
    bag.scan(101.0, (1.0, 2.0, 3.0))
    path = bag.write(tmp_path)
    own, other = ros.load(path), ros.load(path, base_frame="base_link")
    np.testing.assert_allclose(own.lidar.pose, [0.6, 0, 0])
    np.testing.assert_allclose(own.odometry[1], [0, 0, math.pi / 2], atol=1e-9)
    np.testing.assert_allclose(other.lidar.pose, [0.1, 0, 0])
    np.testing.assert_allclose(other.odometry[1], [-0.5, 0.5, math.pi / 2], atol=1e-9)
    with pytest.raises(
        InputError, match="--base-frame chassis: no such frame; there are base_footprint, base_link, laser"
    ):
        ros.load(path, base_frame="chassis")


def test_stamps_are_those_of_the_headers(tmp_path: Path) -> None:
    """Odometry received 0.7 s late must not shift the motion."""
    bag = Writer("bag")
    for k in range(4):
        bag.scan(100.0 + k, (1.0, 2.0, 3.0), frame="base_link", received=100.05 + k)
        bag.odometry(100.0 + k, (float(k * k), 0, 0), received=100.75 + k)
    recording = ros.load(bag.write(tmp_path))
    assert recording.stamps.tolist() == [100.0, 101.0, 102.0, 103.0]
    assert recording.odometry[:, 0].tolist() == [0.0, 1.0, 3.0, 5.0]


def test_receive_times_where_no_header_has_a_stamp(tmp_path: Path) -> None:
    """The odometry's header stamps are not used either: one clock is for all."""
    bag = Writer("bag")
    for k in range(3):
        bag.scan(0.0, (1.0, 2.0, 3.0), frame="base_link", received=100.0 + k)
        bag.odometry(5000.0 + k, (float(k), 0, 0), received=100.0 + k)
    recording = ros.load(bag.write(tmp_path))
    assert recording.stamps.tolist() == [100.0, 101.0, 102.0]
    assert recording.odometry[:, 0].tolist() == [0.0, 1.0, 1.0]
    assert any("header stamps are zero" in note for note in recording.notes)


def test_scans_outside_the_odometry_are_said(tmp_path: Path) -> None:
    bag = drive()
    bag.scan(110.0, (1.0, 2.0, 3.0))
    recording = ros.load(bag.write(tmp_path))
    # The last pose is held: from 102.5 to 103 s the other half of the turn.
    np.testing.assert_allclose(recording.odometry[3], [0, 0, math.pi / 2], atol=1e-9)
    assert any("1 scans are before or after it" in note for note in recording.notes)


def test_backward_and_repeated_stamps(tmp_path: Path) -> None:
    bag = Writer("bag")
    for stamp, r in ((100.0, 1.0), (102.0, 4.0), (101.0, 2.0), (101.0, 3.0)):
        bag.scan(stamp, (r, r, r), received=200.0)
    recording = ros.load(bag.write(tmp_path))
    assert recording.stamps.tolist() == [100.0, 101.0, 101.5, 102.0]
    assert recording.ranges[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert any("backwards 1 times" in note for note in recording.notes)
    assert any("1 scans repeat" in note for note in recording.notes)


@pytest.mark.parametrize("kind", KINDS)
def test_no_laser_scan(tmp_path: Path, kind: str) -> None:
    bag = Writer(kind)
    bag.odometry(100.0, (0, 0, 0))
    header = bag.header(100.0, "laser")
    cloud = bag.make(
        "sensor_msgs/msg/PointCloud2",
        header=header,
        height=1,
        width=0,
        fields=[],
        is_bigendian=False,
        point_step=1,
        row_step=0,
        data=np.zeros(0, dtype=np.uint8),
        is_dense=True,
    )
    bag.messages.append(("/points", cloud, 100.0))
    path = bag.write(tmp_path)
    expected = (
        r"no sensor_msgs/LaserScan messages, only /odom \(nav_msgs/Odometry, 1\), /points \(sensor_msgs/PointCloud2"
    )
    with pytest.raises(InputError, match=expected):
        ros.load(path)
    assert "pointcloud_to_laserscan" in str(ros.describe(path).problem)
    assert ros.looks_like(path) == (kind != "mcap")


@pytest.mark.parametrize("kind", KINDS)
def test_empty(tmp_path: Path, kind: str) -> None:
    with pytest.raises(InputError, match="holds no messages"):
        ros.load(Writer(kind).write(tmp_path))
    nothing = tmp_path / f"nothing.{kind}"
    nothing.touch()
    assert ros.claims(nothing) and not ros.looks_like(nothing)
    with pytest.raises(InputError, match=rf"nothing\.{kind}: empty"):
        ros.load(nothing)
    with pytest.raises(InputError, match="no such file"):
        ros.load(tmp_path / f"missing.{kind}")


@pytest.mark.parametrize("kind", ["db3", "mcap"])
def test_a_folder_without_metadata(tmp_path: Path, kind: str) -> None:
    path = drive(kind).write(tmp_path)
    whole = ros.load(path)
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: [broken")
    broken = ros.load(path)
    (path / "metadata.yaml").unlink()
    assert ros.claims(path) == (kind == "db3")
    for recording, what in ((broken, "metadata.yaml cannot be used"), (ros.load(path), "metadata.yaml is missing")):
        assert np.array_equal(recording.ranges, whole.ranges)
        assert np.array_equal(recording.odometry, whole.odometry)
        assert len(recording.notes) == 1 and what in recording.notes[0]


def test_a_split_recording_without_metadata_and_a_folder_of_several(tmp_path: Path) -> None:
    first, second = Writer("db3"), Writer("db3")
    first.scan(100.0, (1.0, 2.0, 3.0))
    second.scan(101.0, (4.0, 5.0, 6.0))
    folder = tmp_path / "parts"
    folder.mkdir()
    for name, bag in (("drive_2", first), ("drive_10", second)):
        (bag.write(tmp_path, name) / f"{name}.db3").rename(folder / f"{name}.db3")
    assert ros.load(folder).ranges.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    (folder / "drive_10.db3").rename(folder / "other.db3")
    with pytest.raises(InputError, match=r"several recordings: drive_2\.db3, other\.db3"):
        ros.load(folder)


@pytest.mark.parametrize("kind", KINDS)
def test_cut_in_half(tmp_path: Path, kind: str) -> None:
    """What a ROS 1 bag holds up to there is read; the others are refused in one line that names the file."""
    bag = Writer(kind)
    for k in range(40):
        bag.scan(100.0 + k, np.full(500, 1.0 + k).tolist(), step=0.01)
    path = bag.write(tmp_path, chunk=5000)
    file = path if kind == "bag" else path / f"drive.{kind}"
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 2])
    if kind == "bag":
        recording = ros.load(path)
        assert 15 <= len(recording) <= 20
        assert recording.ranges[:, 0].tolist() == [1.0 + k for k in range(len(recording))]
        assert any("cut off" in note for note in recording.notes)
        return
    for given in (path, file):
        with pytest.raises(InputError, match=rf"drive(\.{kind})?: ") as raised:
            ros.load(given)
        assert "\n" not in str(raised.value)


def test_a_wrong_length_in_the_index(tmp_path: Path) -> None:
    """As in bags of 2010: an index record's length is that of entries of 20 bytes."""
    from rosbags.rosbag1 import Reader

    path = drive().write(tmp_path)
    whole = ros.load(path)
    data = bytearray(path.read_bytes())
    found = 0
    for match in re.finditer(rb"\x2f\0\0\0(?=.{0,44}op=\x04)", bytes(data), re.DOTALL):
        at = match.start() + 4 + 47
        length = int.from_bytes(data[at : at + 4], "little")
        data[at : at + 4] = (length // 12 * 20).to_bytes(4, "little")
        found += 1
    assert found == 3  # one a topic
    path.write_bytes(data)
    with pytest.raises(AssertionError):
        Reader(path).open()
    recording = ros.load(path)
    assert np.array_equal(recording.ranges, whole.ranges)
    assert np.array_equal(recording.odometry, whole.odometry)
    assert recording.notes == (
        "the bag's index cannot be used (a record in it is inconsistent); its 8 messages are read without it",
    )


@pytest.mark.parametrize("suffix", KINDS)
def test_garbage_is_refused(tmp_path: Path, suffix: str) -> None:
    start = {"bag": b"#ROSBAG V2.0\n", "db3": b"SQLite format 3\0", "mcap": b"\x89MCAP0\r\n"}[suffix]
    for name, data in (("a", bytes(range(256)) * 8), ("b", start + bytes(range(256)) * 8), ("c", start)):
        path = tmp_path / f"{name}.{suffix}"
        path.write_bytes(data)
        with pytest.raises(InputError, match=rf"{name}\.{suffix}: ") as raised:
            ros.load(path)
        assert "\n" not in str(raised.value)


def test_bags_without_definitions_of_messages(tmp_path: Path) -> None:
    """As ROS 2 wrote them before Iron: an sqlite3 file of an older schema."""
    import sqlite3

    path = drive("db3").write(tmp_path)
    whole = ros.load(path)
    with sqlite3.connect(path / "drive.db3") as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("UPDATE schema SET schema_version = 3")
    database.close()
    recording = ros.load(path / "drive.db3")
    assert np.array_equal(recording.ranges, whole.ranges)
    assert np.array_equal(recording.odometry, whole.odometry)


def test_without_rosbags_the_command_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = drive().write(tmp_path)
    monkeypatch.setitem(sys.modules, "rosbags.rosbag1", None)
    with pytest.raises(InputError, match=r"pip install 'pfslam-viz\[ros\]'"):
        ros.load(path)
    assert ros.claims(path) and ros.looks_like(path)


@pytest.mark.parametrize("name", ["intel600.bag", "intel600_db3", "intel600_mcap"])
def test_the_same_drive_as_its_carmen_log(shared_data: Path, name: str) -> None:
    log = carmen.load(shared_data / "carmen" / "intel.clf.bz2").select(stop=600)
    recording = ros.load(shared_data / "bags" / name)
    np.testing.assert_allclose(recording.stamps, log.stamps, atol=1e-6)
    np.testing.assert_allclose(recording.odometry, log.odometry, atol=1e-9)
    np.testing.assert_allclose(recording.lidar.angles, log.lidar.angles, rtol=0, atol=1e-15)

    def returns(r: Recording) -> NDArray[np.float32]:
        return np.where((r.ranges >= r.lidar.range_min) & (r.ranges <= r.lidar.range_max), r.ranges, np.float32(0))

    assert np.array_equal(returns(recording), returns(log))


def test_a_bag_of_2010(shared_data: Path) -> None:
    """The same scans as lie beside it in the course's layout."""
    recording = ros.load(shared_data / "bags" / "ccny_demo.bag")
    assert recording.ranges.shape == (360, 681)
    np.testing.assert_allclose(np.degrees(recording.lidar.angles[[0, -1]]), [-119.53, 119.53], atol=0.01)
    assert (recording.lidar.range_max, len(recording.notes)) == (5.6, 3)
    (beside,) = (shared_data / "real" / "ccny").glob("**/Hokuyo*.npz")
    ranges = np.nan_to_num(np.load(beside)["ranges"].T, posinf=0.0, neginf=0.0)
    assert np.abs(recording.ranges - ranges).max() < 1e-3


def test_a_simulated_turtlebot(shared_data: Path) -> None:
    recording = ros.load(shared_data / "bags" / "oko_turtlebot3_scan2.bag")
    assert recording.ranges.shape == (538, 128)
    np.testing.assert_allclose(recording.lidar.angles[:2], [0, 0.0494739], atol=1e-6)
    assert recording.ranges[0, :5].round(4).tolist() == pytest.approx([0, 0, 0, 0, 2.0174])
