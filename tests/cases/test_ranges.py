"""Ranges that stand for no return, are of another unit, or cannot be."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pfslam_viz as pf
from pfslam_viz.recordings.checking.check import check


@pytest.mark.parametrize("farthest", [8.0, 5.0, 12.0])
@pytest.mark.parametrize("line", ["robotlaser", "flaser"])
def test_no_return_written_as_the_greatest_range(kit: Any, tmp_path: Path, line: str, farthest: float) -> None:
    """sentinel8, sentinel8f: as the control, which writes 0.00; and said, also in metrics.json (the findings)."""
    drive = kit.scanner(beams=91)

    def load(none: float) -> pf.Recording:
        seen = drive.limited(farthest, none)
        path = tmp_path / f"{none}.log"
        return pf.load_recording(seen.robotlaser(path, farthest) if line == "robotlaser" else seen.flaser(path))

    control, recording = load(0.0), load(farthest)
    np.testing.assert_array_equal(returns(recording), returns(control))
    assert 0.03 < (returns(recording) == 0).mean() < 0.5
    (finding,) = recording.findings
    assert (finding.severity, finding.what) == ("note", "no_return_value")
    assert f"no return is written as {farthest:.2f} m" in finding.message
    assert recording.notes == (finding.message,)


@pytest.mark.parametrize("line", ["robotlaser", "flaser"])
def test_a_replay_with_no_return_written_as_the_greatest_range(kit: Any, tmp_path: Path, line: str) -> None:
    """sentinel8, sentinel8f: 0.02 m."""
    drive = kit.scanner(beams=91).limited(8.0, 8.0)
    path = tmp_path / "x.log"
    got = kit.replayed(drive.robotlaser(path, 8.0) if line == "robotlaser" else drive.flaser(path), drive.truth)
    assert got.settled < 0.04
    assert got.settled < got.online + 0.01


def test_a_replay_of_readings_that_are_written_twice(kit: Any, tmp_path: Path) -> None:
    """sentinel8f: 0.02 m. 91 readings as 181 beams: with the repeated ones half a degree too far, 0.11 m."""
    drive = kit.scanner(beams=91).limited(8.0, 8.0)
    twice = drive.changed(angles=kit.degrees(-90, 90, 181), ranges=np.repeat(drive.ranges, 2, axis=1)[:, :181])
    got = kit.replayed(twice.flaser(tmp_path / "x.log"), drive.truth)
    assert [what for _, what in got.found] == ["beams_repeated", "no_return_value"]
    assert got.settled < 0.04
    assert got.settled < got.online + 0.01


def returns(recording: pf.Recording) -> Any:
    """Ranges (n, B) m as the filter takes them: 0 where nothing came back."""
    lidar, ranges = recording.lidar, recording.ranges
    return np.where((ranges >= lidar.range_min) & (ranges <= lidar.range_max), ranges, 0.0)


@pytest.mark.parametrize(("unit", "name"), [(1000, "millimetres"), (100, "centimetres")])
def test_ranges_of_another_unit(course: Any, tmp_path: Path, unit: int, name: str) -> None:
    """n_mm: refused with the reason, or converted with a note; then as the control."""
    drive = course()
    plain = pf.load_recording(drive.course(tmp_path / "plain"))
    got = pf.load_recording(
        drive.course(tmp_path / "set", Hokuyo={"ranges": lambda r: np.rint(r * unit).astype(np.uint16)})
    )
    assert [(f.severity, f.what) for f in got.findings] == [("note", f"ranges_in_{name}")]
    np.testing.assert_allclose(got.ranges, plain.ranges, atol=0.51 / unit)
    assert got.lidar.range_max == pytest.approx(5.0, abs=0.01)
    np.testing.assert_array_equal(got.odometry, plain.odometry)


@pytest.mark.parametrize(("unit", "name"), [(1000, "millimetres"), (100, "centimetres")])
def test_ranges_of_another_unit_without_limits(kit: Any, tmp_path: Path, unit: int, name: str) -> None:
    drive = kit.scanner(beams=91)
    got = pf.load_recording(drive.changed(ranges=drive.ranges * unit).flaser(tmp_path / "x.log"))
    assert [(f.severity, f.what) for f in got.findings] == [("note", f"ranges_in_{name}")]
    plain = pf.load_recording(drive.flaser(tmp_path / "plain.log"))
    np.testing.assert_allclose(got.ranges, plain.ranges, atol=0.006)


def test_no_scan_has_a_return(kit: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """allnone: a clear refusal."""
    drive = kit.scanner(beams=91)
    path = drive.changed(stamps=drive.stamps[:50], ranges=0 * drive.ranges + 81.83).flaser(tmp_path / "allnone.log")
    line = kit.refusal(path, capfd)
    assert line.startswith(f"pfslam-viz: {path}: lidar: no scan has a return")
    assert line.endswith("; --force replays it anyway")


@pytest.mark.parametrize("kilometres", [2, 20])
def test_a_stray_range_of_kilometres(kit: Any, kilometres: int) -> None:
    """One beam of one scan; a map that held it would not fit."""
    drive = kit.scanner(beams=91)
    ranges = drive.ranges.copy()
    ranges[150, 45] = 1000.0 * kilometres
    arrays = {"stamps": drive.stamps, "angles": drive.angles, "odometry_poses": drive.odometry}
    recording = check(pf.Recording.from_arrays(ranges=ranges, **arrays))
    (finding,) = recording.findings
    assert (finding.severity, finding.what, finding.scan) == ("note", "ranges_far_beyond", 150)
    assert f"{kilometres},000 m" in finding.message
    ranges[150, 45] = 0.0
    np.testing.assert_allclose(returns(recording), ranges, rtol=1e-6)
    result = pf.run(recording.select(130, 170), texture=False)
    assert max(result.grid.log_odds.shape) * 0.05 < 100
