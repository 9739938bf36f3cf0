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
