import json
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.ece276a import load
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.simulation import demo
from pfslam_viz.simulation.manifest import VERSION
from pfslam_viz.simulation.recording import simulate


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate(tmp_path_factory.mktemp("simulated") / "short", seed=4, duration=9.0)


@pytest.fixture(scope="module")
def recording(folder: Path) -> Recording:
    return load(folder)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_layout_is_the_courses(folder: Path) -> None:
    with np.load(folder / "Encoders1.npz", allow_pickle=False) as f:
        assert f["counts"].dtype == np.int16 and f["counts"].shape == (4, len(f["time_stamps"]))
        assert np.diff(f["time_stamps"]).mean() == pytest.approx(0.025, abs=0.001)
    with np.load(folder / "Hokuyo1.npz", allow_pickle=False) as f:
        assert f["ranges"].shape == (1081, len(f["time_stamps"]))
        assert float(f["angle_max"]) == pytest.approx(np.radians(135)) == -float(f["angle_min"])
        assert (float(f["range_min"]), float(f["range_max"])) == (0.1, 30.0)
        assert float(f["angle_increment"]) == pytest.approx(np.radians(0.25))
    with np.load(folder / "Imu1.npz", allow_pickle=False) as f:
        assert f["angular_velocity"].shape == f["linear_acceleration"].shape == (3, len(f["time_stamps"]))
    with np.load(folder / "Kinect1.npz", allow_pickle=False) as f:
        for key, name in (("rgb_time_stamps", "RGB"), ("disparity_time_stamps", "Disparity")):
            images = list((folder / "dataRGBD" / f"{name}1").iterdir())
            assert len(images) == len(f[key])
            assert (folder / "dataRGBD" / f"{name}1" / f"{name.lower()}1_{len(images)}.png").is_file()


def test_reads_back_through_the_loader(recording: Recording) -> None:
    assert recording.duration == pytest.approx(9.0, abs=0.2) and len(recording) == pytest.approx(360, abs=5)
    assert recording.ranges.shape[1] == 1081
    assert recording.truth is not None and recording.frames is not None
    assert recording.truth.poses[0] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert all(path is not None for path in recording.frames.color_paths + recording.frames.disparity_paths)


def test_scans_from_the_true_poses_lie_on_the_walls(folder: Path, recording: Recording) -> None:
    with np.load(folder / "ground_truth.npz", allow_pickle=False) as f:
        walls = f["walls"]
    assert recording.truth is not None
    lidar = recording.lidar
    off = []
    for k in range(0, len(recording), 40):
        r = recording.ranges[k].astype(np.float64)
        kept = (r > lidar.range_min) & (r < lidar.range_max)
        beams = np.stack([r * np.cos(lidar.angles), r * np.sin(lidar.angles)], -1)[kept]
        points = geometry.transform(recording.truth.poses[k], geometry.transform(lidar.pose, beams))
        a, d = walls[:, :2], walls[:, 2:] - walls[:, :2]
        t = np.clip(((points[:, None] - a) * d).sum(-1) / (d * d).sum(-1), 0, 1)
        off.append(np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=-1).min(axis=1))
    distance = np.concatenate(off)
    assert np.median(distance) < 0.012 and np.percentile(distance, 99) < 0.05


def test_odometry_errs_but_not_wildly(recording: Recording) -> None:
    assert recording.truth is not None
    error = recording.dead_reckoning() - recording.truth.at(recording.stamps)
    assert 0.001 < np.hypot(error[-1, 0], error[-1, 1]) < 0.5


def test_the_same_seed_gives_the_same_bytes(folder: Path, tmp_path: Path) -> None:
    again = contents(simulate(tmp_path / "again", seed=4, duration=9.0))
    assert again == contents(folder)
    other = contents(simulate(tmp_path / "other", seed=5, duration=9.0, frames=False))
    assert other["Hokuyo1.npz"] != again["Hokuyo1.npz"] and "Kinect1.npz" not in other


def test_frames_do_not_change_the_other_sensors(folder: Path, tmp_path: Path) -> None:
    plain, whole = contents(simulate(tmp_path / "plain", seed=4, duration=9.0, frames=False)), contents(folder)
    assert all(plain[name] == whole[name] for name in plain if name.endswith(".npz"))


def test_replaces_a_simulated_recording_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "out"
    simulate(out, duration=5.0, frames=False)
    simulate(out, duration=5.0, frames=False, building="ring")
    assert json.loads((out / "simulation.json").read_text())["building"] == "ring"
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.txt").write_text("dear")
    with pytest.raises(InputError, match="mine: holds files"):
        simulate(mine, duration=5.0)
    with pytest.raises(InputError, match="is a file"):
        simulate(mine / "thesis.txt", duration=5.0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "out"]
    assert [p.name for p in mine.iterdir()] == ["thesis.txt"]


def test_the_scan_rate_is_the_lidars_alone(folder: Path, tmp_path: Path) -> None:
    slow = contents(simulate(tmp_path / "slow", seed=4, duration=9.0, frames=False, scan_rate=10.0))
    with np.load(tmp_path / "slow" / "Hokuyo1.npz") as lidar:
        assert len(lidar["time_stamps"]) == pytest.approx(90, abs=2)
    assert slow["Encoders1.npz"] == contents(folder)["Encoders1.npz"]


def test_a_failure_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pfslam_viz.simulation.recording.read_imu", fail)
    with pytest.raises(KeyboardInterrupt):
        simulate(tmp_path / "out", duration=5.0, frames=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"building": "castle"}, "no building"),
        ({"duration": 1.0}, "too short"),
        ({"wheel_scale": 0.0}, "wheel_scale"),
        ({"slip": -0.1}, "slip"),
        ({"seed": -1}, "seed"),
        ({"scan_rate": 0.0}, "scan_rate"),
    ],
)
def test_wrong_options_are_input_errors(options: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        simulate(tmp_path / "out", **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_demo_is_made_once_and_again_for_a_new_generator(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def simulate_shortly(out: Path, *, seed: int, building: str) -> Path:
        made.append((seed, building))
        return simulate(out, seed=seed, building=building, duration=5.0, frames=False)

    monkeypatch.setattr("pfslam_viz.simulation.recording.simulate", simulate_shortly)
    assert demo.ensure_demo(tmp_path) == tmp_path / "demo"
    demo.ensure_demo(tmp_path)
    assert made == [(demo.SEED, demo.BUILDING)] and (tmp_path / "demo" / "Hokuyo1.npz").is_file()
    manifest = tmp_path / "demo" / "simulation.json"
    manifest.write_text(manifest.read_text().replace(f'"generator": {VERSION}', '"generator": 0'))
    demo.ensure_demo(tmp_path)
    assert len(made) == 2


def test_demo_is_as_long_as_promised(tmp_path: Path) -> None:
    folder = simulate(tmp_path / "demo", seed=demo.SEED, building=demo.BUILDING, frames=False)
    recording = load(folder)
    assert 1500 <= len(recording) <= 2500
    assert recording.truth is not None
    gap = recording.truth.poses[-1, :2] - recording.truth.poses[0, :2]
    assert np.hypot(*gap) < 0.6  # it returns to its start
    drift = recording.dead_reckoning()[-1, :2] - recording.truth.poses[-1, :2]
    assert np.hypot(*drift) > 1.0  # and dead reckoning does not know
