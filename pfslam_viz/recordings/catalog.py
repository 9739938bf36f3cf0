"""Recordings by name or path: where they are looked for, and which format's reader is asked for them."""

import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pfslam_viz.errors import InputError
from pfslam_viz.names import readable
from pfslam_viz.recordings import formats
from pfslam_viz.recordings.checking.check import check, refuse_wrong
from pfslam_viz.recordings.formats import LoadOptions, Place, format_named, format_of, in_words
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.recordings.sources import SOURCES

DEMO = "demo"
ENVIRONMENT = "PFSLAM_RECORDINGS"

_FIELD = re.compile(r"(lidar|trajectory|relations|frames)\.\w+ ")


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


def load_recording(
    name_or_path: str | Path,
    data: Path | None = None,
    robot: str | Path | None = None,
    *,
    force: bool = False,
    **options: str | None,
) -> Recording:
    """The recording that a name (``21``, ``demo``, ``intel``, a folder in ``data``) or a path stands for.

    It is checked as a whole: what is wrong with it is in ``findings``, and mended where that is safe.

    Args:
        name_or_path: a name; or the path of a file, or of a folder that holds one recording.
        data: the folder to look a name up in, instead of :func:`recordings_dir`.
        robot: geometry for the course's sets: a shipped name or the path of a TOML file; None is ``robot.toml`` beside
            the set's files, else the course's robot.
        force: whether to give it back even if it was found to be wrong.
        options: the other fields of :class:`~pfslam_viz.recordings.formats.LoadOptions`, for formats that read them.

    Raises:
        InputError: it is not there, with where it was looked for and how to get it; or it cannot be used.
    """
    recording = load_place(find(name_or_path, data, make_demo=True), data, LoadOptions(robot, **options))
    if not force:
        refuse_wrong(recording)
    return recording


def load_place(place: Place, data: Path | None, options: LoadOptions) -> Recording:
    """The recording that lies there, checked but not refused; ``data`` is where it was looked for.

    Errors as for :func:`load_recording`.
    """
    row = format_named(place.format)
    if unread := [name for name in options.given() if name not in row.options]:
        readers = [other for other in formats.FORMATS if unread[0] in other.options]
        only = f"; it is for {in_words(' or ', readers)}" if readers else ""
        raise InputError(f"{place.path}: {row.words} is read without {', '.join(unread)}{only}")
    if missing := row.reader.missing(place):
        known = place.number or place.name
        hint = f"; {_fetch_hint(known, data or place.path)}" if known in SOURCES else ""
        raise InputError(f"{place.path}: {row.noun} {known} lacks {', '.join(missing)}{hint}")
    with np.errstate(all="ignore"):  # what overflows is found by the checks, and said by them
        try:
            return check(row.reader.load(replace(place, name=readable(place.name)), options))
        except InputError as error:
            if _FIELD.match(str(error)):  # what a value says of itself does not name the file
                raise InputError(f"{place.chosen_by}: {error}") from None
            raise


def find(name_or_path: str | Path, data: Path | None = None, make_demo: bool = False) -> Place:
    """Where the recording lies; it may still lack files. Raises InputError as :func:`load_recording` does."""
    if not str(name_or_path).strip():
        raise InputError("the recording's name is empty; '.' is the current folder")
    try:
        return _find(name_or_path, data, make_demo)
    except OSError as error:
        raise InputError(f"{error.filename or name_or_path}: cannot be read: {error.strerror or error}") from None


def _find(name_or_path: str | Path, data: Path | None, make_demo: bool) -> Place:
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
    """A recording called ``name`` in ``folder``, in ``folder/name``, or ``folder`` itself if it is called so.

    Of several the most complete, and the first where they are looked for.
    """
    stems = _stems(name)
    for row in formats.FORMATS:
        found = [
            (len(row.reader.missing(place)), order, stems.index(place.name), place)
            for order, where in enumerate((folder, folder / name))
            for place in row.find(where)
            if place.name in stems
        ]
        if found:
            return replace(min(found, key=lambda candidate: candidate[:3])[3], name=name)
    for where in (folder / name, *([folder] if folder.name == name else [])):
        if place := _only_recording(where):
            return replace(place, name=name)
    return None


