"""The formats of recordings: a row each in :data:`FORMATS`, which is all that catalog, info and importer know of them.

To add one, write a module with a :class:`Reader` called ``READER``, and a row that names it. A row tells by file names
alone whose a file is, and importing this module imports nothing heavy; the reader's module is imported when a file of
its own is there.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pfslam_viz.recordings.recording import Recording, Stream, Trajectory


@dataclass(frozen=True, slots=True)
class LoadOptions:
    """What a user may say about how to read a recording; None leaves it to the recording.

    Attributes:
        robot: geometry of the robot, a shipped name or the path of a TOML file; None is ``robot.toml`` beside the
            recording, else the course's robot.
        scan_topic: which of several streams of scans, of a log with topics.
        odom_topic: which stream of odometry.
        base_frame: which frame is the robot's.
    """

    robot: str | Path | None = None
    scan_topic: str | None = None
    odom_topic: str | None = None
    base_frame: str | None = None

    def given(self) -> list[str]:
        """The names of those that a user has set, without the robot, which is not of a format."""
        return [f.name for f in fields(self) if f.name != "robot" and getattr(self, f.name) is not None]


@dataclass(frozen=True, slots=True)
class Place:
    """Where one recording lies.

    Attributes:
        name: what the user calls it.
        path: the file or the folder that it is read from.
        format: the name of its format.
        number: which of the recordings in the folder, where a folder may hold the files of several.
        file: what to name to choose it among others; ``path`` where None.
    """

    name: str
    path: Path
    format: str
    number: str | None = None
    file: Path | None = None

    @property
    def chosen_by(self) -> Path:
        """The path that stands for this recording and no other."""
        return self.file or self.path


@dataclass(frozen=True, slots=True)
class Glance:
    """What a line of the list of recordings says of one, found without reading it whole.

    ``sensors`` and ``length`` (duration and scans) in words, ``length`` None where a glance cannot tell; ``damage``
    says what is wrong with it, if anything is.
    """

    sensors: str
    length: str | None = None
    damage: str = ""


@dataclass(frozen=True, slots=True)
class Contents:
    """What a log with topics holds, and what of it is read.

    Attributes:
        topics: name, type, messages and rate_hz of each.
        used: which topics and frames are taken, and what was told from them; values are what JSON can hold.
        problem: why it cannot be replayed, or None.
    """

    topics: tuple[Mapping[str, object], ...]
    used: Mapping[str, object]
    problem: str | None


@dataclass(frozen=True, slots=True)
class WithoutScans:
    """A recording that lacks its scans: what its other sensors tell. ``wheel_path`` is in m."""

    streams: tuple["Stream", ...]
    trajectory: "Trajectory"
    wheel_path: float
    notes: tuple[str, ...]


class Reader:
    """What a format does with its files. The defaults are those of a format whose recordings are a file each."""

    def load(self, place: Place, options: LoadOptions) -> "Recording":
        """Read it, under ``place.name``. Raises InputError for files that are missing, damaged, or do not fit."""
        raise NotImplementedError

    def find(self, folder: Path, row: "Format") -> list[Place]:
        """The recordings in this very folder, called by their own names, sorted; none if it cannot be listed."""
        try:
            files = sorted(path for path in folder.iterdir() if row.claims(path) and path.is_file())
        except OSError:
            return []
        return [self.place(path, row) for path in files]

    def place(self, path: Path, row: "Format") -> Place:
        """The recording that a file with a claimed name stands for."""
        return Place(row.name_of(path), path, row.name)

    def looks_like(self, path: Path) -> bool:
        """Whether a look at the beginning of a file with a claimed name bears the name out."""
        return path.is_file()

    def missing(self, place: Place) -> list[str]:
        """Names of files that it lacks to be replayed."""
        return []

    def needs(self, name: str) -> list[str]:
        """Names of the files that a recording called so would be made of, where the name tells."""
        return []

    def glance(self, place: Place) -> Glance:
        """Its sensors and length, found quickly."""
        return Glance("lidar, odometry")

    def contents(self, place: Place, options: LoadOptions) -> Contents | None:
        """What a log with topics holds; None for formats without. Raises InputError if it cannot be opened."""
        return None

    def without_scans(self, place: Place, options: LoadOptions) -> WithoutScans | None:
        """What can be told of a recording that lacks just its scans; None for any other."""
        return None


@dataclass(frozen=True, slots=True)
class Format:
    """One row of :data:`FORMATS`.

    Attributes:
        name: what :attr:`Recording.format` says.
        words: what a message calls it, with its article: "a CARMEN log (...)".
        noun: one of its recordings, in a word: "log".
        files: the pattern of its files' whole names, upper or lower case; the group ``name`` is what the recording in
            such a file is called.
        module: the module that has its ``READER``.
        opens: the pattern of those files for which a viewer that is asked to open them starts a replay; None for all.
        folder: patterns of files whose presence in a folder makes the folder one that a viewer opens as a recording.
        options: names of the :class:`LoadOptions` that it reads besides the robot.
    """

    name: str
    words: str
    noun: str
    files: re.Pattern[str]
    module: str
    opens: re.Pattern[str] | None = None
    folder: tuple[str, ...] = ()
    options: tuple[str, ...] = ()

    def claims(self, path: Path) -> bool:
        """Whether a file is called like one of this format's. Looks at the name alone."""
        return self.files.fullmatch(path.name) is not None

    def claims_to_open(self, path: Path) -> bool:
        """Whether a viewer's file is for us to replay, by its name alone; of a folder, by the names in it."""
        if path.is_dir():
            return self.claims_folder(path)
        return (self.opens or self.files).fullmatch(path.name) is not None

    def claims_folder(self, folder: Path) -> bool:
        """Whether a folder as a whole is a recording of this format, by the names of what lies in it."""
        return any(next(folder.glob(pattern), None) is not None for pattern in self.folder)

    def name_of(self, path: Path) -> str:
        """What the recording in a file is called: ``intel`` for ``intel.clf.bz2``. The file has a claimed name."""
        match = self.files.fullmatch(path.name)
        return match["name"] if match else path.name

    @property
    def reader(self) -> Reader:
        """Who reads it; imports its module."""
        reader = import_module(self.module).READER
        assert isinstance(reader, Reader)
        return reader

    def find(self, folder: Path) -> list[Place]:
        """The recordings of this format in a folder."""
        return self.reader.find(folder, self)


