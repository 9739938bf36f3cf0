"""Stamps of another unit, that start again, or are off."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pfslam_viz as pf
from pfslam_viz.recordings.checking.check import check


@pytest.mark.parametrize(("unit", "name"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
@pytest.mark.parametrize("integers", [False, True])
def test_stamps_of_a_set_in_another_unit(course: Any, tmp_path: Path, unit: float, name: str, integers: bool) -> None:
    """n_ms: converted with a note; then as the control."""
    drive = course()
    plain = pf.load_recording(drive.course(tmp_path / "plain"))

    def change(stamps: Any) -> Any:
        return np.rint(stamps * unit).astype(np.int64) if integers else stamps * unit

    changes = {kind: {"time_stamps": change} for kind in ("Encoders", "Imu", "Hokuyo")}
    got = pf.load_recording(drive.course(tmp_path / "set", **changes))
    assert [(f.severity, f.what) for f in got.findings] == [("note", f"stamps_in_{name}")]
    np.testing.assert_allclose(got.stamps, plain.stamps, atol=6e-4)
    np.testing.assert_allclose(got.odometry, plain.odometry, atol=5e-3)
    np.testing.assert_allclose(got.dead_reckoning()[-1], plain.dead_reckoning()[-1], atol=0.02)


@pytest.mark.parametrize(("unit", "name"), [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")])
def test_stamps_of_arrays_in_another_unit(kit: Any, unit: float, name: str) -> None:
    drive = kit.scanner(beams=91)
    stamps = np.rint((kit.EPOCH + drive.stamps) * unit).astype(np.int64)
    arrays = {"ranges": drive.ranges, "angles": drive.angles, "odometry_poses": drive.odometry}
    got = check(pf.Recording.from_arrays(stamps=stamps, **arrays))
    assert [(f.severity, f.what) for f in got.findings] == [("note", f"stamps_in_{name}")]
    np.testing.assert_allclose(got.stamps, kit.EPOCH + drive.stamps, atol=1e-3)
    plain = check(pf.Recording.from_arrays(stamps=kit.EPOCH + drive.stamps, **arrays))
    np.testing.assert_array_equal(got.odometry, plain.odometry)
    np.testing.assert_array_equal(got.ranges, plain.ranges)


def test_a_counter_that_starts_again(kit: Any, tmp_path: Path) -> None:
    """wrap32: order of the lines, with a note; 0.02 m."""
    drive = kit.scanner(beams=91)
    whole = 2**32 / 1000
    path = drive.flaser(tmp_path / "wrap.log", before=whole - 5.0)
    lines = []
    for line in path.read_text().splitlines():
        *rest, stamp, host, again = line.split()
        wrapped = f"{float(stamp) % whole:.6f}"
        assert again == stamp
        lines.append(" ".join([*rest, wrapped, host, wrapped]) + "\n")
    path.write_text("".join(lines))
    got = kit.replayed(path, drive.truth)
    assert got.found == []
    assert "time stamps start again" in got.said
    np.testing.assert_allclose(np.diff(got.result.stamps), 0.25, atol=1e-5)
    assert got.settled < 0.045
    assert got.settled < got.online + 0.01


@pytest.mark.parametrize("at", [0, 100, -1], ids=["first", "middle", "last"])
@pytest.mark.parametrize("hours", [-3.0, 5.0])
def test_one_stamp_off_by_hours(kit: Any, tmp_path: Path, at: int, hours: float) -> None:
    """The scan is left out, or its place in the file is believed; the drive is whole."""
    drive = kit.scanner(beams=91)
    stamps = drive.stamps.copy()
    stamps[at] += 3600 * hours
    recording = pf.load_recording(drive.changed(stamps=stamps).flaser(tmp_path / "off.log"))
    assert len(recording) in (len(stamps), len(stamps) - 1)
    assert recording.duration == pytest.approx(drive.stamps[-1], abs=0.3)
    assert any(f.what == "stray_stamp" and f"{abs(hours):.1f} h" in f.message for f in recording.findings)
    plain = pf.load_recording(drive.flaser(tmp_path / "plain.log"))
    ends = [r.dead_reckoning()[-1] - r.dead_reckoning()[0] for r in (recording, plain)]
    np.testing.assert_allclose(ends[0], ends[1], atol=0.4)
