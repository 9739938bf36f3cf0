"""Recordings by name or path: where they are looked for, and which loader reads them."""

import os
from dataclasses import dataclass
from pathlib import Path

from pfslam_viz.config import load_robot
from pfslam_viz.errors import InputError
from pfslam_viz.recordings import carmen, ece276a, npz
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.recordings.sources import SOURCES

DEMO = "demo"
ENVIRONMENT = "PFSLAM_RECORDINGS"
_DAMAGED = "?"


@dataclass(frozen=True, slots=True)
class Place:
    """Where a recording lies: a log's path, or the folder of a set's files with its number."""

    name: str
    path: Path
    number: str | None = None


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of the ``recordings`` command.

    ``status`` is ``here``, ``can be fetched``, ``made on first use``, or says what is wrong with it; ``path`` is where
    it lies and ``size`` that of the download, if any.
    """

    name: str
    format: str
    length: str
    sensors: str
    status: str
    size: str
    path: Path | None


def recordings_dir() -> Path:
    """The folder where recordings lie by name.

    ``$PFSLAM_RECORDINGS``, else ``recordings/`` in the current directory if there is one, else the checkout's, else
    ``recordings/`` in the current directory, to be made.
    """
    if chosen := os.environ.get(ENVIRONMENT):
        return Path(chosen)
    here = Path("recordings")
    checkout = Path(__file__).resolve().parents[2]
    if not here.is_dir() and (checkout / "pyproject.toml").is_file() and (checkout / "recordings").is_dir():
        return checkout / "recordings"
    return here


def load_recording(name_or_path: str | Path, data: Path | None = None, robot: str | Path = "ece276a") -> Recording:
    """The recording that a name (``21``, ``demo``, ``intel``, a folder in ``data``) or a path stands for.

    Args:
        name_or_path: a name; or a set's folder or one of its files, or a CARMEN log.
        data: the folder to look a name up in, instead of :func:`recordings_dir`.
        robot: geometry for the course's sets: a shipped name or the path of a TOML file.

    Raises:
        InputError: it is not there, with where it was looked for and how to get it; or it cannot be used.
    """
    place = find(name_or_path, data, make_demo=True)
    if place.number is None:
        return carmen.load(place.path, place.name)
    if missing := ece276a.missing_files(place.path, place.number):
        hint = f"; {_fetch_hint(place.number, data or place.path)}" if place.number in SOURCES else ""
        raise InputError(f"{place.path}: set {place.number} lacks {', '.join(missing)}{hint}")
    return ece276a.load(place.path, place.number, load_robot(robot), place.name)


def find(name_or_path: str | Path, data: Path | None = None, make_demo: bool = False) -> Place:
    """Where the recording lies; a set may still lack files. Raises InputError as :func:`load_recording` does."""
    path = Path(name_or_path)
    folder = recordings_dir() if data is None else data
    if data is not None and not data.is_dir():
        raise InputError(f"{data}: no such folder to look for recordings in")
    if len(path.parts) != 1 or isinstance(name_or_path, Path) or _is_file_name(path):
        if not path.exists() and not path.is_absolute() and (folder / path).exists():
            path = folder / path
        return _place_at(path)
    name = path.name
    if name == DEMO and make_demo:
        from pfslam_viz.simulation.demo import ensure_demo

        return _place_at(ensure_demo(folder), name)
    if place := find_named(name, folder):
        return place
    if path.exists():
        return _place_at(path)
    raise InputError(_not_found(name, folder, data))


def find_named(name: str, folder: Path) -> Place | None:
    """A recording called ``name`` in ``folder``, in ``folder/name``, or ``folder`` itself if it is called so."""
    places = [folder, folder / name]
    sets = [found for place in places if name.isdigit() and (found := ece276a.find_set(place, name))]
    if sets:
        return Place(name, min(sets, key=lambda found: len(ece276a.missing_files(found, name))), name)
    for place in places:
        for stem in _stems(name):
            for log in _logs(place):
                if carmen.log_name(log) == stem:
                    return Place(name, log)
    for place in (folder / name, *([folder] if folder.name == name else [])):
        if found_place := _only_recording(place):
            return Place(name, found_place.path, found_place.number)
    return None


def is_recording(path: Path) -> bool:
    """Whether a path looks like a recording of ours; reads a little of a log, and nothing of a set."""
    if path.is_dir():
        try:
            return ece276a.locate(path)[0].is_dir()
        except InputError:
            return False
    return ece276a.set_number(path) is not None or (carmen.is_log(path) and carmen.looks_like_log(path))


def list_recordings(data: Path | None = None) -> list[Entry]:
    """The recordings that have a name, and what else lies in the folder."""
    folder = recordings_dir() if data is None else data
    if data is not None and not data.is_dir():
        raise InputError(f"{data}: no such folder to look for recordings in")
    entries = []
    listed = set()
    for name, source in SOURCES.items():
        place = find_named(name, folder)
        if place is None:
            status = "made on first use" if name == DEMO else "can be fetched"
            entries.append(Entry(name, source.format, source.length, source.sensors, status, source.size, None))
        else:
            entries.append(_entry(place))
            listed.add((place.path, place.number))
    for place in _others(folder):
        if (place.path, place.number) not in listed:
            listed.add((place.path, place.number))
            entries.append(_entry(place))
    return entries


def _is_file_name(path: Path) -> bool:
    return carmen.is_log(path) or path.suffix == ".npz"


def _stems(name: str) -> list[str]:
    """What a log may be called that has ``name``: so, or as it is called where it comes from."""
    source = SOURCES.get(name)
    original = [Path(file.path).name for file in source.files] if source else []
    return [name, *(carmen.log_name(Path(file)) for file in original if carmen.is_log(Path(file)))]


def _logs(folder: Path) -> list[Path]:
    try:
        return sorted(path for path in folder.iterdir() if carmen.is_log(path) and path.is_file())
    except OSError:
        return []


def _place_at(path: Path, name: str | None = None) -> Place:
    """The one recording that a path stands for."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder, and no recording is called so")
    if path.is_file():
        if carmen.is_log(path):
            return Place(name or carmen.log_name(path), path)
        if ece276a.set_number(path) is None:
            raise InputError(
                f"{path}: neither a set's file (such as Hokuyo21.npz) nor a CARMEN log (.log, .clf or .gfs, plain or"
                " with .gz or .bz2)"
            )
        folder, number = ece276a.locate(path)
        return Place(name or number, folder, number)
    logs = _logs(path)
    if not ece276a.sets_in(path) and not ece276a.sets_in(path / "data") and logs:
        if len(logs) > 1:
            raise InputError(f"{path}: holds {len(logs)} logs; choose one, such as {logs[0]}")
        return Place(name or carmen.log_name(logs[0]), logs[0])
    folder, number = ece276a.locate(path)
    return Place(name or path.resolve().name, folder, number)


