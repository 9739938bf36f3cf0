"""How large a type is, asked once: for every variable numba has LLVM read a module of text to know."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.base import BaseContext


@contextmanager
def remembered_sizes() -> Iterator[None]:
    """Have numba remember the sizes of LLVM's types.

    A kernel's context is a copy of numba's one context for the processor, and has the same sizes.
    """
    base: Any = BaseContext
    look_up = base.get_abi_sizeof
    sizes: dict[Any, int] = {}

    def get_abi_sizeof(self: Any, of: Any) -> int:
        key = type(self), of
        if key not in sizes:
            sizes[key] = look_up(self, of)
        return sizes[key]

    base.get_abi_sizeof = get_abi_sizeof
    try:
        yield
    finally:
        base.get_abi_sizeof = look_up
