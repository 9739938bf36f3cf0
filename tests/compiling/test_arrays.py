"""Which types have no conversion to an array is remembered, and nothing else of a look-up is."""

from typing import Any

import numba
import numpy as np
import pytest
from numba.core.base import BaseContext
from numba.core.registry import cpu_target
from numba.core.typing import templates
from numba.extending import lower_builtin

from pfslam_viz.compiling.arrays import CONVERSION, remembered_arrays

types: Any = numba.types
signature: Any = templates.signature
ARRAYS = [types.Array(types.float32, 2, "C"), types.Array(types.int64, 1, "A")]


def test_an_array_is_asked_for_a_conversion_once(monkeypatch: pytest.MonkeyPatch) -> None:
    context: Any = cpu_target.target_context
    base: Any = BaseContext
    own, asked = base.get_function, list[Any]()

    def get_function(self: Any, function: Any, of: Any, *rest: Any, **named: Any) -> Any:
        asked.append(of)
        return own(self, function, of, *rest, **named)

    monkeypatch.setattr(BaseContext, "get_function", get_function)
    with remembered_arrays():
        for array in ARRAYS * 3:
            with pytest.raises(NotImplementedError):
                context.get_function(CONVERSION, signature(array, array))
        assert {len([of for of in asked if of.args == (array,)]) for array in ARRAYS} == {2}  # numba asks itself again
    before = len(asked)
    with pytest.raises(NotImplementedError):
        context.get_function(CONVERSION, signature(ARRAYS[0], ARRAYS[0]))
    assert len(asked) == before + 2


def test_a_type_that_says_how_it_becomes_an_array_is_found() -> None:
    context: Any = cpu_target.target_context
    other = types.Opaque("becomes an array")
    declare: Any = lower_builtin
    lower = declare(CONVERSION, types.Opaque)
    with remembered_arrays():
        with pytest.raises(NotImplementedError):
            context.get_function(CONVERSION, signature(ARRAYS[0], ARRAYS[0]))
        lower(lambda *of: None)
        for _ in range(2):
            context.get_function(CONVERSION, signature(ARRAYS[0], other))


def test_kernels_give_the_same() -> None:
    with remembered_arrays():

        @numba.njit
        def total(values: Any) -> float:
            part = values[1:]
            part[0] += 1.0
            return float(part.sum())

        assert total(np.arange(4.0)) == 7.0
