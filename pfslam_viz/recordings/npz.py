"""Reading ``.npz`` files with errors that a user can act on."""

import math
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
from pfslam_viz.recordings.unpacking import allowance

Array = NDArray[np.float64]

SURE = 256 << 20  # bytes; scans without noise, or of nothing, pack very well
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
        raise InputError(
            f"{path}: {_what_it_is(path) if 'pickle' in str(error) else 'damaged; get it again'}"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    return found


def _what_it_is(path: Path) -> str:
    """What to say of a file that is no archive."""
    with path.open("rb") as file:
        start = file.read(2)
    if start[:1] == b"\x80" and start[1:] <= b"\x05":
        return "is a Python pickle, which could run code and is not read; save its arrays with numpy.savez"
    return "not an .npz file, or damaged; get it again"


def _read(archive: Any, key: str, path: Path) -> NDArray[Any]:
    dtype, size = _declared(archive.zip, key)
    if dtype.hasobject:
        raise InputError(
            f"{path}: {key} is a Python object array (a pickle), which could run code and is not read; "
            "save it again as plain numbers"
        )
    if dtype.kind not in "biuf":
        raise InputError(f"{path}: {key} holds {dtype}, not numbers")
    packed = path.stat().st_size
    if size > allowance(packed, SURE):
        raise InputError(
            f"{path}: {key} would unpack to {size / 2**20:,.0f} MB out of a file of {packed / 2**20:.1f} MB, which no"
            " recording does; if it is one, save it with numpy.savez"
        )
    array: NDArray[Any] = archive[key]
    return array


def _declared(archive: zipfile.ZipFile, key: str) -> tuple[np.dtype[Any], int]:
    """An array's type and size in bytes by its header, which must fit its entry in the archive; nothing is unpacked."""
    name = key if key in archive.namelist() else f"{key}.npy"
    with archive.open(name) as member:
        version = np.lib.format.read_magic(member)
        read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read_header(member)
        size = math.prod(shape) * dtype.itemsize
        if not dtype.hasobject and size != archive.getinfo(name).file_size - member.tell():
            raise ValueError("the header does not fit the data")
    return dtype, max(size, archive.getinfo(name).file_size)


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
