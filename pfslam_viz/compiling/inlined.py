"""Functions of NumPy's and Python's own that kernels call everywhere, written out where they are called.

Numba compiles its ``np.empty``, ``np.zeros``, ``min`` and ``max`` as functions of their own, anew for all types, flags
and processes, and optimises them within each kernel that calls one: 2 of the 15 s that all kernels took. What is here
makes the same values in a few instructions, with numba's documented means: intrinsics, and a pass that has kernels call
them. Kernels themselves stay plain NumPy. Whatever it does not know is left to numba.
"""

import operator
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba.core import cgutils, ir
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.typing import npydecl, templates
from numba.extending import intrinsic
from numba.np import arrayobj

types: Any = numba.types
instructions: Any = cgutils
declared: Any = npydecl
arrays: Any = arrayobj
signature_of: Any = templates.signature
Lowering = tuple[Any, Callable[..., Any]]
"""A signature, and what makes its instructions. No signature has numba say that there is no such function."""


def _array(shape: Any, dtype: Any, zero: bool) -> Lowering | None:
    """As ``np.empty(shape, dtype)``, whose elements are 0 if they are to be ``zero``."""
    is_float = dtype is None or getattr(dtype, "typing_key", None) is float
    element, axes = types.float64 if is_float else declared.parse_dtype(dtype), declared.parse_shape(shape)
    if element is None or axes is None:
        return None
    array = types.Array(element, axes, "C")

    def make(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        lengths, of = [arguments[0]], [shape]
        if isinstance(shape, types.BaseTuple):
            lengths, of = instructions.unpack_tuple(builder, arguments[0]), list(shape)
        lengths = [context.cast(builder, *pair, types.intp) for pair in zip(lengths, of, strict=True)]
        size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(element)))
        strides = [size]
        for length in reversed(lengths):
            strides.insert(0, builder.mul(strides[0], length))
        align = context.get_constant(types.uint32, context.get_preferred_array_alignment(element))
        memory = context.nrt.meminfo_alloc_aligned(builder, strides[0], align)
        data = context.nrt.meminfo_data(builder, memory)
        if zero:
            instructions.memset(builder, data, strides[0], 0)
        made = arrays.make_array(array)(context, builder)
        pointer = builder.bitcast(data, context.get_data_type(element).as_pointer())
        arrays.populate_array(made, pointer, lengths, strides[1:], size, memory)
        return made._getvalue()

    return array(shape, types.Omitted(None) if dtype is None else dtype), make


@intrinsic
def empty(_: Any, shape: Any, dtype: Any = None) -> Lowering | None:
    """As ``np.empty``."""
    return _array(shape, dtype, zero=False)


@intrinsic
def zeros(_: Any, shape: Any, dtype: Any = None) -> Lowering | None:
    """As ``np.zeros``."""
    return _array(shape, dtype, zero=True)


def _extreme(typing_context: Any, x: Any, y: Any, better: Any) -> Lowering | None:
    """The second of two numbers where it is ``better`` than the first, as Python and numba have it."""
    one = typing_context.unify_types(x, y)
    if not (isinstance(x, types.Number) and isinstance(y, types.Number) and isinstance(one, types.Number)):
        return None

    def make(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        first, second = (context.cast(builder, arguments[k], signature.args[k], one) for k in range(2))
        is_better = context.get_function(better, signature_of(types.boolean, one, one))
        return builder.select(is_better(builder, (second, first)), second, first)

    return one(x, y), make


@intrinsic
def least(typing_context: Any, x: Any, y: Any) -> Lowering | None:
    """As ``min``, of two numbers."""
    return _extreme(typing_context, x, y, operator.lt)


@intrinsic
def greatest(typing_context: Any, x: Any, y: Any) -> Lowering | None:
    """As ``max``, of two numbers."""
    return _extreme(typing_context, x, y, operator.gt)


ARRAYS = {"empty": empty, "zeros": zeros}
EXTREMES: dict[Any, Any] = {min: least, max: greatest}


@register_pass(mutates_CFG=False, analysis_only=False)  # type: ignore[no-untyped-call]
class CallInlined(FunctionPass):
    """Has a kernel call what is here where it calls ``np.empty``, say, or ``min`` of two arguments."""

    _name: Any = "call_inlined"

    def __init__(self) -> None:
        """For any kernel."""
        FunctionPass.__init__(self)  # type: ignore[no-untyped-call]

    def run_pass(self, state: Any) -> bool:
        """Put what is here in the place of the functions that it calls."""
        assigned = [one for block in state.func_ir.blocks.values() for one in block.find_insts(ir.Assign)]
        loaded = {one.target.name: one for one in assigned}
        calls = [one.value for one in assigned if isinstance(one.value, ir.Expr) and one.value.op == "call"]
        instead = [(loaded[call.func.name], _instead(call, loaded)) for call in calls]
        for one, function in instead:
            if function is not None:
                one.value = ir.Global(function.__name__, function, one.loc)  # type: ignore[no-untyped-call]
                state.func_ir._definitions[one.target.name] = [one.value]
        return any(function is not None for _, function in instead)


def _instead(call: Any, loaded: dict[str, Any]) -> Any:
    """What is to be called instead, or None for what is."""
    function = loaded[call.func.name].value
    if isinstance(function, ir.Global):
        return EXTREMES.get(function.value) if len(call.args) == 2 and not (call.kws or call.vararg) else None
    if not isinstance(function, ir.Expr) or function.op != "getattr" or function.attr not in ARRAYS:
        return None
    module = loaded[function.value.name].value
    return ARRAYS[function.attr] if isinstance(module, ir.Global) and module.value is np else None
