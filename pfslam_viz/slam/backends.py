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
    it runs, since kernels are slow to import. ``kernels`` are those that it calls, module by module in the order in
    which it needs them, and ``later_kernels`` those that it needs some way into a run, or at its end; those that every
    back end calls are in :mod:`pfslam_viz.compiling.needed`.
    """

    settings: type[Config]
    filter: str
    kernels: tuple[tuple[str, str], ...] = ()
    later_kernels: tuple[tuple[str, str], ...] = ()


BACKENDS: dict[str, Backend] = {
    "single_map": Backend(
        PaperConfig,
        "pfslam_viz.slam.paper.particle_filter:ParticleFilter",
        (("slam.kernels", "correlate project"), ("slam.map_kernels", "add_scan")),
    ),
    "rao_blackwellized": Backend(
        RbpfConfig,
        "pfslam_viz.slam.rbpf.rao_blackwellized:RaoBlackwellizedFilter",
        (
            ("slam.kernels", "compose"),
            ("slam.rbpf.proposal", "propose spread_points"),
            ("slam.rbpf.tile_kernels", "write_scans project"),
            ("slam.graph.walls", "within thinned describe"),
            ("slam.rbpf.history", "_descent"),
        ),
        (
            ("slam.graph.visits", "earlier_visits"),
            ("slam.graph.scan_matching", "match_pairs"),
            ("slam.graph.shared_walls", "shared_normals"),
            ("slam.graph.drift", "_variances"),
            ("slam.graph.loop_closing", "overlay"),
            ("slam.graph.branch_and_bound", "_sums _refine"),
            ("slam.graph.evidence", "_agreement"),
        ),
    ),
}


def make_slam(config: Config, worker: "Worker | None" = None) -> "Slam":
    """The back end that the configuration names. It may have the ``worker`` help it."""
    module, _, name = BACKENDS[config.backend].filter.partition(":")
    make: Callable[[Any, Any], Slam] = getattr(import_module(module), name)
    return make(config, worker)
