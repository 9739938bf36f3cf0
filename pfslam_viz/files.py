"""Writing files so that a final name never holds half a file."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pfslam_viz.errors import InputError


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A temporary path beside ``path`` to write to; moved over ``path`` on success, deleted on any failure.

    Missing parent folders are made. Raises InputError when the folder cannot be written, or when ``path`` is there and
    is not a file (a folder, a device).
    """
    path = _file(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=f".part{path.suffix}", dir=path.parent)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def check_writable(path: Path, folder: bool = False) -> None:
    """Raise InputError now when ``path`` could not be written later; ``folder`` when it is to be a folder of files.

    Tries it out with a temporary file in the folder, or in the nearest one above it that exists.
    """
    if not folder:
        path = _file(path)
    existing = path if folder else path.parent
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"{path}: cannot be written: {existing} is not a folder")
    try:
        with tempfile.NamedTemporaryFile(dir=existing, prefix=".pfslam-"):
            pass
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def _file(path: Path) -> Path:
    """``path`` with links followed, so that a link stays one. Raises InputError for what cannot be replaced."""
    if path.is_dir():
        raise InputError(f"{path}: is a folder; name the file to write")
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is not a regular file")
    return path.resolve() if path.is_symlink() else path
