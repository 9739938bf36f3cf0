"""Which topics of a ROS recording are meant: by type, and asked for with a list where several fit."""

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.ros_bag import LASER_SCAN, ODOMETRY, TRANSFORMS, Bag, Topic, short_type
from pfslam_viz.recordings.ros_transforms import frame_name

# Types that hold what a lidar or depth camera saw, too, and what to do with them.
_OTHER_SCANS = {
    "sensor_msgs/msg/MultiEchoLaserScan": "laser_proc splits it into LaserScans",
    "sensor_msgs/msg/PointCloud2": "pointcloud_to_laserscan makes LaserScans of it",
    "sensor_msgs/msg/PointCloud": "pointcloud_to_laserscan makes LaserScans of it",
}


def choose_scans(bag: Bag, wanted: str | None) -> str:
    """The topic of the scans. Raises InputError when there is none, several, or not the wanted one."""
    topics = bag.of_type(LASER_SCAN)
    if wanted is not None:
        return _named(bag, wanted, (LASER_SCAN,), "--scan-topic").name
    if len(topics) == 1:
        return topics[0].name
    if topics:
        listed = _listed(bag, topics, "frame")
        raise InputError(f"{bag.path}: several topics hold laser scans: {listed}; choose one with --scan-topic")
    if not any(topic.messages for topic in bag.topics.values()):
        raise InputError(f"{bag.path}: holds no messages")
    listed = ", ".join(f"{t.name} ({short_type(t.type)}, {t.messages})" for t in bag.topics.values())
    hints = {t.type: _OTHER_SCANS[t.type] for t in bag.topics.values() if t.type in _OTHER_SCANS and t.messages}
    hint = "".join(f"; {short_type(kind)} is not read: {what}" for kind, what in hints.items())
    raise InputError(f"{bag.path}: holds no sensor_msgs/LaserScan messages, only {listed}{hint}")


def choose_odometry(bag: Bag, wanted: str | None) -> str | None:
    """The topic of the odometry, None if there is no nav_msgs/Odometry or ``none`` is wanted.

    Raises InputError when there are several, or not the wanted one.
    """
    if wanted == "none":
        return None
    if wanted is not None:
        return _named(bag, wanted, (ODOMETRY, *TRANSFORMS), "--odom-topic").name
    topics = bag.of_type(ODOMETRY)
    if len(topics) > 1:
        listed = _listed(bag, topics, "child frame")
        raise InputError(f"{bag.path}: several topics hold odometry: {listed}; choose one with --odom-topic")
    return topics[0].name if topics else None


def _named(bag: Bag, name: str, types: tuple[str, ...], option: str) -> Topic:
    """The topic of this name, with or without the leading slash."""
    topic = bag.topics.get(name) or bag.topics.get("/" + name.lstrip("/"))
    if topic is None or topic.type not in types:
        has = ", ".join(t.name for t in bag.of_type(*types)) or "none"
        what = "no such topic" if topic is None else f"{name} is of type {short_type(topic.type)}"
        raise InputError(f"{bag.path}: {option} {name}: {what}; topics of {short_type(types[0])}: {has}")
    if topic.messages == 0:
        raise InputError(f"{bag.path}: {option} {name}: the topic holds no messages")
    return topic


def _listed(bag: Bag, topics: list[Topic], what: str) -> str:
    """The topics with the frame of their first message and their counts."""
    frames: dict[str, str] = {}
    for topic, _, message in bag.messages({topic.name for topic in topics}):
        frame = message.child_frame_id if what == "child frame" else message.header.frame_id
        frames.setdefault(topic, frame_name(frame))
        if len(frames) == len(topics):
            break
    return ", ".join(f"{t.name} ({what} {frames.get(t.name, '?')}, {t.messages} messages)" for t in topics)
