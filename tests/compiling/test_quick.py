"""While kernels are compiled no garbage is collected; afterwards it is as before."""

import gc

import pytest

from pfslam_viz.compiling.quick import quick_numba


@pytest.mark.parametrize("on", [True, False])
def test_the_garbage_collector_is_as_before(on: bool) -> None:
    assert gc.isenabled()
    try:
        if not on:
            gc.disable()
        with pytest.raises(ValueError), quick_numba():
            assert not gc.isenabled()
            raise ValueError
        assert gc.isenabled() is on
    finally:
        gc.enable()