def is_recording(path: Path) -> bool:
    """Whether a path that a viewer was asked to open is a recording of ours.

    Reads a little of a log, and nothing of a recording that is a folder.
    """
    if path.is_dir():
        return any(row.claims_folder(path) and len(row.find(path)) == 1 for row in formats.FORMATS)
    return any(row.claims(path) and row.reader.looks_like(path) for row in formats.FORMATS)


def list_recordings(data: Path | None = None) -> list[Entry]:
    """The recordings that have a name, and what else lies in the folder."""
    folder = recordings_dir() if data is None else data
    if data is not None and not data.is_dir():
        raise InputError(f"{data}: no such folder to look for recordings in")
    if folder.is_dir():
        _require_readable(folder)
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
    return format_of(path) is not None or path.suffix == ".npz"


def _stems(name: str) -> list[str]:
    """What a recording's own name may be that has ``name``: so, or as its files are called where they come from."""
    stems = [name]
    if (source := SOURCES.get(name)) and source.files:
        row = format_named(source.format)
        stems += [row.name_of(Path(file.path)) for file in source.files if row.claims(Path(file.path))]
    return stems


def _place_at(path: Path, name: str | None = None) -> Place:
    """The one recording that a path stands for."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder, and no recording is called so")
    if path.is_file():
        row = format_of(path)
        if row is None:
            raise InputError(f"{path}: neither {in_words(' nor ')}")
        place = row.reader.place(path, row)
        return replace(place, name=name or place.name)
    _require_readable(path)
    for row in formats.FORMATS:
        places = row.find(path)
        if len(places) > 1:
            raise InputError(f"{path}: holds {len(places)} {row.noun}s; choose one, such as {places[0].chosen_by}")
        if places:
            own = places[0].name if places[0].path.is_file() else path.resolve().name
            return replace(places[0], name=name or own)
    raise InputError(f"{path}: holds no recording: neither {in_words(' nor ')}")


def _require_readable(folder: Path) -> None:
    """Raise InputError for a folder that may not be listed; the readers take it for one without recordings."""
    try:
        next(folder.iterdir(), None)
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {error.strerror}") from None


def _is_readable(path: Path) -> bool:
    """Whether a file may be opened; True for what is no file."""
    try:
        if path.is_file():
            path.open("rb").close()
    except OSError:
        return False
    return True


def _only_recording(folder: Path) -> Place | None:
    try:
        return _place_at(folder)
    except InputError:
        return None


def _others(folder: Path) -> list[Place]:
    """Everything in ``folder`` and one level below that a reader reads, called as :func:`find` takes it."""
    try:
        subfolders = sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError:
        return []
    places = _all_in(folder)
    for sub in subfolders:
        inside = _all_in(sub)
        if len(inside) == 1:
            places.append(replace(inside[0], name=sub.name))
        else:
            places += [replace(p, name=p.chosen_by.relative_to(folder).as_posix()) for p in inside]
    return places


def _all_in(folder: Path) -> list[Place]:
    return [place for row in formats.FORMATS for place in row.find(folder)]


def _entry(place: Place) -> Entry:
    source = SOURCES.get(place.name)
    reader = format_named(place.format).reader
    glance, missing = reader.glance(place), reader.missing(place)
    status = f"incomplete: lacks {', '.join(missing)}" if missing else "here"
    length = (source.length if source else "") if glance.length is None else glance.length
    if not missing and not _is_readable(place.chosen_by):
        status, glance = f"{place.chosen_by.name} cannot be read", replace(glance, damage="")
    size = source.size if source and missing else ""
    return Entry(readable(place.name), place.format, length, glance.sensors, glance.damage or status, size, place.path)


def _not_found(name: str, folder: Path, data: Path | None) -> str:
    looked = f"no recording '{name}' in {folder} or {folder / name}"
    if source := SOURCES.get(name):
        row = format_named(source.format)
        files = row.reader.needs(name) or [file.name for file in source.files if row.claims(Path(file.name))]
        return f"{looked}: it needs {', '.join(files)}; {_fetch_hint(name, data)}"
    if needed := next((files for row in formats.FORMATS if (files := row.reader.needs(name))), None):
        return f"{looked}: it needs {', '.join(needed)}, or the path of the folder where they are (--data)"
    return f"{looked}; known names are {', '.join(SOURCES)}, or give the path of {in_words(' or ')}"


def _fetch_hint(name: str, data: Path | None) -> str:
    where = f" --data {data}" if data is not None else ""
    return f"'pfslam-viz fetch {name}{where}' gets it (about {SOURCES[name].size})"
