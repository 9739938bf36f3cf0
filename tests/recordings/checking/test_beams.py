"""Angles and ranges of another unit, without any return, kilometres away."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.recordings.findings import Finding
from pfslam_viz.recordings.recording import Recording

Only = Callable[[Recording, str], Finding]
Write = Callable[..., Path]
ANGLES = np.radians(np.linspace(-135, 135, 181))


def test_a_good_recording_has_no_finding(ring: Any) -> None:
    got = ring.checked()
    assert got.findings == () and got.checked and got.odometry_known is None
    np.testing.assert_array_equal(got.ranges, ring.ranges.astype(np.float32))


def test_angles_in_degrees(ring: Any, only: Only) -> None:
    got = ring.checked(angles=np.degrees(ANGLES))
    assert only(got, "note").what == "angles_in_degrees"
    np.testing.assert_allclose(got.lidar.angles, ANGLES, atol=1e-12)


def test_angles_beyond_a_turn_are_refused(ring: Any, only: Only) -> None:
    assert only(ring.checked(angles=5 * np.degrees(ANGLES)), "wrong").what == "angles_beyond_a_turn"
    full = ring.checked(angles=np.linspace(0, 2 * np.pi, 181), odometry=None, odometry_poses=np.zeros_like(ring.truth))
    assert not [f for f in full.findings if f.what == "angles_beyond_a_turn"]


@pytest.mark.parametrize(("unit", "name"), [(1e3, "millimetres"), (1e2, "centimetres")])
@pytest.mark.parametrize("limit", [30.0, None])
def test_ranges_of_another_unit(ring: Any, only: Only, unit: float, name: str, limit: float | None) -> None:
    got = ring.checked(ranges=ring.ranges * unit, range_max=limit)
    assert only(got, "note").what == f"ranges_in_{name}"
    np.testing.assert_allclose(got.ranges, ring.ranges, atol=1e-4)
    assert got.lidar.range_max == pytest.approx(limit or ring.ranges.max(), rel=1e-4)


def test_a_set_in_millimetres(write_ring: Write, ring: Any) -> None:
    got = load_recording(write_ring(Hokuyo={"ranges": lambda r: r * 1e3}))
    assert [f.what for f in got.findings if f.what != "reader_note"] == ["ranges_in_millimetres"]
    np.testing.assert_allclose(got.ranges, ring.ranges, atol=1e-4)


def test_ranges_whose_unit_nothing_tells_are_refused(ring: Any, only: Only) -> None:
    """At rest there is no motion that would tell mm from cm, and no limit either."""
    rest = np.tile(ring.ranges[:1] * 1e3, (len(ring.stamps), 1))
    got = ring.checked(ranges=rest, range_max=None, odometry=0 * ring.odometry)
    assert only(got, "wrong").what == "ranges_of_unknown_unit"
    np.testing.assert_array_equal(got.ranges, rest.astype(np.float32))


def test_limits_in_millimetres(ring: Any, only: Only) -> None:
    got = ring.checked(range_min=60.0, range_max=30_000.0)
    assert only(got, "note").what == "range_limits_in_millimetres"
    assert (got.lidar.range_min, got.lidar.range_max) == (0.06, 30.0)


@pytest.mark.parametrize("far", [2_000.0, 20_000.0])
@pytest.mark.parametrize("limit", [None, 30_000.0])
def test_one_range_of_kilometres(ring: Any, only: Only, far: float, limit: float | None) -> None:
    ranges = ring.ranges.copy()
    ranges[100, 50] = far
    got = ring.checked(ranges=ranges, range_max=limit)
    finding = only(got, "note")
    assert (finding.what, finding.scan) == ("ranges_far_beyond", 100)
    assert f"{far:,.0f} m" in finding.message
    assert got.ranges[100, 50] == 0 and got.lidar.range_max < 400
    ranges[100, 50] = 0
    np.testing.assert_array_equal(got.ranges, ranges.astype(np.float32))


def test_far_walls_are_kept(ring: Any) -> None:
    """A lidar of long range in the open: one return in a hundred comes from 250 m."""
    ranges = ring.ranges.copy() * 3
    ranges[::4, :7] = np.random.default_rng(3).normal(250.0, 1.0, ranges[::4, :7].shape)
    got = ring.checked(ranges=ranges, range_max=300.0, odometry=ring.odometry * (3, 3, 1))
    assert got.findings == ()
    assert got.ranges.max() > 250


@pytest.mark.parametrize("value", [0.0, 30.5, 81.83])
def test_no_scan_has_a_return(ring: Any, value: float) -> None:
    *notes, finding = ring.checked(ranges=np.full_like(ring.ranges, value)).findings
    assert (finding.severity, finding.what) == ("wrong", "no_returns")
    assert {note.what for note in notes} <= {"no_return_value"}


def test_a_log_without_returns_is_refused(write_log: Write, ring: Any) -> None:
    path = write_log(ring.truth, np.full((len(ring.stamps), 181), 81.83))
    with pytest.raises(InputError, match=r"ring\.log: lidar: no scan has a return .*--force") as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)


def test_a_long_stretch_without_returns(ring: Any, only: Only) -> None:
    ranges = ring.ranges.copy()
    ranges[100:140] = 0.0
    finding = only(ring.checked(ranges=ranges), "doubtful")
    assert (finding.what, finding.scan) == ("scans_without_returns", 100)
    assert "40 scans" in finding.message and "8.0 s" in finding.message
    ranges = ring.ranges.copy()
    ranges[100:110] = 0.0  # two seconds
    ranges[::7] = 0.0
    assert ring.checked(ranges=ranges).findings == ()
