"""Stretches of scans that have something in common, and how a finding tells of them."""

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.intp]


def stretches(marked: NDArray[np.bool_]) -> tuple[Indices, Indices]:
    """The first scan of each stretch (k,) of ``marked`` (n,) ones, and the one after its last (k,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.view(np.int8), [0]])))
    return edges[::2], edges[1::2]


def told(which: NDArray[np.bool_], starts: Indices, lasted: NDArray[np.float64]) -> tuple[str, int]:
    """How many stretches ``which`` (k,) marks, in words with the longest one's seconds and scan; and that scan.

    ``starts`` (k,) scans, ``lasted`` (k,) s; at least one must be marked.
    """
    k = int(np.argmax(np.where(which, lasted, 0.0)))
    count = "1 stretch" if which.sum() == 1 else f"{int(which.sum())} stretches"
    return f"in {count}; the longest lasts {lasted[k]:.1f} s from scan {starts[k]:,} on", int(starts[k])
