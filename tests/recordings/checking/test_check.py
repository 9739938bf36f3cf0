"""The check as a whole: what it leaves alone, and real recordings, which it must find good."""

from pathlib import Path
from typing import Any

import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.recordings.checking.check import check, refuse_wrong

GOOD = (
    "carmen/fr079.clf.bz2", "carmen/intel.clf.bz2", "twin21", "thinned/belgioioso.clf.bz2", "thinned/edmonton.clf.bz2",
    "thinned/fhw.clf.bz2", "thinned/freiburg-101.clf.bz2", "thinned/orebro.clf.bz2", "thinned/seattle.clf.bz2",
    "cases/base", "cases/n_base", "cases/lds35", "cases/people2", "cases/stilldrift", "cases/interlaced",
    "cases/deskew",
)  # fmt: skip


@pytest.mark.parametrize("name", GOOD)
def test_no_false_alarm(shared_data: Path, name: str) -> None:
    recording = load_recording(shared_data / name)
    assert {finding.what for finding in recording.findings} <= {"reader_note", "no_return_value", "beam_times"}
    assert recording.odometry_known is None


def test_it_is_checked_once(ring: Any) -> None:
    checked = ring.checked()
    assert check(checked) is checked
    assert checked.select(0, 50).checked


def test_notes_are_findings_and_findings_of_that_kind_notes(ring: Any) -> None:
    got = ring.checked(stamps=ring.stamps * 1e3, notes=["one line was odd"])
    assert [(f.severity, f.what) for f in got.findings] == [("note", "stamps_in_milliseconds"), ("note", "reader_note")]
    assert got.notes == ("one line was odd", got.findings[0].message)


def test_refusal_says_what_and_how_to_go_on(ring: Any) -> None:
    wrong = ring.checked(ranges=0 * ring.ranges, name="ring")
    with pytest.raises(InputError, match=r"^ring: lidar: no scan has a return .*; look at .*; --force replays it"):
        refuse_wrong(wrong)
    refuse_wrong(ring.checked())
