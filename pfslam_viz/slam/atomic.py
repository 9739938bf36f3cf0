"""A counter that kernels on several threads share: numba itself has none for processors."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray


def _code_of_fetch_add(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        elements, position, more = arguments
        data = context.make_array(signature.args[0])(context, builder, elements).data
        return builder.atomic_rmw("add", builder.gep(data, [position]), more, "seq_cst")

    return types.int64(array, types.int64, types.int64), generate


fetch_add: Callable[[NDArray[np.int64], int, int], int] = cast(Any, intrinsic(_code_of_fetch_add))
"""``fetch_add(array, index, value)`` adds to an element of a contiguous int64 array and returns what it was, in one
step that no other thread can split. For use in kernels; the index is not checked."""
