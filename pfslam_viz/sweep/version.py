"""Which code a cell was run with: the version, and a digest of the sources that a result depends on."""

import hashlib
from functools import cache
from pathlib import Path

from pfslam_viz import __version__

PARTS = ("geometry.py", "replay.py", "settings.py", "config.py", "robot.py", "slam", "recordings", "evaluation")
"""Of the package: what decides a cell's numbers. Viewer, commands and figures do not."""


@cache
def code_version() -> str:
    """Such as ``0.2.0+3f9a1c02``: the same wherever the same code runs, another one where a result might differ."""
    package = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    for part in PARTS:
        path = package / part
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.relative_to(package).as_posix().encode() + b"\0" + file.read_bytes() + b"\0")
    return f"{__version__}+{digest.hexdigest()[:8]}"
