"""Checks of the arrays in a recording's values: what fits is converted, what does not is refused with its name.

Errors are InputErrors of the form "WHOSE: FIELD is ...; ... is expected".
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError

Array = NDArray[np.float64]

_REAL = "iuf"  # kinds of NumPy types that are taken as real numbers


def real(value: object, what: str) -> NDArray[Any]:
    """``value`` as an array of integers or floats, as it is. Raises InputError for anything else; ``what`` names it."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError):
        raise InputError(f"{what} is no array; one of real numbers is expected") from None
    if array.dtype.kind not in _REAL and array.size:
        raise InputError(f"{what} holds {array.dtype}; real numbers are expected")
    return array


def vector(value: object, what: str, length: int | None = None, because: str = "", finite: bool = True) -> Array:
    """``value`` as (n,) float64, ``finite``; ``length`` is the n that is expected ``because`` of something."""
    array = real(value, what)
    if array.ndim != 1 or (length is not None and len(array) != length):
        wanted = "(n,)" if length is None else f"({length},)"
        raise InputError(f"{what} has shape {array.shape}; {wanted} is expected{because}")
    return _finite(array, what) if finite else np.ascontiguousarray(array, dtype=np.float64)


def poses(value: object, what: str, length: int, because: str = "") -> Array:
    """``value`` as (n, 3) finite float64: x, y (m) and heading (rad) in each row; ``length`` is n."""
    array = real(value, what)
    if array.shape != (length, 3):
        turned = array.shape == (3, length) and length != 3
        hint = "; it looks transposed" if turned else ""
        raise InputError(f"{what} has shape {array.shape}; ({length}, 3) is expected{because}{hint}")
    return _finite(array, what)


def stamps(value: object, what: str, strictly: bool = False, length: int | None = None, because: str = "") -> Array:
    """``value`` as (n,) finite float64 that increase: ``strictly``, or so that equal ones may follow each other."""
    array = vector(value, what, length, because)
    steps = np.diff(array)
    bad = steps <= 0 if strictly else steps < 0
    if bad.any():
        k = int(np.argmax(bad))
        how = "strictly increase" if strictly else "increase"
        raise InputError(
            f"{what} does not {how}: {array[k]:.6f} s at {k} is followed by {array[k + 1]:.6f} s;"
            f" stamps that {how} are expected"
        )
    return array


def number(value: object, what: str) -> float:
    """``value`` as one finite float."""
    array = real(value, what)
    if array.size != 1:
        raise InputError(f"{what} has shape {array.shape}; one number is expected")
    return float(_finite(array.reshape(1), what)[0])


def ranges(value: object, what: str, scans: int, beams: int) -> tuple[NDArray[np.float32], int]:
    """``value`` as (``scans``, ``beams``) contiguous float32, and how many NaN and infinite ones became 0, no return.

    The array given is not changed. Raises InputError for another shape, and says so where it looks transposed.
    """
    array = real(value, what)
    if array.shape != (scans, beams):
        hint = ""
        if array.shape == (beams, scans):
            hint = "; it looks transposed: a row for every scan is expected, so pass ranges.T"
        elif array.ndim == 2 and len(array) == scans:
            hint = f"; it has {array.shape[1]} ranges a scan, but lidar.angles has {beams}"
        elif array.ndim == 2 and array.shape[1] == beams:
            hint = f"; it has {len(array)} scans, but there are {scans} stamps"
        raise InputError(f"{what} has shape {array.shape}; ({scans}, {beams}) is expected{hint}")
    with np.errstate(over="ignore", invalid="ignore"):
        out = np.ascontiguousarray(array, dtype=np.float32)
        if np.isfinite(out.sum()):  # one pass without a copy; a NaN or infinite range makes the sum so
            return out, 0
    bad = ~np.isfinite(out)
    if count := int(bad.sum()):
        out = np.where(bad, np.float32(0.0), out)
    return out, count


def _finite(array: NDArray[Any], what: str) -> Array:
    out = np.ascontiguousarray(array, dtype=np.float64)
    bad = ~np.isfinite(out)
    if bad.any():
        at = np.unravel_index(int(np.argmax(bad)), out.shape)
        where = ", ".join(str(int(k)) for k in at)
        raise InputError(f"{what} is {out[at]} at [{where}]; finite numbers are expected")
    return out
