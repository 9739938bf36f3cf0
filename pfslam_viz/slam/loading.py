"""The kernels before the first scan: compiled on a machine's first run, from numba's cache afterwards."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


def load_kernels(on_compile: Callable[[], object] = lambda: None) -> None:
    """Compile the filter's kernels, or load them from the cache of an earlier run.

    ``on_compile`` is called whenever numba starts to compile a function.
    """
    with announced(on_compile), _without_blas():
        from pfslam_viz.slam.warm_up import warm_up

        warm_up()


@contextmanager
def announced(on_compile: Callable[[], object]) -> Iterator[None]:
    """Call ``on_compile`` whenever numba starts to compile a function: only the first run on a machine does."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            on_compile()

        def on_end(self, event: Any) -> None:
            pass

    with event.install_listener("numba:compile", Listener()):
        yield


@contextmanager
def _without_blas() -> Iterator[None]:
    """Spare the import of SciPy's linear algebra, 0.3 s.

    numba asks for it when the first kernel is loaded, for ``np.correlate`` in kernels alone; none here calls that.
    """
    name = "scipy.linalg.cython_blas"
    if name in sys.modules:
        yield
        return
    sys.modules[name] = None  # type: ignore[assignment]  # an import of it raises ImportError
    try:
        yield
    finally:
        del sys.modules[name]
