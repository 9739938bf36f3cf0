"""Which robot drove a set, where the user does not say: ``robot.toml`` beside its files, or the course's robot."""

import zipfile
from pathlib import Path

from pfslam_viz.config import load_robot
from pfslam_viz.robot import Robot

BESIDE = "robot.toml"


def robot_of(folder: Path, number: str) -> Robot:
    """The geometry that set ``number`` in this very ``folder`` is read with.

    A simulated set whose simulator left no ``robot.toml`` was rendered with the camera of ``ece276a-paper``. Raises
    InputError if ``robot.toml`` is there but not right.
    """
    beside = folder / BESIDE
    if beside.is_file():
        return load_robot(beside)
    return load_robot("ece276a-paper" if _is_simulated(folder, number) else "ece276a")


def _is_simulated(folder: Path, number: str) -> bool:
    """Whether the set's truth holds the walls too, which only a simulator knows."""
    for path in (folder / f"ground_truth{number}.npz", folder / "ground_truth.npz"):
        if path.is_file():
            try:
                with zipfile.ZipFile(path) as members:
                    return "walls.npy" in members.namelist()
            except (OSError, zipfile.BadZipFile):
                return False
    return False