def _names(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern, re.IGNORECASE)


FORMATS: tuple[Format, ...] = (
    Format(
        name="ece276a",
        words="a set's file (such as Hokuyo21.npz)",
        noun="set",
        files=re.compile(r"(Encoders|Hokuyo|Imu|Kinect)(?P<name>\d+)\.npz"),
        module="pfslam_viz.recordings.ece276a_reader",
        opens=re.compile(r"Hokuyo\d+\.npz"),
        folder=("Hokuyo*.npz", "data/Hokuyo*.npz"),
    ),
    Format(
        name="carmen",
        words="a CARMEN log (.log, .clf or .gfs, plain or with .gz or .bz2)",
        noun="log",
        files=_names(r"(?P<name>.+)\.(log|clf|gfs)(\.gz|\.bz2)?"),
        module="pfslam_viz.recordings.carmen_reader",
    ),
    Format(
        name="ros",
        words="a ROS bag (.bag, .db3 or .mcap, or a ROS 2 bag's folder)",
        noun="bag",
        files=_names(r"(?P<name>.+)\.(bag|db3|mcap)"),
        module="pfslam_viz.recordings.ros_reader",
        folder=("metadata.yaml", "*.db3"),
        options=("scan_topic", "odom_topic", "base_frame"),
    ),
    Format(
        name="rawlog",
        words="an MRPT rawlog (.rawlog, plain or with .gz)",
        noun="rawlog",
        files=_names(r"(?P<name>.+)\.rawlog(\.gz)?"),
        module="pfslam_viz.recordings.rawlog_reader",
    ),
)
"""All formats; where a folder holds recordings of several, the first of them here is the one that it stands for."""


def format_named(name: str) -> Format:
    """The format of this name."""
    return next(row for row in FORMATS if row.name == name)


def format_of(path: Path) -> Format | None:
    """The format that claims a file, by its name."""
    return next((row for row in FORMATS if row.claims(path)), None)


def in_words(between: str, formats: Iterable[Format] | None = None) -> str:
    """What messages call the formats, with ``between`` them: "a ... nor a ..."."""
    return between.join(row.words for row in formats or FORMATS)
