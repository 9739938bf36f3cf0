import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.info import describe_path

SPEED = 10 * np.pi * 0.254 / 360 * 40
WriteSet = Callable[..., Path]


def test_a_set(write_set: WriteSet) -> None:
    folder = write_set()
    np.savez(folder / "ground_truth.npz", time_stamps=[1000.0, 1001.0], pose=[[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]])
    out = json.loads(json.dumps(describe_path(str(folder / "Hokuyo7.npz"))))
    assert (out["name"], out["format"], out["duration_s"]) == ("7", "ece276a", 1.0)
    lidar = out["lidar"]
    assert (lidar["scans"], lidar["beams"], lidar["range_limits_m"]) == (11, 3, [0.1, 30.0])
    assert lidar["no_return_share"] == pytest.approx(1 / 3, abs=1e-4)  # one beam of three reads 40 m
    assert lidar["field_of_view_deg"] == pytest.approx(57.296)
    assert out["streams"]["encoders"] == {
        "samples": 81, "rate_hz": 40.0, "start_s": -0.5, "end_s": 1.5, "longest_gap_s": 0.025,
        "longest_gap_at_s": out["streams"]["encoders"]["longest_gap_at_s"],
    }  # fmt: skip
    assert out["streams"]["lidar"]["rate_hz"] == 10.0
    assert out["odometry"]["path_m"] == pytest.approx(SPEED, abs=2e-3)
    assert out["odometry"]["end_to_start_turn_deg"] == pytest.approx(np.degrees(0.5), abs=0.01)
    assert out["truth"]["path_m"] == 5.0
    assert out["notes"] == []


def test_the_longest_gap_is_found(write_set: WriteSet) -> None:
    stamps = 1000.5 + np.array([0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.9, 0.95, 0.97, 1.0])
    out = describe_path(write_set(Hokuyo={"time_stamps": stamps}))
    lidar = out["streams"]["lidar"]  # type: ignore[index]
    assert (lidar["longest_gap_s"], lidar["longest_gap_at_s"]) == (0.3, 0.6)


def test_a_log_with_relations(tmp_path: Path) -> None:
    scan = "FLASER 5 1 2 3 4 99 0 0 0 {0} 0 0 {0} host 0"
    (tmp_path / "x.log").write_text("\n".join(scan.format(k) for k in (2.0, 0.0, 1.0)))
    (tmp_path / "x.relations").write_text("0 1 0 0 0 0 0 0\n0 2.5 0 0 0 0 0 0\n")
    out = describe_path("x", tmp_path)
    assert out["relations"] == {"count": 2, "between_scans": 1}
    assert out["odometry"]["path_m"] == 2.0  # type: ignore[index]
    assert out["lidar"]["no_return_share"] == 0.2  # type: ignore[index]
    assert any("backwards" in note for note in out["notes"])  # type: ignore[attr-defined]


def test_a_set_without_scans(shared_data: Path) -> None:
    out = json.loads(json.dumps(describe_path("21", shared_data / "ece276a")))
    assert out["odometry"]["wheel_path_m"] == pytest.approx(92.47, abs=0.01)
    assert out["odometry"]["end_to_start_gap_m"] == pytest.approx(3.15, abs=0.05)
    assert out["streams"]["IMU"]["rate_hz"] == pytest.approx(100, abs=0.5)
    assert "Hokuyo21.npz is not here" in out["notes"][0]
    assert any("1.56 s before" in note for note in out["notes"])


def test_what_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fetch 21"):
        describe_path("21", tmp_path)
    (tmp_path / "Encoders21.npz").write_bytes(b"")
    with pytest.raises(InputError, match=r"lacks Hokuyo21\.npz, Imu21\.npz"):
        describe_path("21", tmp_path)
