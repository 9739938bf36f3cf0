"""Two threads for kernels that release the interpreter's lock: the halves of an array, worked on side by side.

Every element's result depends on that element alone, so the results do not depend on the threads.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

Part = TypeVar("Part")


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, thread_name_prefix="kernel")


def in_halves(work: Callable[[slice], Part], count: int, *, worth: int) -> list[Part]:
    """``work`` on both halves of ``count`` elements, in order; on all at once where there are fewer than ``worth``."""
    if count < worth:
        return [work(slice(0, count))]
    other = _pool().submit(work, slice(count // 2, count))
    return [work(slice(0, count // 2)), other.result()]
