"""A kernel's place in the cache, which nothing in it can make a run fail.

numba asks the cache before it compiles. Here a kernel that is not there may be looked for once more, when another
process has compiled it, and what cannot be read or written is compiled for this run alone.
"""

from collections.abc import Callable
from typing import Any


class NotStoredError(Exception):
    """The kernel is not in the cache, and was not to be compiled."""


class Stored:
    """Stands before numba's cache of one kernel, and is asked in its place."""

    def __init__(self, cache: Any, fetch: Callable[[], bool], say: Callable[[str], object]) -> None:
        """For numba's ``cache``. ``fetch`` waits until another process has stored the kernel, if one does."""
        self._cache, self._fetch, self._say = cache, fetch, say
        self.only_load = False  # raise NotStoredError for what is not in the cache

    def __getattr__(self, name: str) -> Any:
        return getattr(self._cache, name)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The compiled kernel, or None where it must be compiled here."""
        found = self._load(signature, target)
        if found is None and self.only_load:
            raise NotStoredError
        if found is None and self._fetch():
            found = self._load(signature, target)
        return found

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Keep it; where that fails, the next run compiles it again."""
        try:
            self._cache.save_overload(signature, compiled)
        except Exception as error:  # whatever is wrong with a cache, the kernel is compiled
            self._say(f"a compiled kernel cannot be kept in {self._cache.cache_path}: {error}")

    def _load(self, signature: Any, target: Any) -> Any:
        try:
            return self._cache.load_overload(signature, target)
        except Exception:  # cut off, or not a cache's
            self._drop()
            return None

    def _drop(self) -> None:
        try:
            self._cache.flush()
        except Exception as error:
            self._say(f"the compiled kernels in {self._cache.cache_path} cannot be read: {error}")
