"""The other process that compiles: ``python -m pfslam_viz.compiling.serve`` (see :mod:`pfslam_viz.compiling.compile`).

It imports next to nothing, so that it starts soon.
"""

import gc
import sys
from collections.abc import Iterable

from pfslam_viz.compiling.kernel import find, types_of
from pfslam_viz.compiling.quick import quick_numba


def serve(names: Iterable[str]) -> None:
    """Compile the kernels with these names, and say so, a line each."""
    with quick_numba():
        for line in names:
            compiled, signature = find(line.strip())
            compiled.compile(types_of(compiled, signature))
            print(line.strip(), flush=True)


if __name__ == "__main__":
    serve(sys.stdin)
    gc.freeze()  # so that no garbage is collected as the interpreter ends
