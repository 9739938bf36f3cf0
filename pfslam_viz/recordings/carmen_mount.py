"""Where a CARMEN log's laser sits on the robot: ROBOTLASER's two poses, PARAM lines, or FLASER's own laser pose."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.carmen_angles import of_laser
from pfslam_viz.recordings.carmen_layouts import Scans

Array = NDArray[np.float64]

# The laser's pose on the robot is the same in every scan, but for the digits written: m, m, rad.
_SAME = (0.02, 0.02, 0.01)
# No laser sits farther from the robot's centre (m): such a pose is one in another frame.
_FARTHEST = 3.0


def mount(scans: Scans, parameters: Mapping[str, float], rear: bool, notes: list[str]) -> Array:
    """The lidar's pose (3,) on the robot.

    ROBOTLASER gives it. Else the PARAMs ``robot_frontlaser_offset``, ``_side_offset`` and ``_angular_offset``, each
    if there; the others from the scans' own laser poses, if these lie the same to the odometry all the time (in many
    logs they are poses corrected by SLAM instead, which drift away from it); else 0. A laser behind looks back.
    """
    if scans.on_robot:
        mounts = geometry.between(scans.robot, scans.laser)
        mounts = mounts[np.isfinite(mounts).all(axis=1)]
        # Written with six decimals; far from the origin the difference is a little rough.
        return np.round(np.median(mounts, axis=0), 4) + 0.0 if len(mounts) else np.zeros(3)
    mine = of_laser(parameters, rear)
    declared = [mine.get("offset"), mine.get("side_offset"), mine.get("angular_offset")]
    own = _own_mount(scans)
    if rear and own is not None and not own.any():
        own = None  # the robot's pose is written twice
    if declared[2] is not None:
        declared[2] = _yaw(declared[2], own, notes)
    default = np.array([0.0, 0.0, math.pi if rear and own is None else 0.0])
    pose = np.array([value if value is not None else math.nan for value in declared])
    silent = np.isnan(pose)
    pose[silent] = (default if own is None else own)[silent]
    if own is not None and silent.any() and np.any(own[silent] != 0.0):
        x, y, yaw = pose
        what = "by the scans' own laser poses" if silent.all() else "by PARAM lines and the scans' own laser poses"
        notes.append(f"lidar: it sits {x:.3f} m ahead, {y:.3f} m left, turned by {math.degrees(yaw):.1f}°, {what}")
    elif own is None and rear and silent[2]:
        notes.append("lidar: the log has only a laser behind, which is taken to look back (no PARAM says how it sits)")
    return pose


def _own_mount(scans: Scans) -> Array | None:
    """The constant pose (3,) of the scans' laser poses to their odometry, None if it is not constant.

    Nine in ten scans, wherever they are in the log, must agree.
    """
    good = np.isfinite(scans.laser).all(axis=1) & np.isfinite(scans.robot).all(axis=1)
    laser, robot = scans.laser[good], scans.robot[good]
    if len(laser) < 2 or not np.any(laser) or not np.ptp(robot, axis=0).any():
        return None  # nothing written, or nothing to tell a mount from a place in the world by
    poses = geometry.between(robot, laser)
    usual = np.median(poses[:, :2], axis=0)
    c, s = np.median(np.cos(poses[:, 2])), np.median(np.sin(poses[:, 2]))
    yaw = math.atan2(s, c)
    off = np.abs(np.column_stack([poses[:, :2] - usual, geometry.wrap(poses[:, 2] - yaw)]))
    if (off < _SAME).all(axis=1).mean() < 0.9 or np.hypot(*usual) > _FARTHEST:
        return None
    rounded = np.round([*usual, yaw], 3)
    if abs(abs(yaw) - math.pi) < 1.5e-3:
        rounded[2] = math.pi
    return rounded + 0.0


def _yaw(value: float, own: Array | None, notes: list[str]) -> float:
    """PARAM's angular offset in rad: in degrees if more than a turn in radians, or if the scans' own poses say so."""
    degrees = math.radians(value)
    in_degrees = abs(value) > 2 * math.pi + 1e-3
    if own is not None and not in_degrees and abs(value) > 0.05:
        off = [abs(float(geometry.wrap(angle - own[2]))) for angle in (value, degrees)]
        in_degrees = off[1] < 0.02 < off[0] and own[2] != 0.0
    if not in_degrees:
        return value
    notes.append(f"lidar: PARAM angular_offset {value:g} is taken as degrees")
    return degrees
