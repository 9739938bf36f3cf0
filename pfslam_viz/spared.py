"""Imports that other packages try, and that nothing here needs."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


class _Refusal:
    """Stands among what finds modules, and knows that one is not to be found.

    None among the imported ones would say so to Python, but Cython, which pyarrow is written in, takes it for a module.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def find_spec(self, name: str, *_: Any) -> None:
        """Nothing about any module; for the one, raise ModuleNotFoundError."""
        if name == self._name:
            raise ModuleNotFoundError(f"{name} is not needed", name=name)


@contextmanager
def spared(name: str) -> Iterator[None]:
    """Have an import of the module ``name`` raise ImportError meanwhile, as if it were not installed.

    Unless it has been imported already.
    """
    refusal: Any = _Refusal(name)
    sys.meta_path.insert(0, refusal)
    try:
        yield
    finally:
        sys.meta_path.remove(refusal)