def _only_recording(folder: Path) -> Place | None:
    try:
        return _place_at(folder)
    except InputError:
        return None


def _others(folder: Path) -> list[Place]:
    """Everything in ``folder`` and one level below that a loader reads, called as :func:`find` takes it."""
    try:
        subfolders = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError:
        return []
    places = [Place(number, folder, number) for number in ece276a.sets_in(folder)]
    places += [Place(carmen.log_name(log), log) for log in _logs(folder)]
    for sub in subfolders:
        inside = [Place(f"{sub.name}/Hokuyo{number}.npz", sub, number) for number in ece276a.sets_in(sub)]
        inside += [Place(f"{sub.name}/{log.name}", log) for log in _logs(sub)]
        if not inside:
            place = _only_recording(sub)
            inside = [place] if place else []
        if len(inside) == 1:
            inside = [Place(sub.name, inside[0].path, inside[0].number)]
        places += inside
    return places


def _entry(place: Place) -> Entry:
    source = SOURCES.get(place.name)
    if place.number is None:
        relations = place.path.with_name(f"{carmen.log_name(place.path)}.relations").exists()
        sensors = "lidar, odometry" + (", relations" if relations else "")
        return Entry(place.name, "carmen", source.length if source else "", sensors, "here", "", place.path)
    words = {"Hokuyo": "lidar", "Encoders": "encoders", "Imu": "IMU", "Kinect": "colour and disparity"}
    kinds = ece276a.sets_in(place.path)[place.number]
    sensors = ", ".join(word for kind, word in words.items() if kind in kinds)
    if (place.path / "ground_truth.npz").exists() or (place.path / f"ground_truth{place.number}.npz").exists():
        sensors += ", truth"
    missing = ece276a.missing_files(place.path, place.number)
    status = f"incomplete: lacks {', '.join(missing)}" if missing else "here"
    size = source.size if source and missing else ""
    length = _length(place.path / f"Hokuyo{place.number}.npz") if "Hokuyo" in kinds else ""
    if length == _DAMAGED:
        status = f"Hokuyo{place.number}.npz is damaged"
    return Entry(place.name, "ece276a", length, sensors, status, size, place.path)


def _length(path: Path) -> str:
    try:
        stamps = npz.vector(npz.read_arrays(path, ["time_stamps"]), "time_stamps", path)
    except InputError:
        return _DAMAGED
    return f"{stamps.max() - stamps.min():,.0f} s, {len(stamps):,} scans" if len(stamps) else "empty"


def _not_found(name: str, folder: Path, data: Path | None) -> str:
    looked = f"no recording '{name}' in {folder} or {folder / name}"
    if source := SOURCES.get(name):
        optional = ("Kinect", f"{name}.relations")
        needs = ", ".join(file.name for file in source.files if not file.name.startswith(optional))
        return f"{looked}: it needs {needs}; {_fetch_hint(name, data)}"
    if name.isdigit():
        files = ", ".join(f"{kind}{name}.npz" for kind in ece276a.REQUIRED)
        return f"{looked}: it needs {files}, or the path of the folder where they are (--data)"
    return f"{looked}; known names are {', '.join(SOURCES)}, or give the path of a set's folder or a CARMEN log"


def _fetch_hint(name: str, data: Path | None) -> str:
    where = f" --data {data}" if data is not None else ""
    return f"'pfslam-viz fetch {name}{where}' gets it (about {SOURCES[name].size})"
