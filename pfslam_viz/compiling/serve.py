"""The other process that compiles: ``python -m pfslam_viz.compiling.serve`` (see :mod:`pfslam_viz.compiling.compile`).

It imports next to nothing, so that it starts soon.
"""

import gc
import sys
from collections.abc import Iterable

from pfslam_viz.compiling.kernel import find, types_of, without_blas
from pfslam_viz.compiling.signatures import remembered_signatures
from pfslam_viz.compiling.sizes import remembered_sizes


def serve(names: Iterable[str]) -> None:
    """Compile the kernels with these names, and say so, a line each."""
    with without_blas(), remembered_signatures(), remembered_sizes():
        for line in names:
            compiled, signature = find(line.strip())
            compiled.compile(types_of(compiled, signature))
            print(line.strip(), flush=True)


if __name__ == "__main__":
    # What numba makes of a kernel is walked by the garbage collector again and again: a tenth of this process's time.
    gc.set_threshold(500_000)
    serve(sys.stdin)
    gc.freeze()  # nor as the interpreter ends
