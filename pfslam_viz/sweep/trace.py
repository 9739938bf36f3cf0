"""What is kept of a cell besides its numbers: the trajectory and the map, small, as an .npz."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.replay import Result
from pfslam_viz.slam.map_picture import map_picture

MOST_POSES = 1500
MOST_CELLS = 6_000_000
UNKNOWN, FREE, WALL = 128, 250, 25
"""Grey values of a cell of the map."""

Points = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Trace:
    """Poses (n, 3) m, m, rad from the first pose on: ``estimate``, ``dead_reckoning``, ``truth`` where known.

    ``image`` (rows, columns) is the known part of the map in grey, row 0 at the top, of cells of ``cell`` m, with its
    upper left corner at ``corner`` (2,) m.
    """

    estimate: Points
    dead_reckoning: Points
    truth: Points | None
    image: NDArray[np.uint8]
    cell: float
    corner: tuple[float, float]


def pack(result: Result) -> dict[str, Any]:
    """The arrays of a trace, at most :data:`MOST_POSES` poses and :data:`MOST_CELLS` cells."""
    kept = np.unique(np.linspace(0, len(result.stamps) - 1, MOST_POSES).round().astype(int))
    grid = result.grid

    def shades(log_odds: NDArray[np.float32]) -> NDArray[np.uint8]:
        shade = np.where(log_odds > grid.threshold, WALL, np.where(log_odds == 0, UNKNOWN, FREE))
        return shade.astype(np.uint8)

    picture = map_picture(grid, shades, np.array(UNKNOWN, np.uint8), most=MOST_CELLS)
    arrays = {
        "estimate": result.estimate[kept].astype(np.float32),
        "dead_reckoning": result.dead_reckoning[kept].astype(np.float32),
        "image": picture.values,
        "cell": np.float64(picture.cell),
        "corner": np.array(picture.upper_left),
    }
    if result.truth is not None:
        arrays["truth"] = result.truth[kept].astype(np.float32)
    return arrays


def read_trace(path: Path) -> Trace | None:
    """A trace that was kept; None where there is none."""
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as file:
        x, y = file["corner"].tolist()
        truth = file["truth"] if "truth" in file.files else None
        return Trace(file["estimate"], file["dead_reckoning"], truth, file["image"], float(file["cell"]), (x, y))
