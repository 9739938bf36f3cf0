"""``pfslam-viz compile``: every kernel beforehand, for images of containers and for clusters."""

from pfslam_viz import console
from pfslam_viz.compiling import cache
from pfslam_viz.compiling.compile import compile_all
from pfslam_viz.compiling.needed import every
from pfslam_viz.errors import PfslamError


def run(quiet: bool = False) -> None:
    """Compile what is not in the cache. Raises PfslamError where there is no place for one."""
    if not cache.use_cache():
        raise PfslamError(cache.where())
    wanted = every()
    with console.steps("compiling", quiet) as show:
        compiled = compile_all(wanted, show)
    if not quiet:
        kernels = len(wanted.first)
        before = "" if compiled == kernels else f", {kernels - compiled} were before"
        console.results().print(f"{compiled} of {kernels} kernels compiled{before}", markup=False, soft_wrap=True)
        console.results().print(cache.where(), markup=False, soft_wrap=True)
