"""What numba finds an operator to return for arguments of some types, found once.

For every ``+`` and every index in a kernel numba asks each of its implementations in turn, those for strings, lists and
sets before those for numbers, and makes a message of every refusal: a sixth of the time that it takes to compile.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.types.functions import BaseFunction

Found = dict[tuple[Any, ...], Any]


@contextmanager
def remembered_signatures() -> Iterator[None]:
    """Have numba look up a function's signature for the same types of arguments once.

    Those that numba has to compile for the call are not remembered, as they depend on the caller's flags.
    """
    look_up = BaseFunction.get_call_type
    known: dict[int, tuple[Any, Found]] = {}  # by identity, which keeping the function keeps its own

    def get_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
        found, types = known.setdefault(id(self), (self, {}))[1], tuple(args)
        if not kws and types in found:
            return found[types]
        signature = look_up(self, context, args, kws)
        if not kws and signature is not None and self._impl_keys.get(signature.args) is self.typing_key:
            found[types] = signature
        return signature

    function: Any = BaseFunction
    function.get_call_type = get_call_type
    try:
        yield
    finally:
        function.get_call_type = look_up
