"""Numba while kernels are compiled: it asks once what it would ask again and again."""

import gc
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import numba

from pfslam_viz.compiling.arrays import remembered_arrays
from pfslam_viz.compiling.kernel import without_blas
from pfslam_viz.compiling.lifetimes import lazy_lifetimes
from pfslam_viz.compiling.pipeline import KNOWN
from pfslam_viz.compiling.signatures import remembered_signatures
from pfslam_viz.compiling.sizes import remembered_sizes


@contextmanager
def uncollected() -> Iterator[None]:
    """Have no garbage collected: what numba makes of a kernel would be walked for it, for a twentieth of the time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


PRIVATE = (remembered_signatures, remembered_sizes, remembered_arrays, lazy_lifetimes)
"""Those that put something in the place of numba's own functions, which other releases may not have so."""


@contextmanager
def quick_numba() -> Iterator[None]:
    """All that spares numba work, and changes nothing of what it makes."""
    with ExitStack() as stack:
        for saving in (uncollected, without_blas, *(PRIVATE if numba.version_info[:2] in KNOWN else ())):
            stack.enter_context(saving())
        yield
