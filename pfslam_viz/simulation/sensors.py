"""What the robot's encoders, gyro and lidar report on a drive, with the errors that the real ones have."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.compiling.kernel import kernel
from pfslam_viz.robot import Robot
from pfslam_viz.simulation.drive import Drive
from pfslam_viz.simulation.world import Array, World

BEAMS = 1081
FIELD_OF_VIEW = 1.5 * np.pi  # rad
RANGE_MIN, RANGE_MAX = 0.1, 30.0  # m
LIDAR_PERIOD, ENCODER_PERIOD, IMU_PERIOD = 0.02495, 0.02494, 0.01  # s, as measured on the real sets
EFFECTIVE_TRACK = 0.75  # m: wider than the wheels stand, because skid steering drags them sideways


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """How wrong the sensors are.

    Attributes:
        wheel_scale: the true rolling circumference as a multiple of the robot file's. At 1.03 the odometry says 1 m
            where the robot went 1.03 m.
        slip: relative standard deviation of the wheels' rolling, slowly changing, plus as much again in turns.
        gyro_bias: rad/s; None draws one of 0.0007 to 0.0018 rad/s, either sign, as measured on the real sets at rest.
        gyro_drift: rad/s, standard deviation of the bias about that, changing over half a minute.
        gyro_noise: rad/s, standard deviation of a reading.
        gyro_scale: standard deviation of the constant relative error of the yaw rate.
        range_noise: m, standard deviation of a range at 0 m, growing by ``range_growth`` a metre.
        dropouts: share of beams without a return, besides those that graze a wall.
    """

    wheel_scale: float = 1.0
    slip: float = 0.01
    gyro_bias: float | None = None
    gyro_noise: float = 0.004
    gyro_drift: float = 0.002
    gyro_scale: float = 0.02
    range_noise: float = 0.01
    range_growth: float = 0.0005
    dropouts: float = 0.003


def beam_angles() -> Array:
    """(1081,) rad, counter-clockwise, the lidar's x axis in the middle."""
    return np.linspace(-FIELD_OF_VIEW / 2, FIELD_OF_VIEW / 2, BEAMS)


def jittered_stamps(start: float, stop: float, period: float, jitter: float, rng: np.random.Generator) -> Array:
    """Increasing times in s from ``start`` to ``stop`` about ``period`` apart, each off by up to ``jitter`` periods."""
    ticks = np.arange(start, stop, period)
    return ticks + period * rng.uniform(-jitter, jitter, len(ticks)).clip(-0.45, 0.45)


def scan(
    world: World, drive: Drive, times: Array, robot: Robot, rng: np.random.Generator, errors: SensorErrors
) -> NDArray[np.float32]:
    """Ranges (n, 1081) m, in whole mm, of the scans taken at ``times`` (n,); 0 where nothing came back."""
    mount = (robot.lidar.position[0], robot.lidar.position[1], robot.lidar.yaw)
    height = robot.lidar.position[2] + robot.axle_height
    walls = np.ascontiguousarray(world.walls[world.heights > height])
    poses = geometry.compose(drive.at(times), mount)
    ranges, grazing = true_ranges(walls, poses, beam_angles())
    noise = rng.standard_normal(ranges.shape, dtype=np.float32)
    measured = np.round(ranges + noise * (errors.range_noise + errors.range_growth * np.minimum(ranges, 99.0)), 3)
    # A beam that meets a wall at less than five degrees mostly glances off.
    lost = rng.random(ranges.shape, dtype=np.float32) < errors.dropouts + 0.7 * np.clip(1.0 - grazing / 0.09, 0.0, 1.0)
    lost |= (measured > RANGE_MAX) | (measured < RANGE_MIN)
    measured[lost] = 0.0
    return measured.astype(np.float32)


def true_ranges(walls: Array, poses: Array, angles: Array) -> tuple[Array, Array]:
    """Exact ranges (n, B) m from ``poses`` (n, 3) to ``walls`` (m, 4), inf where there is none.

    ``angles`` (B,) must be evenly spaced and increase. The second array (n, B) is |sin| of the angle between beam and
    wall: 1 for a square hit, towards 0 for a grazing one.
    """
    ranges: tuple[Array, Array] = _true_ranges(walls, poses, angles[0], angles[1] - angles[0], len(angles))
    return ranges


