"""What must be compiled before the loop, is."""

import subprocess
import sys

from pfslam_viz.slam import kernels, map_kernels

INNER = {"bundles", "end_cells", "write_scan"}  # called by kernels alone, and compiled into them


def test_warm_up_compiles_every_kernel() -> None:
    """In an interpreter of its own, where no other test has called one."""
    code = (
        "from pfslam_viz.slam import kernels, map_kernels\nfrom pfslam_viz.slam.warm_up import warm_up\nwarm_up()\n"
        "print(*(n for m in (kernels, map_kernels) for n, k in vars(m).items() if getattr(k, 'signatures', None)))"
    )
    compiled = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    public = {name for module in (kernels, map_kernels) for name, k in vars(module).items() if hasattr(k, "signatures")}
    assert {"correlate", "add_scan"} <= set(compiled)
    assert public - set(compiled) <= INNER
