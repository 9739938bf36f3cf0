"""What numba does to compile a kernel: of its own passes, those that plain loops need.

Left out are those that rewrite array expressions, closures, literals, inlined functions and ``with``: kernels have
none, and each pass looks through the whole kernel for them. Custom pipelines are numba's documented way to do this.
"""

from typing import Any

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import (
    AnnotateTypes,
    BaseNativeLowering,
    InlineOverloads,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NoPythonSupportedFeatureValidation,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import FixupArgs, GenericRewrites, IRProcessing, ReconstructSSA, TranslateByteCode

from pfslam_viz.compiling.inlined import CallInlined

BEFORE = (
    TranslateByteCode, FixupArgs, IRProcessing, GenericRewrites, ReconstructSSA, CallInlined, NopythonTypeInference,
    PreLowerStripPhis, InlineOverloads, NoPythonSupportedFeatureValidation, IRLegalization, AnnotateTypes,
)  # fmt: skip


KNOWN = ((0, 68),)
"""Releases of numba whose libraries are as the two below take them to be: with others, kernels have numba's own."""


class _Library(JITCodeLibrary):
    """A kernel's code, which LLVM optimises once, with all that it calls; numba has it do so three times.

    Where sums may be reordered, they are in the order that numba's own passes leave.
    """

    _reorders = False

    @property
    def reorders(self) -> bool:
        """Whether it, or a kernel that ends within it, is compiled with ``fastmath``."""
        return self._reorders or any(getattr(one, "reorders", False) for one in self._linking_libraries)

    def _optimize_functions(self, module: Any) -> None:
        """Leave the functions that the module has as they are until they are linked."""
        codegen: Any = self._codegen
        module.data_layout = codegen._data_layout
        if not self.reorders:
            return
        for function in module.functions:
            if not function.is_declaration:  # numba has LLVM optimise declarations, too
                passes, builder = codegen._function_pass_manager()
                passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        """All of LLVM's passes."""
        if self.reorders:
            super()._optimize_final_module()  # type: ignore[no-untyped-call]
            return
        codegen: Any = self._codegen
        passes, builder = codegen._module_pass_manager()
        passes.run(self._final_module, builder)


class _InnerLibrary(_Library):
    """A kernel that ends within those that call it: it is optimised with them, and is machine code nowhere else."""

    def get_pointer_to_function(self, name: str) -> int:
        """None: it has no entry."""
        self._ensure_finalized()  # type: ignore[no-untyped-call]
        return 0

    def _optimize_final_module(self) -> None:
        """Leave it to the kernels that call it."""

    def _finalize_final_module(self) -> None:
        """And the making of machine code."""
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """What has nothing to set: environments are for machine code that talks to Python."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing."""


class _EntryLower(Lower):
    """Makes the entry from Python along with the kernel."""

    def lower(self) -> None:
        """Both of them."""
        super().lower()  # type: ignore[no-untyped-call]
        self.create_cpython_wrapper(True)  # type: ignore[no-untyped-call]


def _lower_into(library: type[_Library], state: Any) -> None:
    """Have a kernel lowered into a ``library`` of this kind, where numba's are known."""
    if numba.version_info[:2] in KNOWN:
        make: Any = library
        state.library = make(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library._reorders = bool(state.flags.fastmath)
        state.library.enable_object_caching()


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class EntryLowering(BaseNativeLowering):
    """As numba's own, with an entry whatever the flags say.

    What a kernel calls of numba's own, such as ``np.exp``, is compiled once for all kernels of the same flags: they
    all say that there is no entry.
    """

    _name: Any = "entry_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        """What does it."""
        return _EntryLower

    def run_pass(self, state: Any) -> bool:
        """Lower it."""
        _lower_into(_Library, state)
        done: bool = super().run_pass(state)  # type: ignore[no-untyped-call]
        return done


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class InnerLowering(NativeLowering):
    """As numba's own, into what never becomes machine code by itself."""

    _name: Any = "inner_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower it."""
        _lower_into(_InnerLibrary, state)
        done: bool = super().run_pass(state)  # type: ignore[no-untyped-call]
        return done


class InnerKernel(CompilerBase):
    """Compiles a kernel that only kernels call."""

    lowering: Any = InnerLowering

    def define_pipelines(self) -> list[PassManager]:
        """The one there is."""
        passes: Any = PassManager("kernel")  # type: ignore[no-untyped-call]
        for one in (*BEFORE, self.lowering, NoPythonBackend):
            passes.add_pass(one, one._name)
        passes.finalize()
        return [passes]


class EntryKernel(InnerKernel):
    """Compiles a kernel that Python calls, too."""

    lowering = EntryLowering
