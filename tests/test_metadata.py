"""What the package says of itself: version, licence, Python versions."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

import pfslam_viz

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    """The table ``project`` of pyproject.toml."""
    table: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return table


def test_the_version_is_written_once_and_cited_alike(project: dict[str, Any]) -> None:
    assert "version" not in project and "version" in project["dynamic"]
    cited = re.findall(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited == [pfslam_viz.__version__]


def test_the_licence_is_there_and_named_alike(project: dict[str, Any]) -> None:
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in project["license-files"]]
    assert project["license"] == "MIT" and texts[0].startswith("MIT License")
    assert "the pfslam-viz authors" in texts[0]
    assert re.search(r"^license: MIT$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)


def test_no_address_is_published(project: dict[str, Any]) -> None:
    assert "urls" not in project


def test_the_python_versions_named_start_with_the_one_required(project: dict[str, Any]) -> None:
    named = [text.rpartition(" ")[2] for text in project["classifiers"] if re.search(r":: 3\.\d+$", text)]
    assert named == ["3.11", "3.12", "3.13"]
    assert project["requires-python"] == f">={named[0]}"
