"""Where a kernel's variables are last used, found when it is asked for.

Numba finds it anew after each of its passes, for generators, and uses it once: a twentieth of the time to compile.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import postproc, transforms

processor: Any = postproc.PostProcessor
Lifetime: Any = postproc.VariableLifetime
tidied: Any = transforms.canonicalize_cfg


@contextmanager
def lazy_lifetimes() -> Iterator[None]:
    """Have numba work out the lifetimes of variables only where it writes their ends down, or for a generator."""
    work_out = processor.run

    def run(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
        code = self.func_ir
        if emit_dels or code.is_generator:
            work_out(self, emit_dels, extend_lifetimes)
            return
        code.blocks = tidied(code.blocks)
        code.variable_lifetime = Lifetime(code.blocks)  # which works them out when it is asked
        code.generator_info = None

    processor.run = run
    try:
        yield
    finally:
        processor.run = work_out
