"""Time stamps of 32-bit counters, which start again from 0 after 2^32 ticks."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# 2^32 ticks of s, ms and us, in s. (2^32 ns are only 4.3 s, which a disordered log may well run backwards.)
_PERIODS = (2.0**32, 2.0**32 / 1e3, 2.0**32 / 1e6)
# The longest pause (s) within which a wrap is recognised as one.
_LONGEST_PAUSE = 60.0


def wrap_period(stamps: Array) -> float | None:
    """The period in s with which stamps (n,) in the order of the lines start again, None if they do not.

    A step back is a wrap if adding 2^32 ticks makes it a short step ahead, and if all stamps lie within one range of an
    unsigned or signed counter. The ticks may be of any of the units above, whether the stamps are in s or in ticks.
    """
    stamps = stamps[np.isfinite(stamps)]
    if len(stamps) < 2:
        return None
    low, high = float(stamps.min()), float(stamps.max())
    back = np.diff(stamps)
    back = back[back < 0]
    for period in _PERIODS:
        in_range = (low >= 0 and high <= period) or (low >= -period / 2 and high <= period / 2)
        longest = min(_LONGEST_PAUSE * (1e3 if period == _PERIODS[0] else 1.0), 0.05 * period)
        if in_range and ((back + period >= 0) & (back + period < longest)).any():
            return period
    return None


def unwrapped(stamps: Array, period: float, like: float | None = None) -> Array:
    """Stamps (n,) in the order of the lines with whole periods added, so that they run on; near ``like`` if given."""
    finite = np.isfinite(stamps)
    result = stamps.copy()
    result[finite] = np.unwrap(stamps[finite], period=period)
    if like is not None and finite.any():
        result += period * np.rint((like - result[finite][0]) / period)
    return result
