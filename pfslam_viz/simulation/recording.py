"""A simulated recording with known truth, written in the layout of the course's sets."""

import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pfslam_viz.config import configs_dir, find_config, load_robot
from pfslam_viz.errors import InputError
from pfslam_viz.files import full_disk_named, held, missing_folders, stale_parts
from pfslam_viz.recordings.robot_beside import BESIDE
from pfslam_viz.simulation.buildings import build
from pfslam_viz.simulation.camera_errors import CameraErrors
from pfslam_viz.simulation.drive import DriveConfig, drive_along
from pfslam_viz.simulation.manifest import MANIFEST, VERSION, is_simulated
from pfslam_viz.simulation.sensors import (
    ENCODER_PERIOD,
    FIELD_OF_VIEW,
    IMU_PERIOD,
    LIDAR_PERIOD,
    RANGE_MAX,
    RANGE_MIN,
    SensorErrors,
    beam_angles,
    count_ticks,
    jittered_stamps,
    read_imu,
    scan,
)

EPOCH = 1_300_000_000.0  # s, what the recording's clock shows at the start
SET = 1  # the set's number: Encoders1.npz, ...


def simulate(
    out: Path,
    *,
    seed: int = 0,
    duration: float | None = None,
    building: str = "office",
    frames: bool = True,
    wheel_scale: float = 1.0,
    slip: float = 0.01,
    gyro_bias: float | None = None,
    camera: CameraErrors | None = None,
    scan_rate: float | None = None,
) -> Path:
    """Make a recording in the folder ``out``, which appears complete or not at all; the same seed, the same bytes.

    ``ground_truth.npz`` beside the sensors' files holds ``time_stamps`` (n,) s and ``pose`` (n, 3), the rear axle at
    every lidar stamp in the frame of its pose at rest, and ``walls`` (m, 4) in that frame. ``robot.toml`` is the robot
    that the recording tells, with which it is read.

    Args:
        out: the folder to make. It may exist if it is empty or holds a simulated recording, which is replaced.
        seed: draws the building, the drive and the sensors' errors.
        duration: s of the whole recording at most; None drives the building's whole route.
        building: ``office``, ``ring``, ``hallway`` or ``campus``.
        frames: whether to render colour and disparity images.
        wheel_scale, slip, gyro_bias: see :class:`~pfslam_viz.simulation.sensors.SensorErrors`.
        camera: how the camera differs from what ``robot.toml`` says of it.
        scan_rate: Hz of the lidar; None takes the real sets' 40.

    Returns:
        ``out``.

    Raises:
        InputError: for a building that does not exist, a number out of range, or a folder with other files.
    """
    _check_options(seed=seed, wheel_scale=wheel_scale, slip=slip, gyro_bias=gyro_bias or 0.0)
    if scan_rate is not None and not 0.5 <= scan_rate <= 100.0:
        raise InputError(f"scan_rate must be from 0.5 to 100 Hz, not {scan_rate}")
    check_replaceable(out)
    errors = SensorErrors(wheel_scale=wheel_scale, slip=slip, gyro_bias=gyro_bias)
    plan_rng, drive_rng, wheel_rng, imu_rng, lidar_rng, camera_rng = (
        np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(6)
    )
    world = build(building, plan_rng)
    drive = drive_along(world.route, drive_rng, DriveConfig(), duration)
    world, drive = world.seen_from(drive.poses[0]), drive.seen_from(drive.poses[0])
    told, camera = find_config("ece276a", "robot", configs_dir() / "robots"), camera or CameraErrors()
    robot = load_robot(told)
    manifest = {
        "generator": VERSION, "building": building, "seed": seed, "duration": duration, "frames": frames,
        "errors": asdict(errors), "camera": asdict(camera), "scan_rate": scan_rate,
    }  # fmt: skip

    with _folder_in_place(out) as folder:
        # The camera and the IMU start after the wheels and end before them, as in the real sets; the robot stands then.
        early, late = drive.still_before, drive.duration - drive.still_after
        period = LIDAR_PERIOD if scan_rate is None else 1.0 / scan_rate
        stamps = jittered_stamps(0.02, drive.duration - 0.02, period, 0.02, lidar_rng)
        _save(
            folder / f"Hokuyo{SET}.npz", angle_min=-FIELD_OF_VIEW / 2, angle_max=FIELD_OF_VIEW / 2,
            angle_increment=FIELD_OF_VIEW / (len(beam_angles()) - 1), range_min=RANGE_MIN, range_max=RANGE_MAX,
            ranges=scan(world, drive, stamps, robot, lidar_rng, errors).T, time_stamps=EPOCH + stamps,
        )  # fmt: skip
        _save(folder / "ground_truth.npz", time_stamps=EPOCH + stamps, pose=drive.at(stamps), walls=world.walls)
        stamps = jittered_stamps(0.005, drive.duration, ENCODER_PERIOD, 0.02, wheel_rng)
        counts = count_ticks(drive, stamps, robot, wheel_rng, errors)
        _save(folder / f"Encoders{SET}.npz", counts=counts, time_stamps=EPOCH + stamps)
        stamps = jittered_stamps(0.15 * early, late + 0.4 * drive.still_after, IMU_PERIOD, 0.02, imu_rng)
        gyro, acceleration = read_imu(drive, stamps, imu_rng, errors)
        _save(
            folder / f"Imu{SET}.npz", angular_velocity=gyro, linear_acceleration=acceleration,
            time_stamps=EPOCH + stamps,
        )  # fmt: skip
        if frames:
            from pfslam_viz.simulation.kinect import film

            color, disparity = film(folder / "dataRGBD", SET, world, drive, robot, camera_rng, camera)
            _save(
                folder / f"Kinect{SET}.npz",
                disparity_time_stamps=EPOCH + disparity, rgb_time_stamps=EPOCH + color,
            )  # fmt: skip
        shutil.copyfile(told, folder / BESIDE)
        (folder / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return out


def _save(path: Path, **arrays: Any) -> None:
    # NumPy stamps every member of the archive 1980-01-01, so the bytes depend on the arrays alone.
    values: dict[str, Any] = {key: np.asarray(value) for key, value in arrays.items()}
    np.savez_compressed(path, **values)


def _check_options(seed: int, wheel_scale: float, slip: float, gyro_bias: float) -> None:
    for name, value, low, high in (
        ("seed", seed, 0, 2**63),
        ("wheel_scale", wheel_scale, 0.1, 10.0),
        ("slip", slip, 0.0, 0.5),
        ("gyro_bias", gyro_bias, -1.0, 1.0),
    ):
        if not low <= value <= high:
            raise InputError(f"{name} must be from {low} to {high}, not {value}")


def check_replaceable(out: Path) -> None:
    """Raise InputError where :func:`simulate` would not make the folder ``out``: it holds files of anybody else's."""
    if out.is_dir():
        others = [] if is_simulated(out) else sorted(os.listdir(out))  # noqa: PTH208
        others = others or _strangers(out)
        if others:
            raise InputError(
                f"{out}: holds files that are not a simulated recording, such as {others[0]}; give a new or empty"
                " folder"
            )
    elif out.exists():
        raise InputError(f"{out}: is a file; give the folder to make")


def _strangers(folder: Path) -> list[str]:
    """What lies in a simulated recording's folder and is not of it."""
    own = {f"{kind}{SET}.npz" for kind in ("Encoders", "Hokuyo", "Imu", "Kinect")}
    own |= {"ground_truth.npz", BESIDE, MANIFEST}
    frame = re.compile(rf"dataRGBD/(RGB{SET}/rgb{SET}|Disparity{SET}/disparity{SET})_\d+\.png")
    files = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if not path.is_dir())
    return sorted(name for name in files if name not in own and not frame.fullmatch(name))


@contextmanager
def _folder_in_place(out: Path) -> Iterator[Path]:
    """A temporary folder beside ``out`` that takes its place on success and is deleted on any failure."""
    out = out.resolve()
    made = missing_folders(out)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        for part in stale_parts(out):
            shutil.rmtree(part, ignore_errors=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{out.name}.", suffix=".part", dir=out.parent))
    except OSError as error:
        raise InputError(f"{out}: cannot be made: {error.strerror}") from None
    try:
        with held(temporary), full_disk_named(out, temporary):
            yield temporary
            temporary.chmod(0o777 & ~_umask())
            if out.is_dir():
                shutil.rmtree(out)
            temporary.rename(out)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        with suppress(OSError):
            for folder in made:
                folder.rmdir()
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
