"""Inputs with nothing wrong: base, n_base, lds35, people2, stilldrift, interlaced. And how a file is written."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pfslam_viz as pf


@pytest.mark.parametrize("seed", [0, 1])
def test_a_plain_log(kit: Any, tmp_path: Path, seed: int) -> None:
    """base: 0.008 m."""
    drive = kit.scanner(beams=181, seed=seed)
    got = kit.replayed(drive.flaser(tmp_path / "base.log"), drive.truth)
    assert got.found == [] and got.said == ""
    assert 1.0 < got.reckoned < 3.0
    assert got.settled < 0.016
    assert got.settled < got.online + 0.01


@pytest.mark.parametrize("seed", [0, 1])
def test_a_plain_set(course: Any, kit: Any, tmp_path: Path, seed: int) -> None:
    """n_base: 0.016 m."""
    drive = course(seed=seed)
    got = kit.replayed(drive.course(tmp_path / "set"), drive.truth)
    assert got.found == [] and got.said == ""
    assert 0.05 < got.reckoned < 0.4
    assert got.settled < 0.032
    assert got.settled < got.online + 0.01


def test_a_short_range_lidar_that_writes_nought(kit: Any, tmp_path: Path) -> None:
    """lds35: 0.028 m. 360 degrees from straight ahead on, 3.5 m, 0.00 where nothing came back."""
    drive = kit.drive(kit.degrees(0, 358, 180), noise=0.02).limited(3.5)
    got = kit.replayed(drive.robotlaser(tmp_path / "lds35.log", 3.5), drive.truth)
    assert got.found == []
    assert got.settled < 0.056
    assert got.settled < got.online + 0.01


@pytest.mark.slow
def test_people_who_pace_by(kit: Any, tmp_path: Path) -> None:
    """people2: 0.061 m. Three people walk up and down past a robot that stands still for three minutes."""
    way = kit.way_round(rest=180.0)

    def people(stamps: Any) -> Any:
        walked = [8.5 + 4.0 * np.sin(1.0 * stamps / 4.0 + phase) for phase in (0.0, 2.0, 4.0)]
        return np.stack(
            [np.stack([x, np.full_like(x, y)], axis=-1) for x, y in zip(walked, (0.9, -0.9, 1.1), strict=True)], axis=1
        )

    drive = kit.drive(kit.degrees(-90, 90, 91), way=way, people=people)
    got = kit.replayed(drive.flaser(tmp_path / "people.log"), drive.truth)
    assert [severity for severity, _ in got.found if severity != "note"] == []
    assert got.settled < 0.122
    assert got.settled < got.online + 0.01


@pytest.mark.slow
def test_standing_while_the_heading_creeps(kit: Any, tmp_path: Path) -> None:
    """stilldrift: 0.014 m. Five minutes at rest, while the gyro turns by 0.002 rad/s."""
    drive = kit.drive(kit.degrees(-90, 90, 91), way=kit.way_round(rest=300.0))
    rests = np.concatenate([[False], (np.diff(drive.truth, axis=0) == 0).all(axis=1)])
    assert rests.sum() > 1100
    creep = np.cumsum(np.where(rests, 0.002 / 4, 0.0))
    at = np.argmax(rests)
    pivot = drive.odometry[at]
    odometry = drive.odometry.copy()
    c, s = np.cos(creep), np.sin(creep)
    x, y = (drive.odometry - pivot)[:, :2].T
    odometry[:, 0], odometry[:, 1] = pivot[0] + c * x - s * y, pivot[1] + s * x + c * y
    odometry[:, 2] += creep
    got = kit.replayed(drive.changed(odometry=odometry).flaser(tmp_path / "still.log"), drive.truth)
    assert got.found == []
    assert got.reckoned > 2.0
    assert got.settled < 0.028
    assert got.settled < got.online + 0.01


def test_interlaced_scans(kit: Any, tmp_path: Path) -> None:
    """interlaced: 0.007 m. Every other scan begins half a degree later."""
    drive = kit.drive(kit.degrees(-90, 89.5, 360))
    scans = [(row[k % 2 :: 2], np.radians(-90 + 0.5 * (k % 2)), np.radians(1.0)) for k, row in enumerate(drive.ranges)]
    got = kit.replayed(drive.robotlaser(tmp_path / "interlaced.log", 50.0, scans), drive.truth)
    assert "interlaced" in got.said
    assert got.settled < 0.014
    assert got.settled < got.online + 0.01


def test_a_byte_order_mark(kit: Any, tmp_path: Path) -> None:
    """bom: read, the first scan too."""
    drive = kit.scanner()
    plain = pf.load_recording(drive.flaser(tmp_path / "plain.log"))
    marked = pf.load_recording(drive.flaser(tmp_path / "marked.log", head="\ufeff"))
    assert len(marked) == len(drive.stamps)
    np.testing.assert_array_equal(marked.ranges, plain.ranges)
    np.testing.assert_array_equal(marked.odometry, plain.odometry)


def test_decimal_commas(kit: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """comma: the message says what was seen."""
    path = kit.scanner().flaser(tmp_path / "comma.log")
    path.write_text(path.read_text().replace(".", ","))
    line = kit.refusal(path, capfd)
    assert line.startswith(f"pfslam-viz: {path}: numbers are written with decimal commas (")
    assert "write them with points" in line
