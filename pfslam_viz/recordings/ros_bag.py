"""ROS 1 bags, ROS 2 sqlite3 and MCAP files opened through rosbags: topics, and messages as they come.

Only messages of the types in :data:`TYPES` are deserialized, by the definitions that ROS ships: bags of ROS 2 before
Iron hold none. A ROS 1 bag whose definition is another one (by its MD5) is read by its own.
"""

from collections.abc import Collection, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.ros_claims import stem, storage_files
from pfslam_viz.recordings.ros_records import MAGIC, RecordError, RecordReader
from pfslam_viz.recordings.unpacking import bound_rosbags

LASER_SCAN = "sensor_msgs/msg/LaserScan"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
TYPES = (LASER_SCAN, ODOMETRY, *TRANSFORMS)


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic's name, type (``package/msg/Type``) and count of messages."""

    name: str
    type: str
    messages: int


class Bag:
    """An open recording of ROS's; a context manager.

    Attributes:
        path: the file or folder.
        ros: 1 or 2.
        topics: by name, in order of the name; a topic of several publishers is one.
        duration: s between the first and the last message.
        notes: what was wrong with the file and how it was read, a sentence each.
    """

    def __init__(self, path: Path) -> None:
        """Open it.

        Raises:
            InputError: rosbags is not installed; the path does not exist, is empty, damaged or no such recording.
        """
        self.path = path
        self.notes: list[str] = []
        self._stack = ExitStack()
        _need_rosbags(path)
        bound_rosbags()
        if not path.exists():
            raise InputError(f"{path}: no such file")
        self.ros = 1 if path.suffix.lower() == ".bag" and path.is_file() else 2
        try:
            self._readers: list[Any] = self._open_ros1() if self.ros == 1 else self._open_ros2()
        except BaseException:
            self._stack.close()
            raise
        self.topics = self._topics()
        self.duration = self._duration()
        self._stores: dict[tuple[str, str], Any] = {}

    def __enter__(self) -> "Bag":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None) -> None:
        self._stack.close()

    def of_type(self, *types: str) -> list[Topic]:
        """The topics of these types that hold messages."""
        return [topic for topic in self.topics.values() if topic.type in types and topic.messages]

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, receive time (ns) and message of every message of these topics, a file after the other.

        Messages that cannot be deserialized are left out; ``notes`` says so at the end, and which are missing.

        Raises:
            InputError: the file turns out to be damaged.
        """
        unreadable: dict[str, int] = {}
        missing = {name: topic.messages for name, topic in self.topics.items() if name in names}
        for reader in self._readers:
            wanted = [c for c in reader.connections if c.topic in names and c.msgtype in TYPES]
            if not wanted:
                continue
            try:
                for connection, received, raw in reader.messages(wanted):
                    missing[connection.topic] -= 1
                    try:
                        message = self._deserialize(connection, raw)
                    except Exception:  # of a great many kinds: struct.error, AssertionError, UnicodeDecodeError...
                        unreadable[connection.topic] = unreadable.get(connection.topic, 0) + 1
                        continue
                    yield connection.topic, received, message
            except InputError:
                raise
            except Exception as error:
                raise InputError(
                    f"{self.path}: damaged or only half copied ({_in_words(error)}); get it again"
                ) from None
        for topic, count in unreadable.items():
            self.notes.append(f"{topic}: {count} messages that cannot be read are left out")
        self.notes += [f"{topic}: {count} messages are missing" for topic, count in missing.items() if count > 0]

    def _deserialize(self, connection: Any, raw: bytes) -> Any:
        key = (connection.msgtype, connection.digest or "")
        if key not in self._stores:
            self._stores[key] = self._store(connection)
        if self.ros == 1:
            return self._stores[key].deserialize_ros1(raw, connection.msgtype)
        return self._stores[key].deserialize_cdr(raw, connection.msgtype)

    def _store(self, connection: Any) -> Any:
        """The definitions by which a connection's messages are read."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        store = get_typestore(Stores.ROS1_NOETIC if self.ros == 1 else Stores.ROS2_HUMBLE)
        name = connection.msgtype
        if name not in store.types:  # tf/tfMessage of old ROS 1
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
        if self.ros == 1 and connection.digest and connection.digest != store.generate_msgdef(name)[1]:
            text = connection.definition if isinstance(self._readers[0], RecordReader) else connection.msgdef.data
            if text:
                store = get_typestore(Stores.EMPTY)
                store.register(get_types_from_msg(text, name))
        return store

    def _open_ros1(self) -> list[Any]:
        from rosbags.rosbag1 import Reader

        try:
            with self.path.open("rb") as file:
                start = file.read(len(MAGIC))
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror}") from None
        if not start:
            raise InputError(f"{self.path}: empty")
        if start != MAGIC:
            hint = "of an old version; `rosbag migrate` (ROS 1) brings it up to date"
            raise InputError(f"{self.path}: {hint if start.startswith(b'#ROS') else 'not a ROS bag'}")
        try:
            reader = Reader(self.path)
            reader.open()
            self._stack.callback(reader.close)
            return [reader]
        except Exception as error:  # ReaderError, AssertionError, struct.error, ...
            reason = _in_words(error)
        try:
            records = RecordReader(self.path)
        except (RecordError, OSError) as error:
            raise InputError(f"{self.path}: cannot be read: {_in_words(error)}") from None
        count = sum(connection.msgcount for connection in records.connections)
        if count == 0:
            raise InputError(f"{self.path}: damaged or only half copied ({reason}), and no message in it can be read")
        if records.damaged:
            self.notes.append(f"the bag is cut off or damaged ({reason}); the {count} messages that are whole are read")
        else:
            self.notes.append(f"the bag's index cannot be used ({reason}); its {count} messages are read without it")
        return [records]

    def _open_ros2(self) -> list[Any]:
        if not self.path.is_dir():
            if self.path.stat().st_size == 0:
                raise InputError(f"{self.path}: empty")
            return [self._open_storage(self.path)]
        files = storage_files(self.path)
        reason = "metadata.yaml is missing"
        if (self.path / "metadata.yaml").is_file():
            try:
                reader = self._open_storage(self.path)
                # The files as they are: by metadata.yaml topics are left out whose QoS is written otherwise there.
                return [reader] if reader.compression_mode else list(reader.storage.storages)
            except InputError as error:
                reason = f"metadata.yaml cannot be used ({str(error).removeprefix(f'{self.path}: ')})"
        if not files:
            raise InputError(f"{self.path}: holds no .db3 or .mcap file; {reason}")
        if len({file.suffix for file in files}) > 1 or not (len(files) == 1 or _is_split(files)):
            names = ", ".join(file.name for file in files)
            raise InputError(f"{self.path}: {reason}, and it holds several recordings: {names}; give one of them")
        readers = [self._open_storage(file) for file in files]
        self.notes.append(f"{reason}; {', '.join(file.name for file in files)} read without it")
        return readers

    def _open_storage(self, path: Path) -> Any:
        """A ROS 2 reader of a storage file, or of a folder with its metadata.yaml."""
        from rosbags.rosbag2 import Reader

        try:
            reader = Reader(path)
            reader.open()
        except Exception as error:  # ReaderError, AssertionError, TypeError, zstd's, apsw's, ...
            reason = _in_words(error)
            if path.suffix.lower() == ".mcap" and "end magic" in reason:
                reason = "damaged or only half copied; `mcap recover` saves what is there"
            if "Profile" in reason:
                reason = "only MCAP files of ROS 2 are read"
            raise InputError(f"{path}: cannot be read: {reason}") from None
        self._stack.callback(reader.close)
        return reader

    def _topics(self) -> dict[str, Topic]:
        counts: dict[str, int] = {}
        types: dict[str, str] = {}
        for connection in (c for reader in self._readers for c in reader.connections):
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
            types[connection.topic] = connection.msgtype
        return {name: Topic(name, types[name], counts[name]) for name in sorted(counts)}

    def _duration(self) -> float:
        # A file of a folder tells its times in its metadata.
        filled = (r for r in self._readers if any(c.msgcount for c in r.connections))
        spans = [getattr(reader, "metadata", reader) for reader in filled]
        return float(max(s.end_time for s in spans) - min(s.start_time for s in spans)) * 1e-9 if spans else 0.0


def short_type(name: str) -> str:
    """``sensor_msgs/LaserScan`` for ``sensor_msgs/msg/LaserScan``."""
    return name.replace("/msg/", "/")


def _is_split(files: list[Path]) -> bool:
    """Whether the files are called like the parts of one recording: NAME_0, NAME_1, ..."""
    return len({stem(file) for file in files}) == 1 and all(file.stem != stem(file) for file in files)


def _need_rosbags(path: Path) -> None:
    try:
        import rosbags.rosbag1
        import rosbags.rosbag2  # noqa: F401
    except ImportError:
        raise InputError(f"{path}: reading ROS recordings needs rosbags: pip install 'pfslam-viz[ros]'") from None


def _in_words(error: BaseException) -> str:
    """An error of rosbags' in a few words on one line."""
    text = " ".join(str(error).split())
    return text[:120].rstrip(". ") or "a record in it is inconsistent"
