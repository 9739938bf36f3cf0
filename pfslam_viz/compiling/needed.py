"""Which kernels a run calls, in the order in which it needs them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pfslam_viz.config import Config
from pfslam_viz.slam.backends import BACKENDS

Groups = Iterable[tuple[str, str]]

# Modules of pfslam_viz, each with kernels of it. Those of the back ends are in their own table.
LOOP = (("slam.kernels", "read_scan move moments pick transform"), ("slam.map_kernels", "add_scans"))
VIEWER = (
    ("viewer.kernels", "shade bridge descend trace fingerprints"),
    ("slam.map_kernels", "known_tiles"),
)
TEXTURE = {
    "mean": (("texture.kernels", "collect merge"),),
    "finest": (("texture.kernels", "collect match blend"),),
}
FITTED_CAMERA = (("texture.kernels", "off_plane"),)
LARGE_MAPS = (
    ("slam.map_kernels", "end_cells bundles scan_cells"),
)  # few recordings come to need it: by `compile` alone
SIMULATION = (
    ("simulation.sensors", "_true_ranges"),
    ("simulation.kinect", "_cast _paint"),
    ("simulation.floor", "floor_color"),
)


@dataclass(frozen=True, slots=True)
class Needed:
    """Names of kernels, ``module.kernel`` within the package: those of the first scans, and ``later`` ones."""

    first: tuple[str, ...]
    later: tuple[str, ...] = ()


def needed(configs: Sequence[Config], *, viewer: bool = False, texture: bool = False) -> Needed:
    """What runs under these configurations call, with a ``viewer`` to draw for and with images of the floor."""
    first, later = list[tuple[str, str]](LOOP), list[tuple[str, str]]()
    for config in configs:
        first += BACKENDS[config.backend].kernels
        later += BACKENDS[config.backend].later_kernels
        if texture and config.texture.enabled:
            first += TEXTURE[config.texture.blend]
            first += FITTED_CAMERA if config.texture.camera == "fitted" else ()
    if viewer:
        first += VIEWER
    return Needed(_names(first), _names(later))


def every() -> Needed:
    """Every kernel that there is."""
    groups = [*LOOP, *VIEWER, *FITTED_CAMERA, *LARGE_MAPS, *SIMULATION]
    for textures in TEXTURE.values():
        groups += textures
    for backend in BACKENDS.values():
        groups += (*backend.kernels, *backend.later_kernels)
    return Needed(_names(groups))


def _names(groups: Groups) -> tuple[str, ...]:
    return tuple(dict.fromkeys(f"{module}.{name}" for module, names in groups for name in names.split()))
