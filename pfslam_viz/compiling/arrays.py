"""Which types of arrays need no conversion to one, asked once.

For every use of an array numba looks for a conversion, has none, and loads all of its registries to look again.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.base import BaseContext

CONVERSION = "__array__"


@contextmanager
def remembered_arrays() -> Iterator[None]:
    """Have numba remember which types have no ``__array__``, as NumPy's own have none."""
    base: Any = BaseContext
    look_up = base.get_function
    without = set[Any]()

    def get_function(self: Any, function: Any, signature: Any, *rest: Any, **named: Any) -> Any:
        if function != CONVERSION:
            return look_up(self, function, signature, *rest, **named)
        if signature in without:
            raise NotImplementedError(f"no {CONVERSION} of {signature}")
        try:
            return look_up(self, function, signature, *rest, **named)
        except NotImplementedError:
            without.add(signature)
            raise

    base.get_function = get_function
    try:
        yield
    finally:
        base.get_function = look_up
