"""The sizes of types that are remembered are LLVM's."""

from typing import Any

import numba
import pytest
from numba.core.base import BaseContext
from numba.core.registry import cpu_target

from pfslam_viz.compiling.sizes import remembered_sizes

types: Any = numba.types
OF = [types.int64, types.float32, types.boolean, types.Array(types.float32, 2, "C"), types.UniTuple(types.float64, 3)]


def test_sizes_are_asked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    context: Any = cpu_target.target_context
    base: Any = BaseContext
    own, asked = base.get_abi_sizeof, list[Any]()

    def get_abi_sizeof(self: Any, of: Any) -> Any:
        asked.append(of)
        return own(self, of)

    monkeypatch.setattr(BaseContext, "get_abi_sizeof", get_abi_sizeof)
    values = [context.get_value_type(one) for one in OF]
    expected = [own(context, one) for one in values]
    assert expected == [8, 4, 1, 9 * 8, 24]  # an array: memory, parent, items, item's size, data, shape and strides
    with remembered_sizes():
        for _ in range(3):
            assert [context.get_abi_sizeof(context.get_value_type(one)) for one in OF] == expected
        assert len(asked) == len(OF)
    assert context.get_abi_sizeof(values[0]) == 8 and len(asked) == len(OF) + 1
