"""Stamps of another unit, stray stamps, clocks that do not meet."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.recordings.checking.clocks import stray_stamps
from pfslam_viz.recordings.checking.units import gyro_unit, unit_like
from pfslam_viz.recordings.findings import Finding
from pfslam_viz.recordings.recording import Recording, Relations, Stream

Only = Callable[[Recording, str], Finding]
Write = Callable[..., Path]
UNITS = [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds")]


@pytest.mark.parametrize(("unit", "name"), UNITS)
def test_stamps_of_another_unit(ring: Any, only: Only, unit: float, name: str) -> None:
    relations = Relations(ring.stamps[[0]] * unit, ring.stamps[[9]] * unit, np.zeros((1, 3)))
    streams = [Stream("lidar", ring.stamps * unit)]
    got = ring.checked(stamps=ring.stamps * unit, truth=ring.truth, relations=relations, streams=streams)
    assert only(got, "note").what == f"stamps_in_{name}"
    for stamps in (got.stamps, got.truth.stamps, got.streams[0].stamps):
        np.testing.assert_allclose(stamps, ring.stamps, atol=1e-5)
    assert got.relations.end[0] - got.relations.start[0] == pytest.approx(1.8)
    np.testing.assert_array_equal(got.odometry[1:], ring.odometry[1:])
    assert any(name in note for note in got.notes)


def test_a_scan_every_few_seconds_is_no_wrong_unit(ring: Any) -> None:
    """Thinned logs have a scan a metre; and a robot may stand and scan every ten minutes."""
    got = ring.recording().select(stride=9)
    for slower in (1.0, 5.0):
        assert ring.checked(stamps=got.stamps * slower, ranges=got.ranges, odometry=got.odometry).findings == ()
    still = ring.checked(stamps=ring.stamps * 15, odometry=ring.odometry * 1e-4)
    assert [f.severity for f in still.findings if f.what == "stamps_of_unknown_unit"] == ["doubtful"]
    np.testing.assert_array_equal(still.stamps, ring.stamps * 15)


def test_stamps_of_no_unit_are_refused(ring: Any, only: Only) -> None:
    got = ring.checked(stamps=ring.stamps * 1e3, odometry=ring.odometry * 1e-3)  # 0.6 mm in 0.2 s: in no unit a robot
    assert only(got, "wrong").what == "stamps_of_unknown_unit"


@pytest.mark.parametrize(("unit", "name"), UNITS)
def test_a_set_in_another_unit(write_ring: Write, ring: Any, unit: float, name: str) -> None:
    """The gyro is integrated over seconds, whatever its stamps are in: the set is as the one in seconds."""
    plain = load_recording(write_ring())
    scaled = {kind: {"time_stamps": lambda t: t * unit} for kind in ("Encoders", "Imu", "Hokuyo")}
    got = load_recording(write_ring(**scaled))
    assert [f.what for f in got.findings if f.what != "reader_note"] == [f"stamps_in_{name}"]
    assert "lidar, encoders, IMU" in got.findings[0].message
    np.testing.assert_allclose(got.stamps, plain.stamps, atol=1e-5)
    np.testing.assert_allclose(got.odometry, plain.odometry, atol=1e-4)
    assert plain.findings == () or all(f.what == "reader_note" for f in plain.findings)
    truth = geometry.between(ring.truth[0], ring.truth)
    assert np.hypot(*(got.dead_reckoning() - truth)[-1, :2]) < 0.1


def test_one_sensor_in_milliseconds(write_ring: Write) -> None:
    plain = load_recording(write_ring())
    got = load_recording(write_ring(Imu={"time_stamps": lambda t: t * 1e3}))
    assert [f.message for f in got.findings if f.what == "stamps_in_milliseconds"] == [
        "IMU: stamps in milliseconds; converted to seconds"
    ]
    np.testing.assert_allclose(got.odometry, plain.odometry, atol=1e-4)


@pytest.mark.parametrize("kind", ["Encoders", "Imu", "Hokuyo"])
def test_a_sensor_whose_clock_is_an_hour_off_is_refused(write_ring: Write, kind: str) -> None:
    folder = write_ring(**{kind: {"time_stamps": lambda t: t + 3600.0}})
    with pytest.raises(InputError, match=r"do not overlap in time: .* h apart; .*; --force replays it anyway"):
        load_recording(folder)
    got = load_recording(folder, force=True)
    assert next(f.what for f in got.findings if f.severity == "wrong") == "clocks_do_not_overlap"


def test_a_stream_that_covers_less_than_half(ring: Any, only: Only) -> None:
    k = len(ring.stamps) // 3
    dead = ring.odometry.copy()
    dead[k + 2 :, 2] = 0.0
    got = ring.checked(odometry=dead, streams=[Stream("IMU", ring.stamps[:k])])
    assert only(got, "doubtful").what == "clocks_hardly_overlap"
    other_source = ring.checked(streams=[Stream("odometry", ring.stamps + 3600)])
    assert other_source.findings == ()  # the odometry of the scans moves: it comes from elsewhere


@pytest.mark.parametrize("at", [0, 50, -1])
@pytest.mark.parametrize("hours", [-3.0, 3.0])
def test_one_stamp_that_is_off_by_hours(ring: Any, only: Only, at: int, hours: float) -> None:
    stamps = ring.stamps.copy()
    stamps[at] += 3600 * hours
    got = ring.checked(stamps=stamps)
    finding = only(got, "doubtful")
    assert finding.what == "stray_stamp"
    assert "1 scan has a stamp 3.0 h off" in finding.message
    assert finding.scan == (0 if hours < 0 else len(ring.stamps) - 1)
    np.testing.assert_allclose(got.stamps, np.delete(ring.stamps, at), atol=1e-9)
    end = (
        got.dead_reckoning()[-1] - ring.recording().select(int(at == 0), -1 if at == -1 else None).dead_reckoning()[-1]
    )
    np.testing.assert_allclose(end, 0, atol=1e-9)


def test_a_pause_of_hours_is_none(ring: Any) -> None:
    stamps = ring.stamps.copy()
    stamps[200:] += 7200.0
    assert ring.checked(stamps=stamps).findings == ()
    assert stray_stamps(np.array([0.0, 1e9, *(1e9 + np.arange(1.0, 20.0))])) == (1, 0)
    assert stray_stamps(np.array([*np.arange(20.0), 5000.0, 9000.0])) == (0, 2)


def test_units_by_hand() -> None:
    stamps = np.arange(0.0, 60.0, 0.01)
    assert [gyro_unit(stamps * unit) for unit in (1.0, 1e3, 1e6, 1e9)] == [1.0, 1e-3, 1e-6, 1e-9]
    assert gyro_unit(np.arange(0.0, 60.0, 0.4)) == 1.0  # slow, but seconds
    lidar = 100.0 + np.arange(0.0, 60.0, 5.0)  # a scan every five seconds
    assert unit_like(lidar, 95.0, 170.0) == 1.0
    assert unit_like(lidar * 1e6, 95.0, 170.0) == 1e-6
    assert unit_like(lidar * 1e6, 9500.0, 17000.0) == 1.0  # of another time altogether
