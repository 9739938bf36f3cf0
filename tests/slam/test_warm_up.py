"""What must be compiled before the loop, is."""

from types import ModuleType

import pytest

from pfslam_viz.slam import kernels, map_kernels
from pfslam_viz.slam.warm_up import warm_up


@pytest.mark.parametrize("module", [kernels, map_kernels])
def test_warm_up_compiles_every_kernel(module: ModuleType) -> None:
    warm_up()
    public = {name: k for name, k in vars(module).items() if hasattr(k, "signatures") and not name.startswith("_")}
    assert len(public) > 2
    assert [name for name, kernel in public.items() if not kernel.signatures] == []
