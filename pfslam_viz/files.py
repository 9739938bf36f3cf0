"""Writing files so that a final name never holds half a file."""

import contextlib
import errno
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pfslam_viz.errors import InputError, PfslamError

_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS, errno.ESTALE)
"""What a disk answers that takes no more."""
_ROOM = 1 << 14  # bytes
_TRIES = 10  # to make a folder and a file in it, while others remove theirs


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` to write to; moved over ``path`` on success, deleted on any failure.

    Missing parent folders are made, and removed again where nothing came. What a run that was killed left of the same
    file is removed; another run's that is still under way is not.

    Raises:
        InputError: the folder cannot be written, or ``path`` is there and is not a file (a folder, a device).
        PfslamError: the disk is full.
    """
    path = _file(path)
    made = missing_folders(path)
    try:
        handle, name = _part_beside(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    temporary = Path(name)
    with os.fdopen(handle, "rb") as held:
        hold(held.fileno())
        try:
            with full_disk_named(path, temporary):
                yield temporary
                mask = os.umask(0)
                os.umask(mask)
                temporary.chmod(0o666 & ~mask)
                if sys.platform == "win32":
                    held.close()  # an open file cannot be moved there
                temporary.replace(path)
        except BaseException:
            held.close()
            temporary.unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                for folder in made:
                    folder.rmdir()
            raise


def _part_beside(path: Path) -> tuple[int, str]:
    """Handle and name of a new temporary file beside ``path``, in a folder that is made if need be."""
    for tries_left in reversed(range(_TRIES)):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            for part in stale_parts(path):
                if not part.is_dir():
                    part.unlink(missing_ok=True)
            return tempfile.mkstemp(prefix=f".{path.name}.", suffix=f".part{path.suffix}", dir=path.parent)
        except FileNotFoundError:  # another thread, to whom nothing came, removed the folder in between
            if tries_left == 0:
                raise
    raise AssertionError("not reached")


@contextmanager
def full_disk_named(path: Path, temporary: Path | None = None) -> Iterator[None]:
    """Within the block, a disk that takes no more raises PfslamError with ``path``, which is what is written.

    Errors about files other than it, ``temporary`` and what lies in there are let through as they are.
    """
    try:
        yield
    except OSError as error:
        named = None if error.filename is None else Path(os.fsdecode(error.filename))
        own = named is None or temporary is None or named == path or temporary in (named, *named.parents)
        if not own or not is_full(error):
            raise
        raise PfslamError(f"{path}: cannot be written: {os.strerror(error.errno or 0)}") from None


def read_small(path: Path, most: int = 16 << 20) -> bytes:
    """A file that has no reason to be large, such as settings. Raises OSError (EFBIG) where it is."""
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return content


def is_full(error: OSError) -> bool:
    """Whether an error says that a disk takes no more."""
    return error.errno in _FULL


def is_full_at(path: Path) -> bool:
    """Whether the disk that ``path`` lies on has no room at all, for us at least. False where that cannot be told."""
    try:
        return shutil.disk_usage(path.parent).free < _ROOM
    except OSError:
        return False


def check_writable(path: Path, folder: bool = False) -> None:
    """Raise InputError now when ``path`` could not be written later; ``folder`` when it is to be a folder of files.

    Tries it out with a temporary file in the folder, or in the nearest one above it that exists.
    """
    if not folder:
        path = _file(path)
    existing = path if folder else path.parent
    while not os.path.exists(existing) and existing != existing.parent:  # noqa: PTH110 - False also if forbidden
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"{path}: cannot be written: {existing} is not a folder")
    try:
        with tempfile.NamedTemporaryFile(dir=existing, prefix=".pfslam-"):
            pass
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def hold(descriptor: int) -> bool:
    """Whether nobody holds an open file or folder, which is held from now on, until it is closed.

    Where the system has no such locks, always False.
    """
    try:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (ImportError, OSError):
        return False
    return True


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """A temporary folder is held for as long as the block runs."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:  # folders cannot be opened everywhere
        yield
        return
    try:
        hold(descriptor)
        yield
    finally:
        os.close(descriptor)


def stale_parts(path: Path) -> Iterator[Path]:
    """What runs that were killed left of ``path`` beside it: temporary files and folders that nobody holds."""
    mark = rf"(\.[a-z0-9_]{{8}}\.part({re.escape(path.suffix)})?)+"
    own = re.compile(r"\.+" + re.escape(path.name) + mark)
    for name in _parts_in(path.parent):
        if not own.fullmatch(name):
            continue
        try:
            descriptor = os.open(path.parent / name, os.O_RDONLY)
        except OSError:
            continue
        try:
            stale = hold(descriptor)
        finally:
            os.close(descriptor)
        if stale:
            yield path.parent / name


def _parts_in(folder: Path) -> list[str]:
    """The temporary names in a folder, looked for once a minute: a run may write thousands of files there."""
    key, now = folder.resolve(), time.monotonic()
    if key not in _PARTS or now - _PARTS[key][0] > 60:
        _PARTS[key] = now, [name for name in os.listdir(folder) if ".part" in name]  # noqa: PTH208
    return _PARTS[key][1]


_PARTS: dict[Path, tuple[float, list[str]]] = {}


def missing_folders(path: Path) -> list[Path]:
    """The folders that have to be made for ``path``, the nearest to it first."""
    return [folder for folder in path.parents if not os.path.exists(folder)]  # noqa: PTH110 - False also if forbidden


def _file(path: Path) -> Path:
    """``path`` with links followed, so that a link stays one. Raises InputError for what cannot be replaced."""
    try:
        if path.is_dir():
            raise InputError(f"{path}: is a folder; name the file to write")
        if path.exists() and not path.is_file():
            raise InputError(f"{path}: is not a regular file")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    return path.resolve() if path.is_symlink() else path
