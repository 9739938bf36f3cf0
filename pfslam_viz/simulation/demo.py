"""The ``demo`` recording: simulated on first use."""

from pathlib import Path

from pfslam_viz.simulation.manifest import VERSION, manifest_of

NAME = "demo"
BUILDING, SEED = "office", 9


def ensure_demo(folder: Path) -> Path:
    """The demo recording's folder, ``folder/demo``, made if it is missing or another version's.

    It appears complete or not at all. Raises InputError if it cannot be written, or if other files are in its place.
    """
    out = folder / NAME
    wanted = {"generator": VERSION, "building": BUILDING, "seed": SEED}
    manifest = manifest_of(out) or {}
    if any(manifest.get(key) != value for key, value in wanted.items()):
        from pfslam_viz.simulation.recording import simulate

        simulate(out, seed=SEED, building=BUILDING)
    return out
