"""Bringing time stamps in order: logs hold stamps that run backwards, repeat, or are no numbers."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def order(stamps: Array, what: str, notes: list[str]) -> NDArray[np.intp]:
    """Indices that sort samples by their ``(n,)`` stamps, those without a finite stamp left out.

    Samples of equal stamp keep their order. What was wrong is added to ``notes``; ``what`` names the stream in them.
    """
    kept = np.flatnonzero(np.isfinite(stamps))
    if len(kept) < len(stamps):
        notes.append(f"{what}: {len(stamps) - len(kept)} samples without a valid time stamp left out")
    backwards = int((np.diff(stamps[kept]) < 0).sum())
    if backwards:
        notes.append(f"{what}: time stamps run backwards {backwards} times; sorted by time stamp")
        kept = kept[np.argsort(stamps[kept], kind="stable")]
    return kept


def spread_repeats(stamps: Array, spacing: float = 0.1) -> Array:
    """Strictly increasing stamps from sorted ``(n,)`` ones: m equal stamps are spread evenly up to the next one.

    The first of them keeps its stamp. After the last stamp the median spacing is used, or ``spacing`` s if all are
    equal.
    """
    values, first, counts = np.unique(stamps, return_index=True, return_counts=True)
    if len(values) == len(stamps):
        return stamps
    gaps = np.append(np.diff(values), np.median(np.diff(values)) if len(values) > 1 else spacing * len(stamps))
    rank = np.arange(len(stamps)) - np.repeat(first, counts)
    return stamps + rank * np.repeat(gaps / counts, counts)


def distinct_scans(
    stamps: Array, ranges: NDArray[np.float32], notes: list[str], spacing: float = 0.1
) -> tuple[NDArray[np.intp], Array]:
    """Which of the scans to keep (k,), in order of time, and their strictly increasing stamps (k,).

    Left out are scans without a finite stamp, and copies: scans that repeat both stamp and ``ranges`` (n, B) of the one
    before. Other scans of equal stamp are spread as by :func:`spread_repeats`. What was wrong is added to ``notes``.
    """
    kept = order(stamps, "lidar", notes)
    in_order = stamps[kept]
    same = np.flatnonzero(np.diff(in_order) == 0) + 1
    if len(same) == 0:
        return kept, in_order
    copies = same[(ranges[kept[same]] == ranges[kept[same - 1]]).all(axis=1)]
    if len(copies):
        notes.append(f"lidar: {len(copies)} scans logged twice left out")
        kept = np.delete(kept, copies)
    if len(copies) < len(same):
        notes.append(f"lidar: {len(same) - len(copies)} scans repeat the stamp before; spread up to the next stamp")
    return kept, spread_repeats(stamps[kept], spacing)
