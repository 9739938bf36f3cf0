"""The table of back ends: a row each. Nothing else names one."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from pfslam_viz.settings import Config
from pfslam_viz.slam.paper.settings import PaperConfig
from pfslam_viz.slam.rbpf.settings import RbpfConfig

if TYPE_CHECKING:
    from pfslam_viz.slam.protocol import Slam
    from pfslam_viz.slam.worker import Worker


@dataclass(frozen=True, slots=True)
class Backend:
    """One back end: its settings, and where its filter is, ``module:class``.

    The class is made with ``(config, worker)`` and follows :class:`pfslam_viz.slam.protocol.Slam`. It is imported when
    it runs, since kernels are slow to import.
    """

    settings: type[Config]
    filter: str


BACKENDS: dict[str, Backend] = {
    "single_map": Backend(PaperConfig, "pfslam_viz.slam.paper.particle_filter:ParticleFilter"),
    "rao_blackwellized": Backend(RbpfConfig, "pfslam_viz.slam.rbpf.rao_blackwellized:RaoBlackwellizedFilter"),
}


def make_slam(config: Config, worker: "Worker | None" = None) -> "Slam":
    """The back end that the configuration names. It may have the ``worker`` help it."""
    module, _, name = BACKENDS[config.backend].filter.partition(":")
    make: Callable[[Any, Any], Slam] = getattr(import_module(module), name)
    return make(config, worker)
