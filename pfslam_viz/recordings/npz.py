"""Reading ``.npz`` files with errors that a user can act on."""

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError

Array = NDArray[np.float64]

# What zipfile and NumPy's header parser raise for damaged files, found by damaging files at random; ValueError besides.
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, EOFError, struct.error, KeyError, RuntimeError, SyntaxError, TypeError,
    OverflowError, MemoryError, tokenize.TokenError,
)  # fmt: skip


def read_arrays(path: Path, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, NDArray[Any]]:
    """The named arrays of an ``.npz`` file, as stored.

    Nothing is unpickled. Raises InputError, naming the file, when it is missing, damaged, lacks a required key, or when
    an array does not hold real numbers.
    """
    required = tuple(required)
    found: dict[str, NDArray[Any]] = {}
    try:
        with path.open("rb") as file:  # opened here, as NumPy does not close it when it is no zip file
            archive = np.load(file, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise InputError(f"{path}: holds one bare array; expected an .npz with {', '.join(required)}")
            missing = [key for key in required if key not in archive]
            if missing:
                present = ", ".join(archive.files) or "nothing"
                raise InputError(f"{path}: lacks {', '.join(missing)}; it holds {present}")
            for key in (*required, *optional):
                if key in archive:
                    found[key] = _read(archive, key, path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except _DAMAGE:
        raise InputError(f"{path}: damaged or only half downloaded; get it again") from None
    except ValueError as error:
        what = "not an .npz file, or damaged" if "pickle" in str(error) else "damaged"
        raise InputError(f"{path}: {what}; get it again") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    return found


def _read(archive: Any, key: str, path: Path) -> NDArray[Any]:
    try:
        array: NDArray[Any] = archive[key]
    except ValueError as error:
        if "pickle" in str(error):
            raise InputError(
                f"{path}: {key} is a Python object array (a pickle), which could run code and is not read; "
                "save it again as plain numbers"
            ) from None
        raise
    if array.dtype.kind not in "biuf":
        raise InputError(f"{path}: {key} holds {array.dtype}, not numbers")
    return array


def scalar(arrays: dict[str, NDArray[Any]], key: str, path: Path) -> float:
    """One finite number, whether it was stored as a scalar or as an array with one element."""
    array = arrays[key]
    if array.size != 1 or not np.isfinite(array).all():
        raise InputError(f"{path}: {key} should be one finite number; it is an array of shape {array.shape}")
    return float(array.reshape(()))


def vector(arrays: dict[str, NDArray[Any]], key: str, path: Path) -> Array:
    """A one-dimensional array of float64, whether it was stored as (n,), (1, n) or (n, 1)."""
    array = arrays[key]
    if array.size != max(array.shape, default=1):
        raise InputError(f"{path}: {key} should be one row of numbers; it has shape {array.shape}")
    return np.asarray(array, dtype=np.float64).reshape(-1)


def matrix(arrays: dict[str, NDArray[Any]], key: str, path: Path, rows: int, columns: int) -> NDArray[Any]:
    """A ``(rows, columns)`` array, turned round if it was stored the other way; -1 rows stands for any number."""
    array = arrays[key]
    if array.ndim == 2:
        for candidate in (array, array.T):
            if candidate.shape[1] == columns and rows in (-1, candidate.shape[0]):
                return candidate
    wanted = f"{'any' if rows < 0 else rows} x {columns}"
    shape = " x ".join(str(n) for n in array.shape) or "a single number"
    raise InputError(f"{path}: {key} is {shape} and does not fit its {columns} time stamps ({wanted} is expected)")
