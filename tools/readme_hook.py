"""README.md as a package index shows it: links to files of the repository are absolute there, or left out.

``PFSLAM_VIZ_URL`` is where the repository can be looked at (such as https://host/owner/pfslam-viz), when the package is
built. Without it, pictures are left out and other links become plain words, so that no link is a broken one.
"""

import os
import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:|#|/)([^)\s]+)\)")


def absolute(markdown: str, base: str) -> str:
    """``markdown`` with its relative links led to ``base``; without a base, pictures go and words stay."""

    def link(match: re.Match[str]) -> str:
        picture, words, target = match.groups()
        if not base:
            return "" if picture else words
        kind = "raw" if picture else "blob"
        return f"{picture}[{words}]({base}/{kind}/main/{target})"

    return re.sub(r"\n{3,}", "\n\n", _LINK.sub(link, markdown))


class ReadmeHook(MetadataHookInterface):
    """The long description."""

    def update(self, metadata: dict[str, Any]) -> None:
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        base = os.environ.get("PFSLAM_VIZ_URL", "").rstrip("/")
        metadata["readme"] = {"content-type": "text/markdown", "text": absolute(text, base)}
