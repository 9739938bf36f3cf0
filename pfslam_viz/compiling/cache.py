"""Where compiled kernels are kept from run to run, also where a package folder or a home cannot be written."""

import os
import stat
import tempfile
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).resolve().parents[1]
PRIVATE = 0o700


def use_cache() -> bool:
    """Whether kernels can be kept at all; if not, every run compiles its own."""
    return folder() is not None


@cache
def folder() -> Path | None:
    """Where kernels are kept: in folders named ``__pycache__`` within the package, or in this one; None for nowhere.

    That is what ``$NUMBA_CACHE_DIR`` says, or else the first that can be written of the package, the user's cache and
    a folder of the user's own among the temporary ones.
    """
    config: Any = import_module("numba.core.config")
    if config.CACHE_DIR:
        return _made(Path(config.CACHE_DIR))
    if _made(PACKAGE / "compiling" / "__pycache__") is not None:
        return PACKAGE
    found = _made(_users()) or _made(_temporary(), private=True)
    if found is not None:  # also for numba in processes that this one starts
        config.CACHE_DIR = os.environ["NUMBA_CACHE_DIR"] = str(found)
    return found


def where() -> str:
    """A line that says where kernels are kept, or why they are not."""
    found = folder()
    if found is None:
        return (
            "compiled kernels cannot be kept, so that every run compiles them: set NUMBA_CACHE_DIR to a folder that can"
            f" be written, which {_tried()} cannot"
        )
    return f"compiled kernels are kept in {found}"


def _tried() -> str:
    return os.environ.get("NUMBA_CACHE_DIR") or f"{PACKAGE}, {_users()} and {_temporary()}"


def _users() -> Path:
    """The user's cache, on Linux as XDG has it."""
    named = os.environ.get("LOCALAPPDATA" if os.name == "nt" else "XDG_CACHE_HOME")
    try:
        return Path(named or Path("~/.cache").expanduser()) / "pfslam-viz"
    except RuntimeError:  # a user without a home
        return Path("~/.cache/pfslam-viz")


def _temporary() -> Path:
    """One for each user: what is in it is run, so nobody else may write there."""
    user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "user")
    return Path(tempfile.gettempdir()) / f"pfslam-viz-{user}"


def _made(path: Path, private: bool = False) -> Path | None:
    """The folder, made if need be, if it can be written and, if it is to be ``private``, is the user's alone."""
    try:
        if not path.is_absolute():
            return None  # a home that is not known
        if private:
            path.mkdir(mode=PRIVATE, exist_ok=True)
            about = path.lstat()
            own = not hasattr(os, "getuid") or about.st_uid == os.getuid()
            if not (stat.S_ISDIR(about.st_mode) and own and about.st_mode & 0o077 == 0):
                return None
        else:
            path.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path).close()
    except OSError:
        return None
    return path