@kernel("f8[:, ::1], f8[:, ::1], f8, f8, i8")
def _true_ranges(  # type: ignore[no-untyped-def]
    walls: Array, poses: Array, first: float, increment: float, beams: int
):
    ranges = np.full((len(poses), beams), np.inf)
    grazing = np.ones((len(poses), beams))
    turn = 2.0 * np.pi
    for k in range(len(poses)):
        x, y, heading = poses[k, 0], poses[k, 1], poses[k, 2]
        for m in range(len(walls)):
            ax, ay, bx, by = walls[m, 0] - x, walls[m, 1] - y, walls[m, 2] - x, walls[m, 3] - y
            # Only the beams between the directions of the wall's two ends can meet it.
            start = np.arctan2(ay, ax)
            span = (np.arctan2(by, bx) - start + np.pi) % turn - np.pi
            if span < 0.0:
                start, span = start + span, -span
            start = (start - heading - first) % turn
            cross = ax * by - ay * bx
            dx, dy = bx - ax, by - ay
            length = np.hypot(dx, dy)
            for _ in range(2):
                low = max(int(np.ceil(start / increment)), 0)
                high = min(int(np.floor((start + span) / increment)), beams - 1)
                for i in range(low, high + 1):
                    a = heading + first + i * increment
                    denominator = np.cos(a) * dy - np.sin(a) * dx
                    if denominator != 0.0:
                        r = cross / denominator
                        if 0.0 < r < ranges[k, i]:
                            ranges[k, i] = r
                            grazing[k, i] = abs(denominator) / length
                start -= turn  # the part of the span that wraps round to the first beams
    return ranges, grazing


def count_ticks(
    drive: Drive, times: Array, robot: Robot, rng: np.random.Generator, errors: SensorErrors
) -> NDArray[np.int16]:
    """Encoder counts (4, n) since the reading before, FR FL RR RL: the left and right wheels of a skid-steer robot."""
    slip = errors.slip * _drifting(drive, 2.0, rng)
    turning = errors.slip * _drifting(drive, 0.5, rng) * np.minimum(np.abs(drive.yaw_rate), 1.0)
    dt = drive.times[1] - drive.times[0]
    wheels = []
    for side in (1.0, -1.0, 1.0, -1.0):  # the right wheels go faster in a left turn
        own = 0.2 * errors.slip * _drifting(drive, 1.0, rng)
        rolled = (drive.speed + side * drive.yaw_rate * EFFECTIVE_TRACK / 2) * (1.0 + slip + turning + own)
        turned = np.cumsum(rolled) * dt / (robot.meters_per_tick * errors.wheel_scale) + rng.uniform()
        wheels.append(np.floor(np.interp(times, drive.times, turned)))
    total = np.array(wheels)
    return np.diff(total, axis=1, prepend=total[:, :1]).astype(np.int16)


def read_imu(
    drive: Drive, times: Array, rng: np.random.Generator, errors: SensorErrors
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular velocity (3, n) rad/s and linear acceleration (3, n) g in the robot's frame at ``times`` (n,)."""
    n = len(times)
    bias = errors.gyro_bias
    if bias is None:
        bias = float(rng.uniform(0.0007, 0.0018) * rng.choice([-1.0, 1.0]))
    scale = 1.0 + errors.gyro_scale * rng.standard_normal()
    yaw_rate = np.interp(times, drive.times, drive.yaw_rate)
    gyro = rng.normal(0.0, errors.gyro_noise, (3, n))
    drift = errors.gyro_drift * np.interp(times, drive.times, _drifting(drive, 30.0, rng))
    gyro[2] += scale * yaw_rate + bias + drift
    speed = np.interp(times, drive.times, drive.speed)
    shaking = 0.01 + 0.02 * np.minimum(speed, 1.0)
    acceleration = rng.standard_normal((3, n)) * shaking
    acceleration[0] += np.gradient(speed, times) / 9.81
    acceleration[1] += speed * yaw_rate / 9.81
    acceleration[2] += 1.0
    return gyro, acceleration


def _drifting(drive: Drive, seconds: float, rng: np.random.Generator) -> Array:
    """(n,) noise of about unit variance along a drive, linear between independent values ``seconds`` apart."""
    knots = np.arange(0.0, drive.duration + seconds, seconds)
    # Between two knots the variance falls to a half; over all times it is two thirds.
    noise: Array = np.interp(drive.times, knots, rng.standard_normal(len(knots)) * np.sqrt(1.5))
    return noise
