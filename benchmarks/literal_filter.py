"""The paper's filter written down in NumPy as literally as it stands, without a compiled line: the yardstick.

What a student would write after reading the paper, each equation an expression over whole arrays. It runs on a map of
fixed size, counts end points in occupied cells (the cheap reading of (26): two beams in one cell count twice), and
draws all rays of a scan at once; one ray at a time in a Python loop would be some fifty times slower.
"""

from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.slam.paper.settings import PaperConfig
from pfslam_viz.slam.scan_reader import ScanReader

Array = NDArray[np.float64]

HALF_WIDTH = 60.0  # m: the map reaches so far to every side of the start
PHASES = ("predict", "update", "map", "resample", "dead_reckoning")


class LiteralMap:
    """A log-odds grid of fixed size, (20) to (25), (28) and (29)."""

    def __init__(self, config: Config) -> None:
        self.cell = config.map.cell
        self.origin = int(HALF_WIDTH / self.cell)
        self.log_odds = np.zeros((2 * self.origin + 1, 2 * self.origin + 1))
        self.occupied = np.zeros(self.log_odds.shape, np.uint8)
        self.config = config.map

    def cells(self, x: Array, y: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """(24) and (25)."""
        row = np.floor(-y / self.cell).astype(np.intp) + self.origin
        column = np.floor(x / self.cell).astype(np.intp) + self.origin
        return np.clip(row, 0, len(self.log_odds) - 1), np.clip(column, 0, len(self.log_odds) - 1)

    def correlation(self, x: Array, y: Array) -> Array:
        """(26) for the end points (N, m) of every particle."""
        row, column = self.cells(x, y)
        correlation: Array = self.occupied[row, column].sum(axis=1, dtype=np.float64)
        return correlation

    def add(self, pose: Array, points: Array, origin: Array) -> None:
        """(28): free along the rays by Bresenham's line, occupied at their ends, each cell once a scan."""
        x, y = world(pose, points)
        ox, oy = world(pose, origin[None])
        row, column = self.cells(x, y)
        start_row, start_column = (int(i[0]) for i in self.cells(ox, oy))
        steps = np.maximum(np.abs(row - start_row), np.abs(column - start_column))
        ray = np.repeat(np.arange(len(steps)), steps)
        along = np.arange(len(ray)) - np.repeat(np.cumsum(steps) - steps, steps)
        part = along / steps[ray]
        free_row = np.rint(start_row + part * (row - start_row)[ray]).astype(np.intp)
        free_column = np.rint(start_column + part * (column - start_column)[ray]).astype(np.intp)
        # Assignment through an index takes each cell once, however often it is named.
        hit = np.minimum(self.log_odds[row, column] + self.config.log_odds_hit, self.config.log_odds_bound)
        missed = self.log_odds[free_row, free_column] - self.config.log_odds_miss
        self.log_odds[free_row, free_column] = np.maximum(missed, -self.config.log_odds_bound)
        self.log_odds[row, column] = hit
        for changed in ((free_row, free_column), (row, column)):  # (29)
            self.occupied[changed] = self.log_odds[changed] > self.config.threshold


def world(pose: Array, points: Array) -> tuple[Array, Array]:
    """(23): points (m, 2) of the robot's frame in the world; for poses (N, 3) both results are (N, m)."""
    x, y, theta = (pose[..., i, None] for i in range(3))
    c, s = np.cos(theta), np.sin(theta)
    return x + c * points[:, 0] - s * points[:, 1], y + s * points[:, 0] + c * points[:, 1]


class LiteralFilter:
    """Algorithm 1 over a recording, with dead reckoning and its map beside it."""

    def __init__(self, recording: Recording, config: PaperConfig) -> None:
        self.recording, self.config = recording, config
        self.rng = np.random.default_rng(config.seed)
        self.particles = np.zeros((config.particles, 3))
        self.weights = np.full(config.particles, 1.0 / config.particles)
        self.map, self.dead_reckoning_map = LiteralMap(config), LiteralMap(config)
        self.poses = np.zeros((len(recording), 3))
        self.seconds = {phase: np.zeros(len(recording)) for phase in PHASES}

    def run(self) -> None:
        """All scans."""
        dead_reckoning = self.recording.dead_reckoning()
        reader = ScanReader.of(self.recording.lidar, self.config.observation)
        for k in range(len(self.recording)):
            scan = reader.read(k, float(self.recording.stamps[k]), self.recording.ranges[k])
            points, origin = scan.points, scan.lidar_position
            marks = [perf_counter()]
            if k > 0:
                self.predict(self.recording.odometry[k])
            marks.append(perf_counter())
            self.update(points)
            marks.append(perf_counter())
            best = self.particles[np.argmax(self.weights)].copy()
            self.map.add(best, points, origin)
            marks.append(perf_counter())
            self.resample()
            marks.append(perf_counter())
            self.dead_reckoning_map.add(dead_reckoning[k], points, origin)
            marks.append(perf_counter())
            self.poses[k] = best
            for phase, seconds in zip(PHASES, np.diff(marks), strict=True):
                self.seconds[phase][k] = seconds

    def predict(self, increment: Array) -> None:
        """(13), (17) to (19)."""
        x, y, theta = self.particles.T
        c, s = np.cos(theta), np.sin(theta)
        moved = np.stack(
            [
                x + c * increment[0] - s * increment[1],
                y + s * increment[0] + c * increment[1],
                theta + increment[2],
            ],
            axis=-1,
        )
        self.particles = moved + self.rng.normal(0.0, np.sqrt(self.config.motion.variance), moved.shape)

    def update(self, points: Array) -> None:
        """(26) and (27)."""
        weights = self.weights * self.map.correlation(*world(self.particles, points))
        if weights.sum() > 0:
            self.weights = weights / weights.sum()

    def resample(self) -> None:
        """(31) and (32), after every update."""
        drawn = self.rng.choice(len(self.weights), len(self.weights), p=self.weights)
        self.particles = self.particles[drawn]
        self.weights = np.full(len(self.weights), 1.0 / len(self.weights))
