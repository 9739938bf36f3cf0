"""What mkdocs is told beyond mkdocs.yml: pages that lie outside docs/, and links that lead out of it.

``PFSLAM_VIZ_URL`` is where the repository can be looked at (such as https://host/owner/pfslam-viz); links to files of
the repository lead there. Without it they are left out, and their words stay.
"""

import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
PAGES = {
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "benchmarks/README.md": "benchmarks.md",
}
"""Files of the repository that are pages of the site as well."""

OPTIONAL = ("reliability.md",)
"""Pages that the navigation names and that may not be there."""

_ROLE = re.compile(r":(?:func|class|attr|meth|mod|data|exc):<code([^>]*)>(~?)([^<]+)</code>")
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#\s]+)(#[^)\s]*)?\)")


def on_config(config: Any) -> Any:
    """Leave out of the navigation what is not there."""
    absent = {name for name in OPTIONAL if not (Path(config.docs_dir) / name).is_file()}
    for section in config.nav:
        for pages in section.values():
            if isinstance(pages, list):
                pages[:] = [entry for entry in pages if absent.isdisjoint(entry.values())]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that lie elsewhere."""
    for path, page in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / path).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Links to files of the repository become links within the site, to the repository's address, or plain words."""
    outside = {page: path for path, page in PAGES.items()}.get(page.file.src_uri)
    folder = (ROOT / outside).parent if outside else (ROOT / "docs" / page.file.src_uri).parent

    def link(match: re.Match[str]) -> str:
        words, target, anchor = match[1], match[2], match[3] or ""
        if re.match(r"\w+:|/", target):
            return match[0]
        path = (folder / target).resolve()
        if not path.is_relative_to(ROOT):
            return match[0]
        inside = path.relative_to(ROOT).as_posix()
        uri = PAGES.get(inside) or (inside.removeprefix("docs/") if inside.startswith("docs/") else None)
        if uri in OPTIONAL and not path.is_file():
            return words
        if uri is not None:
            start = Path(page.file.src_uri).parent
            return f"[{words}]({os.path.relpath(uri, start)}{anchor})".replace(os.sep, "/")
        base = os.environ.get("PFSLAM_VIZ_URL", "").rstrip("/")
        return f"[{words}]({base}/blob/main/{inside}{anchor})" if base else words

    return _LINK.sub(link, markdown)


def on_page_content(html: str, page: Any, config: Any, files: Files) -> str:
    """Docstrings name other objects as Sphinx has it; a name with ~ is shown without its module."""
    return _ROLE.sub(lambda m: f"<code{m[1]}>{m[3].rpartition('.')[2] if m[2] else m[3]}</code>", html)
