"""How a kernel is declared: a function that numba compiles, with the types that it is called with.

Compiling is most of a first run on a machine, and grows with what a kernel holds: :func:`kernel` leaves out the entries
that nobody calls through, and its ``signature`` lets :mod:`pfslam_viz.compiling.compile` compile all kernels before
they are called, in two processes.
"""

import inspect
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, TypeVar, cast

import numba
from numba import njit

from pfslam_viz.compiling.cache import use_cache
from pfslam_viz.compiling.pipeline import EntryKernel, InnerKernel
from pfslam_viz.spared import spared

PACKAGE = "pfslam_viz"
types: Any = numba.types
F = TypeVar("F", bound=Callable[..., Any])

SIGNATURES: dict[str, list[tuple[Any, str]]] = {}
"""By module, in the order of their declaration: the kernels that Python calls, and what with."""


def kernel(signature: str | None = None, **options: Any) -> Callable[[F], F]:
    """Have numba compile a function, for calls that release the interpreter's lock.

    ``signature`` names the types of the arguments as numba does, ``"f8[:, ::1], i8"``, or a :class:`~typing.NamedTuple`
    of the kernel's module. A kernel without one is for other kernels only, and cannot be called from Python. Whatever
    is called with other types is compiled when that happens. ``options`` are numba's.
    """
    inner = signature is None
    options = {"nogil": True, "no_cfunc_wrapper": True, "no_cpython_wrapper": True} | options
    options["pipeline_class"] = InnerKernel if inner else EntryKernel

    def declare(function: F) -> F:
        try:
            compiled = njit(cache=use_cache() and not inner, **options)(function)
        except RuntimeError:  # there is a place for a cache, but not for this module's
            compiled = njit(**options)(function)
        if signature is not None:
            SIGNATURES.setdefault(function.__module__, []).append((compiled, signature))
        return cast(F, compiled)

    return declare


def types_of(compiled: Any, signature: str) -> tuple[Any, ...]:
    """The argument types that a kernel's ``signature`` names."""
    found = []
    for name, axes in re.findall(r"(\w+)(\[[^\]]*\])?", signature):
        one = getattr(types, name, None) or _named_tuple(compiled.py_func.__globals__[name])
        found.append(types.Array(one, axes.count(",") + 1, "C" if "::1" in axes else "A") if axes else one)
    code = compiled.py_func.__code__
    if code.co_flags & inspect.CO_VARARGS:
        return *found[: code.co_argcount], types.Tuple(found[code.co_argcount :])
    return tuple(found)


def _named_tuple(of: Any) -> Any:
    """Its fields are whole numbers where they are declared so, and else floats."""
    return types.NamedTuple([types.int64 if t is int else types.float64 for t in of.__annotations__.values()], of)


def find(name: str) -> tuple[Any, str]:
    """A kernel by its name, ``module.kernel`` within the package, and its signature."""
    module, _, kernel = name.rpartition(".")
    import_module(f"{PACKAGE}.{module}")
    return next(pair for pair in SIGNATURES[f"{PACKAGE}.{module}"] if pair[0].py_func.__name__ == kernel)


@contextmanager
def without_blas() -> Iterator[None]:
    """Spare the import of SciPy's linear algebra, 0.3 s.

    numba asks for it when the first kernel is loaded, for functions of linear algebra in kernels; none here calls one.
    """
    with spared("scipy.linalg.cython_blas"):
        yield
