"""While kernels are compiled no garbage is collected and a known numba works less; afterwards all is as before."""

import gc

import numba
import pytest
from numba.core import postproc

from pfslam_viz.compiling.pipeline import KNOWN
from pfslam_viz.compiling.quick import quick_numba

THIS = numba.version_info[:2]


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


@pytest.mark.parametrize(("release", "own"), [(THIS, THIS not in KNOWN), ((0, 99), True)])
def test_only_a_known_numba_is_changed(release: tuple[int, int], own: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(numba, "version_info", release)
    before = postproc.PostProcessor.run
    with quick_numba():
        assert (postproc.PostProcessor.run is before) is own
    assert postproc.PostProcessor.run is before
