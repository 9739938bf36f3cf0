"""What numba does to compile a kernel: of its own passes, those that plain loops need.

Left out are those that rewrite array expressions, closures, literals, inlined functions and ``with``: kernels have
none, and each pass looks through the whole kernel for them. Custom pipelines are numba's documented way to do this.
"""

from typing import Any

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

BEFORE = (
    TranslateByteCode, FixupArgs, IRProcessing, GenericRewrites, ReconstructSSA, NopythonTypeInference,
    PreLowerStripPhis, InlineOverloads, NoPythonSupportedFeatureValidation, IRLegalization, AnnotateTypes,
)  # fmt: skip


class _EntryLower(Lower):
    """Makes the entry from Python along with the kernel."""

    def lower(self) -> None:
        """Both of them."""
        super().lower()  # type: ignore[no-untyped-call]
        self.create_cpython_wrapper(True)  # type: ignore[no-untyped-call]


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class EntryLowering(BaseNativeLowering):
    """As numba's own, with an entry whatever the flags say.

    What a kernel calls of numba's own, such as ``np.empty``, is compiled once for all kernels of the same flags: they
    all say that there is no entry.
    """

    _name: Any = "entry_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        """What does it."""
        return _EntryLower


class InnerKernel(CompilerBase):
    """Compiles a kernel that only kernels call."""

    lowering: Any = NativeLowering

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
