"""Kernels compiled with lifetimes worked out late: arrays are let go of as before, and generators are whole."""

from collections.abc import Iterator
from importlib import import_module
from typing import Any

import numba
import numpy as np
import pytest
from numba.core import analysis

from pfslam_viz.compiling.lifetimes import lazy_lifetimes
from pfslam_viz.compiling.pipeline import EntryKernel
from pfslam_viz.compiling.quick import quick_numba

make: Any = numba.njit
counts: Any = import_module("numba.core.runtime._nrt_python")


def test_lifetimes_are_worked_out_once_for_a_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    own, worked_out = analysis.compute_dead_maps, list[Any]()

    def compute_dead_maps(*of: Any) -> Any:
        worked_out.append(of)
        return own(*of)  # type: ignore[no-untyped-call]

    monkeypatch.setattr(analysis, "compute_dead_maps", compute_dead_maps)

    def compiled() -> int:
        doubled = make(pipeline_class=EntryKernel, no_cpython_wrapper=True)(lambda n: 2 * n)
        del worked_out[:]
        assert doubled(4) == 8
        return len(worked_out)

    assert compiled() > 1
    with lazy_lifetimes():
        assert compiled() == 1


def test_arrays_are_let_go_of_where_they_are_last_used() -> None:
    def several(n: int) -> float:
        total = 0.0
        for k in range(n):
            part = np.zeros(k + 1)
            part[k] = k
            if k % 2 == 0:
                other = np.empty(3)
                other[0] = part[k]
                total += other[0]
        return total

    with quick_numba():
        compiled = make(pipeline_class=EntryKernel, no_cpython_wrapper=True)(several)
        assert compiled(5) == 6.0
        counts.memsys_enable_stats()
        try:
            before = counts.memsys_get_stats_alloc(), counts.memsys_get_stats_free()
            assert compiled(5) == 6.0
            after = counts.memsys_get_stats_alloc(), counts.memsys_get_stats_free()
        finally:
            counts.memsys_disable_stats()
    assert [now - then for now, then in zip(after, before, strict=True)] == [8, 8]


def test_generators_keep_what_they_need() -> None:
    with lazy_lifetimes():

        @make  # type: ignore[untyped-decorator]
        def squares(n: int) -> Iterator[int]:
            total = 0
            for k in range(n):
                total += k * k
                yield total

        assert list(squares(4)) == [0, 1, 5, 14]
