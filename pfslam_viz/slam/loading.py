"""Kernels that are compiled when they are called, which only those are that nobody compiled beforehand."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


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
