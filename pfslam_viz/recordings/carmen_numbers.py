"""Lines of numbers to arrays, quickly when all are whole, with care when some are broken."""

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def leading_numbers(lines: list[bytes], length: Callable[[Array], int]) -> list[Array | None]:
    """The leading numbers of every line, as many as ``length`` (of what is there) asks for; None for broken lines.

    All lines are parsed in one go; only if that fails does each line get its own attempt.
    """
    numbers = [line.rsplit(None, 2)[0] if line.count(b" ") > 2 else line for line in lines]  # less host, logger stamp
    table = parse(b" ".join(numbers))
    if table is not None:
        rows, at = [], 0
        for _ in lines:
            size = length(table[at:])
            if size <= 0 or at + size > len(table):
                break
            rows.append(table[at : at + size])
            at += size
        if len(rows) == len(lines) and at == len(table):
            return list(rows)
    return [_row(line, length) for line in lines]


def parse(text: bytes) -> Array | None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what NumPy says of text that is no number
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def parse_hundredths(text: bytes) -> Array | None:
    """Numbers that are all written with two decimals and one blank between: five times as fast as :func:`parse`.

    None for any other text. The result is the same to the last bit: whole numbers divided by 100.
    """
    symbols = np.frombuffer(text + b" ", dtype=np.uint8)
    dots = np.flatnonzero(symbols == ord("."))
    if len(dots) == 0 or dots[-1] + 3 >= len(symbols) or (symbols == ord(" ")).sum() != len(dots):
        return None
    digits = all(((symbols[dots + k] - ord("0")) < 10).all() for k in (1, 2))
    if not digits or not (symbols[dots + 3] == ord(" ")).all():
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            whole = np.fromstring(text.replace(b".", b""), dtype=np.int64, sep=" ")
        except (DeprecationWarning, ValueError):
            return None
    return whole / 100.0 if len(whole) == len(dots) else None


def _row(line: bytes, length: Callable[[Array], int]) -> Array | None:
    values = []
    for word in line.split():
        try:
            values.append(float(word))
        except ValueError:
            break  # the host's name, or damage
    row = np.array(values)
    size = length(row)
    return row[:size] if 0 < size <= len(row) else None


def whole_number(row: Array, at: int) -> int:
    """A whole number of readings at a place in a row, or -1."""
    if at >= len(row) or not 0 <= row[at] <= 100_000 or row[at] != int(row[at]):
        return -1
    return int(row[at])
