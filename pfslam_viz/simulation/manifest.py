"""What a simulated recording was made with. Apart from the simulator, so that looking it up loads none of it."""

import json
from pathlib import Path

from pfslam_viz.files import read_small

VERSION = 3  # of the generator: raised when the same seed gives other bytes
MANIFEST = "simulation.json"


def manifest_of(folder: Path) -> dict[str, object] | None:
    """What the recording in ``folder`` was made with; None if it is not a complete simulated one."""
    try:
        manifest = json.loads(read_small(folder / MANIFEST))
    except (OSError, ValueError, RecursionError):
        return None
    return manifest if isinstance(manifest, dict) else None


def is_simulated(folder: Path) -> bool:
    """Whether the recording in ``folder`` was made by the simulator, of whatever version."""
    return {"generator", "building", "seed"} <= (manifest_of(folder) or {}).keys()
