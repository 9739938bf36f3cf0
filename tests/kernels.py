"""Kernels that only other kernels call, called from Python."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def from_python(kernel: F) -> F:
    """A kernel that Python can call, and that calls this one."""

    @njit
    def call(*arguments: Any) -> Any:
        return kernel(*arguments)

    return cast(F, call)
