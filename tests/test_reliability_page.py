"""docs/reliability.md promises what a test holds."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WITHOUT_TEST = 0  # rows that say that they have none yet


def rows() -> list[list[str]]:
    """The cells of every row of the tables, without their heads."""
    text = (ROOT / "docs" / "reliability.md").read_text(encoding="utf-8")
    lines = [line.strip("|").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line] for line in lines if line[0].strip() not in ("fault", "---")]


def test_there_are_a_hundred_rows_and_each_has_three_cells() -> None:
    assert len(rows()) >= 100
    assert [row for row in rows() if len(row) != 3] == []


def test_every_row_names_a_test_that_is_there() -> None:
    without = 0
    for fault, _, named in rows():
        if named == "none yet":
            without += 1
            continue
        match = re.fullmatch(r"`([\w/]+\.py)::(test_\w+)`", named)
        assert match, f"{fault}: {named}"
        path = ROOT / "tests" / match[1]
        assert path.is_file(), named
        assert f"\ndef {match[2]}(" in path.read_text(encoding="utf-8"), named
    assert without == WITHOUT_TEST


def test_no_fault_is_told_twice() -> None:
    faults = [row[0] for row in rows() if row[0] != "the same"]
    assert len(set(faults)) == len(faults)
