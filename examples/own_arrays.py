"""Run the filter on your own arrays: here those of a robot that drives round in a simulated room.

python examples/own_arrays.py             prints the error against the true poses
python examples/own_arrays.py room.rrd    writes the replay besides; open it with: rerun room.rrd
"""

import sys

import numpy as np
from numpy.typing import NDArray

import pfslam_viz as pf

Array = NDArray[np.float64]

HALF_ROOM = np.array([5.0, 4.0])  # m from the room's centre to its walls
ANGLES = np.radians(np.linspace(-120.0, 120.0, 241))  # of the lidar's beams, counter-clockwise, 0 ahead


def drive(scans: int = 150) -> pf.Recording:
    """Once round a circle of 2 m in the room: true poses, the ranges seen from them, and odometry that drifts."""
    random = np.random.default_rng(0)
    stamps = 0.1 * np.arange(scans)
    turned = np.linspace(0.0, 2.0 * np.pi, scans)
    truth = np.stack([2.0 * np.sin(turned), -2.0 * np.cos(turned), turned], axis=1)  # x, y (m), heading (rad)
    ranges = distances_to_walls(truth) + random.normal(0.0, 0.01, (scans, len(ANGLES)))
    step = 2.0 * np.pi / (scans - 1)  # rad and, times the radius, m between two scans
    odometry = np.tile([2.0 * np.sin(step), 2.0 * (1.0 - np.cos(step)), step], (scans, 1))
    odometry *= [1.05, 1.05, 1.03]  # wheels that measure 5 % too far and turn 3 % too much
    odometry += random.normal(0.0, 0.002, odometry.shape)
    return pf.Recording.from_arrays(stamps, ranges, ANGLES, odometry, range_max=30.0, truth=truth, name="room")


def distances_to_walls(poses: Array) -> Array:
    """Ranges (n, B) in m from each pose (n, 3) along each beam to the nearest wall."""
    headings = poses[:, 2, None] + ANGLES
    directions = np.stack([np.cos(headings), np.sin(headings)], axis=-1)  # (n, B, 2)
    walls = np.where(directions > 0, HALF_ROOM, -HALF_ROOM)  # that each beam meets, in x and in y
    with np.errstate(divide="ignore"):
        reach = np.abs((walls - poses[:, None, :2]) / directions)
    nearest: Array = reach.min(axis=-1)
    return nearest


def rmse(poses: Array, truth: Array) -> float:
    """Root mean square distance in m between two trajectories (n, 3) that start at the same pose."""
    return float(np.sqrt(((poses - truth)[:, :2] ** 2).sum(axis=1).mean()))


def main(arguments: list[str]) -> None:
    """Run, print, and write the replay where a path is given."""
    recording = drive()
    result = pf.save(recording, "default", arguments[0]) if arguments else pf.run(recording, "default")
    assert result.truth is not None
    print(f"odometry alone   {rmse(result.dead_reckoning, result.truth):.3f} m")
    print(f"particle filter  {rmse(result.estimate, result.truth):.3f} m")


if __name__ == "__main__":
    main(sys.argv[1:])
