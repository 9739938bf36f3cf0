"""What is a ROS recording, told by the name or by a look at the file. Imports nothing heavy, rosbags least of all."""

from pathlib import Path

STORAGE = (".db3", ".mcap")
_MCAP_MAGIC = b"\x89MCAP0\r\n"
_LASER_SCAN = b"sensor_msgs/msg/LaserScan"


def claims(path: Path) -> bool:
    """Whether a path is called like a ROS recording, or a folder holds a ROS 2 bag's metadata.yaml or a .db3 file."""
    if path.is_dir():
        return _has_metadata(path) or any(file.suffix.lower() == ".db3" for file in storage_files(path))
    return path.suffix.lower() in (".bag", *STORAGE)


def looks_like(path: Path) -> bool:
    """Whether what :func:`claims` accepts is to be read here: an .mcap only if it holds LaserScans."""
    try:
        if path.is_dir():
            return claims(path) and all(looks_like(file) for file in storage_files(path)[:1])
        with path.open("rb") as file:
            start = file.read(16)
        if path.suffix.lower() == ".mcap":
            return start.startswith(_MCAP_MAGIC) and _names_laser_scan(path)
    except OSError:
        return False
    return start.startswith(b"#ROSBAG V") if path.suffix.lower() == ".bag" else start.startswith(b"SQLite format 3")


def recording_name(path: Path) -> str:
    """``drive`` for ``drive.bag`` and for a folder ``drive``."""
    return path.name if path.is_dir() else path.stem


def storage_files(folder: Path) -> list[Path]:
    """The .db3 and .mcap files in a folder, in order of their names with numbers counted (bag_2 before bag_10)."""
    try:
        files = [file for file in folder.iterdir() if file.suffix.lower() in STORAGE and file.is_file()]
    except OSError:  # nothing that may be looked at
        return []
    return sorted(files, key=lambda file: (stem(file), len(file.stem), file.stem))


def stem(file: Path) -> str:
    """A storage file's name without suffix and number: ``drive`` for ``drive_0.db3``."""
    head, _, number = file.stem.rpartition("_")
    return head if head and number.isdigit() else file.stem


def _has_metadata(folder: Path) -> bool:
    try:
        with (folder / "metadata.yaml").open("rb") as file:
            return b"rosbag2_bagfile_information" in file.read(4096)
    except OSError:
        return False


def _names_laser_scan(path: Path) -> bool:
    """Whether an MCAP file's summary, or its beginning where there is none, names the schema of LaserScan."""
    with path.open("rb") as file:
        file.seek(0, 2)
        size = file.tell()
        file.seek(max(size - 37, 0))
        footer = file.read(37)
        # Footer: op code, length, start of the summary, ... and the magic again (mcap.dev/spec).
        start = int.from_bytes(footer[9:17], "little") if footer.endswith(_MCAP_MAGIC) and footer[:1] == b"\x02" else 0
        file.seek(start)
        head = file.read(4 << 20)
    # A schema record begins with its id and its name, so the name stands behind its own length.
    return len(_LASER_SCAN).to_bytes(4, "little") + _LASER_SCAN in head
