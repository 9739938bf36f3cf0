"""The README and the documents: links lead somewhere, here and on a package index, and the tutorial comes true."""

import importlib.util
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
LINK = re.compile(r"\[[^\]]*\]\((?!\w+:)([^)#\s]*)(#[^)\s]*)?\)")
NOT_YET = {"reliability.md"}  # pages that may be missing

Run = Callable[..., tuple[int, str, str]]


def anchor_of(heading: str) -> str:
    """The anchor of a heading, as Markdown's readers make it: ``what-is-checked``."""
    words = re.sub(r"[^\w\s-]", "", re.sub(r"[`*]", "", heading).lower()).strip()
    return "#" + re.sub(r"\s+", "-", words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target, anchor in LINK.findall(text):
        path = (page.parent / target).resolve() if target else page
        assert path.exists() or path.name in NOT_YET, target
        if anchor and path.is_file():
            headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {anchor_of(heading) for heading in headings}, target + anchor


def test_the_readme_is_one_screen() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 50


def test_the_tutorial_on_a_log_comes_true(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "tutorials" / "own-log.md").read_text(encoding="utf-8")
    block = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert block is not None
    exec(block[1], {"__name__": "tutorial"})
    status, out, err = run("info", "corridor.clf")
    assert (status, out.splitlines()[0]) == (0, "corridor: good"), err
    status, out, err = run("replay", "corridor.clf", "--save", "corridor.rrd", "--export", "out")
    assert status == 0, err
    assert re.search(r"path length\W+9\.90 m\W+10\.39 m", out)  # 99 steps of 0.1 and of 0.105 m
    assert (tmp_path / "corridor.rrd").is_file() and (tmp_path / "out" / "estimate.tum").is_file()


@pytest.fixture(scope="module")
def hook() -> Any:
    """tools/readme_hook.py, which the build runs."""
    pytest.importorskip("hatchling")
    spec = importlib.util.spec_from_file_location("readme_hook", ROOT / "tools" / "readme_hook.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_links_for_a_package_index_are_absolute_or_none(hook: Any) -> None:
    text = "![A map](docs/a.png)\n\nSee [formats](docs/formats.md#x), [Rerun](https://rerun.io) and [below](#y).\n"
    base = "https://example.org/me/pfslam-viz"
    assert hook.absolute(text, base) == (
        f"![A map]({base}/raw/main/docs/a.png)\n\n"
        f"See [formats]({base}/blob/main/docs/formats.md#x), [Rerun](https://rerun.io) and [below](#y).\n"
    )
    assert hook.absolute(text, "") == "\n\nSee formats, [Rerun](https://rerun.io) and [below](#y).\n"
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert not LINK.search(hook.absolute(readme, base))
    assert not LINK.search(hook.absolute(readme, ""))
