"""The simulated camera's faults: as large as they were asked for, and none by default."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from pfslam_viz.config import load_robot
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.ece276a import load
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.simulation.camera_errors import CameraErrors
from pfslam_viz.simulation.recording import simulate

TOLD = CameraGeometry(position=(0.3, 0.1, 0.5), pitch=0.3, roll=0.01, yaw=0.02)


def test_the_mounting() -> None:
    camera = CameraErrors(pitch=20.7, height=0.45).mounted(TOLD)
    assert math.degrees(camera.pitch) == pytest.approx(20.7)
    assert camera.position == (0.3, 0.1, 0.45) and (camera.roll, camera.yaw) == (0.01, 0.02)
    assert CameraErrors().mounted(TOLD) == TOLD


def test_noise_is_as_large_and_as_smooth_as_measured() -> None:
    """About a level wall, 1 m away: 1.25 steps, neighbours correlated by 0.8 to 0.97 and by 0.3 to 0.75 16 apart."""
    flat = np.full((480, 640), 750.0)
    error = np.stack([CameraErrors(noise=1.25).disturb(flat, np.random.default_rng(k)) - flat for k in range(6)])
    assert error.std() == pytest.approx(1.25, abs=0.12) and abs(error.mean()) < 0.4
    near, far = (np.corrcoef(error[..., lag:].ravel(), error[..., :-lag].ravel())[0, 1] for lag in (1, 16))
    assert 0.8 < near < 0.99 and 0.3 < far < 0.75


def test_holes_blind_columns_and_shadows() -> None:
    scene = np.full((480, 640), 900.0)  # 1.03 / 0.574 = 1.794 m
    scene[100:200, 300:400] = 700.0  # 1.03 / 1.182 = 0.871 m
    out = CameraErrors(holes=0.02).disturb(scene, np.random.default_rng(1))
    none = out == 2047
    assert none[:, -8:].all()
    # Its shadow: 0.075 m * 585 * (1 / 0.871 - 1 / 1.794) = 25.9 pixels to the left, and none to the right.
    assert none[100:200, 276:300].mean() == 1.0 and none[100:200, 230:273].mean() < 0.3
    assert none[100:200, 400:425].mean() < 0.3
    assert none[220:, :-8].mean() == pytest.approx(0.02, abs=0.01)
    assert (out[~none] == scene[~none]).all()


def test_exposure_and_shutter() -> None:
    gains = np.array([CameraErrors(exposure=0.2).gain(t) for t in np.arange(0.0, 200.0, 0.5)])
    assert 0.8 <= gains.min() < 0.84 and 1.16 < gains.max() <= 1.2
    assert CameraErrors().gain(3.0) == 1.0 and CameraErrors().shutter(3.0).tolist() == [3.0]
    times = CameraErrors(blur=0.04).shutter(3.0)
    assert times.mean() == pytest.approx(3.0) and np.ptp(times) == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("name", "value"), [("pitch", 95.0), ("height", 0.0), ("noise", -1.0), ("holes", 1.0), ("blur", math.nan)]
)
def test_impossible_cameras_are_refused(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"camera's {name} must be"):
        CameraErrors(**{name: value})


def test_a_drive_with_another_camera_than_is_told(tmp_path: Path) -> None:
    """Pictures and scans apart, the recording is the same; it is read with the camera that it tells."""
    plain = simulate(tmp_path / "plain", seed=4, duration=6.0)
    errors = CameraErrors(pitch=24.0, noise=1.25, holes=0.01, exposure=0.3, blur=0.03)
    other = simulate(tmp_path / "other", seed=4, duration=6.0, camera=errors)
    for name in ("Hokuyo1.npz", "Encoders1.npz", "Imu1.npz", "Kinect1.npz", "ground_truth.npz", "robot.toml"):
        assert (plain / name).read_bytes() == (other / name).read_bytes()
    assert json.loads((other / "simulation.json").read_text())["camera"]["pitch"] == 24.0
    frames = load(other).frames
    assert frames is not None and frames.camera == load_robot("ece276a").ground_camera()
    first, second = (
        cv2.imread(str(folder / "dataRGBD/Disparity1/disparity1_5.png"), cv2.IMREAD_UNCHANGED)
        for folder in (plain, other)
    )
    assert first is not None and second is not None
    # In the last row's middle the depth is 0.50701 m / (sin p + cos p * 236.06 / 585.05): 0.6946 m at 0.36 rad and
    # 0.6539 m at 24 degrees, d = 601.1 and 570.7.
    assert first[479, 316] == pytest.approx(601.1, abs=1.0)
    assert second[479, 300:330][second[479, 300:330] < 2047].mean() == pytest.approx(570.7, abs=4.0)
    assert simulate(tmp_path / "again", seed=4, duration=6.0, camera=errors).is_dir()
    again = cv2.imread(str(tmp_path / "again/dataRGBD/Disparity1/disparity1_5.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(again, second)
