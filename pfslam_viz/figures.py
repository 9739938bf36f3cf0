"""The paper's figures of a recording, as PNG, and a page that shows them in its order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from pfslam_viz.config import Config
from pfslam_viz.errors import InputError
from pfslam_viz.figures_page import Figure, write_page
from pfslam_viz.files import replaced
from pfslam_viz.plot import WHITE, Color, Image, Key, Limits, Plot
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.step import Step

if TYPE_CHECKING:
    from pfslam_viz.texture import FloorTexture

Array = NDArray[np.float64]

# The viewer's colours, which colour-blind people tell apart.
DEAD_RECKONING: Color = (213, 94, 0)
FILTER: Color = (0, 114, 220)
TRUTH: Color = (0, 158, 115)
PARTICLES: Color = (204, 40, 140)
UNKNOWN: Color = (206, 210, 216)
WALL: Color = (28, 30, 36)
WALL_BY_TEXTURE: Color = (120, 126, 136)
MOST_PARTICLES = 500  # drawn
STRAY = 0.2  # % of wall cells on each side that may lie outside the picture: single beams out of a window


@dataclass(frozen=True, slots=True)
class Layer:
    """Cells cut to what is known.

    ``image`` (rows, columns, 3) RGB, ``alpha`` (rows, columns) 255 where known and else 0, ``walls`` (m, 2) m the
    centres of occupied cells, and where the upper left corner is in the world.
    """

    image: Image
    alpha: Image
    walls: Array
    cell: float
    upper_left: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Path2D:
    """A trajectory (n, 3) to draw, and what to call it."""

    poses: Array
    color: Color
    label: str


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What was known after ``scans`` scans, ``time`` s after the first."""

    scans: int
    time: float
    trajectory: Array
    particles: Array
    grid: Layer
    texture: Layer | None


@dataclass(slots=True)
class _Collector:
    """Keeps what the figures over time need while the filter runs."""

    every: int
    online: list[Array] = field(default_factory=list)
    texture: "FloorTexture | None" = None
    snapshots: list[Snapshot] = field(default_factory=list)

    def add(self, step: Step) -> None:
        estimate = step.estimate
        self.online.append(estimate.best)
        if step.texture is not None:
            self.texture = step.texture
        scans = len(self.online)
        if scans % self.every:
            return
        self.snapshots.append(
            Snapshot(
                scans=scans,
                time=step.time,
                trajectory=np.array(self.online if estimate.history is None else estimate.history),
                particles=estimate.particles[:: max(1, len(estimate.particles) // MOST_PARTICLES), :2].copy(),
                grid=grid_layer(step.grid),
                texture=None if self.texture is None else texture_layer(self.texture),
            )
        )


def write_figures(
    recording: Recording,
    config: Config,
    out: Path,
    every: int = 500,
    on_step: Callable[[Step], object] | None = None,
) -> list[Path]:
    """Run the filter, write the paper's figures and ``index.html`` into the folder ``out``, and return the files.

    As the paper's figures 1 to 24: dead reckoning's trajectory and map, the filter's, the floor texture, then
    trajectory and map after every ``every`` scans, and the texture after as many; no texture without a camera.
    ``on_step`` is called after every scan. Raises InputError if a file cannot be written.
    """
    if every < 1:
        raise InputError(f"--every {every}: must be at least 1")
    if len(recording) == 0:
        raise InputError(f"{recording.path}: no scans to draw")
    replay = Replay(recording, config)
    collector = _Collector(every)
    for step in replay:
        collector.add(step)
        if on_step is not None:
            on_step(step)
    result = replay.result()
    figures = [*_whole(result, out), *_over_time(result, collector.snapshots, out)]
    page = write_page(out / "index.html", result, figures)
    return [*(figure.path for figure in figures), page]


def _whole(result: Result, out: Path) -> list[Figure]:
    """Figures 1 to 6: the whole drive."""
    name = result.recording.name
    drive = f"{len(result.stamps):,} scans, {result.stamps[-1] - result.stamps[0]:.0f} s"
    truth = [] if result.truth is None else [Path2D(result.truth, TRUTH, "truth")]
    reckoned = Path2D(result.dead_reckoning, DEAD_RECKONING, "dead reckoning")
    filtered = Path2D(result.estimate, FILTER, "particle filter")
    layer = grid_layer(result.dead_reckoning_grid)
    picture = draw_map(
        map_limits(layer, reckoned.poses),
        layer,
        [*truth, reckoned],
        f"{name}: dead reckoning",
        f"odometry alone, {drive}",
    )
    figures = [_save(out / "01_dead_reckoning.png", picture, "1, 2", f"Dead reckoning: trajectory and map. {drive}.")]
    layer = grid_layer(result.grid)
    limits = map_limits(layer, filtered.poses)
    settings = f"{result.config.name}, {result.config.particles} particles, seed {result.config.seed}"
    picture = draw_map(limits, layer, [*truth, filtered], f"{name}: particle filter", f"{settings}, {drive}")
    caption = f"Particle filter: trajectory and map. {settings}."
    figures.append(_save(out / "02_particle_filter.png", picture, "3, 4", caption))
    if result.texture is not None and result.texture.frames:
        floor = texture_layer(result.texture)
        picture = draw_texture(limits, layer, floor, filtered, f"{name}: floor texture", f"{settings}, {drive}")
        figures.append(_save(out / "03_texture.png", picture, "5, 6", "Texture map: the floor as the camera saw it."))
    return figures


def _over_time(result: Result, snapshots: Sequence[Snapshot], out: Path) -> list[Figure]:
    """Figures 7 to 24: trajectory and grid over time, then texture over time, all with the same limits."""
    name, layer = result.recording.name, grid_layer(result.grid)
    limits = map_limits(layer, result.estimate, *(snapshot.trajectory for snapshot in snapshots))
    figures = []
    for s in snapshots:
        path = Path2D(s.trajectory, FILTER, "particle filter")
        picture = draw_map(
            limits, s.grid, [path], f"{name}: after {s.scans:,} scans", f"{s.time:.1f} s", particles=s.particles
        )
        caption = f"Trajectory and occupancy grid after {s.scans:,} scans, {s.time:.1f} s."
        figures.append(_save(out / f"04_map_{s.scans:05d}.png", picture, "7 to 15", caption))
    for s in snapshots:
        if s.texture is not None:
            path = Path2D(s.trajectory, FILTER, "particle filter")
            title = f"{name}: floor texture after {s.scans:,} scans"
            picture = draw_texture(limits, s.grid, s.texture, path, title, f"{s.time:.1f} s")
            caption = f"Texture map after {s.scans:,} scans, {s.time:.1f} s."
            figures.append(_save(out / f"05_texture_{s.scans:05d}.png", picture, "16 to 24", caption))
    return figures


def draw_map(
    limits: Limits,
    grid: Layer,
    paths: Sequence[Path2D],
    title: str,
    subtitle: str,
    particles: Array | None = None,
) -> Image:
    """A map with trajectories, the last one on top and with the robot at its end; RGB (rows, columns, 3)."""
    plot = Plot(limits, UNKNOWN)
    plot.cells(grid.image, grid.cell, grid.upper_left, grid.alpha)
    for path in paths:
        plot.line(path.poses[:, :2], path.color, 2.2)
    top = paths[-1]
    keys = [Key("line", path.color, path.label) for path in reversed(paths)]
    plot.ring(top.poses[0], top.color)
    keys.append(Key("ring", top.color, "start"))
    plot.robot(top.poses[-1], top.color)
    keys.append(Key("robot", top.color, "robot"))
    if particles is not None:
        plot.dots(particles, PARTICLES)
        keys.append(Key("dot", PARTICLES, "particles"))
    keys += [Key("patch", WALL, "occupied"), Key("patch", WHITE, "free"), Key("patch", UNKNOWN, "unknown")]
    return plot.finish(title, subtitle, keys)


def draw_texture(limits: Limits, grid: Layer, texture: Layer, path: Path2D, title: str, subtitle: str) -> Image:
    """The floor's colours with the walls around them for orientation; RGB (rows, columns, 3)."""
    plot = Plot(limits, WHITE)
    flat = np.empty_like(grid.image)
    flat[:] = WALL_BY_TEXTURE
    occupied = np.where(grid.image.max(axis=2) < np.mean(UNKNOWN) / 2, grid.alpha, np.uint8(0))
    plot.cells(texture.image, texture.cell, texture.upper_left, texture.alpha)
    plot.cells(flat, grid.cell, grid.upper_left, occupied)
    plot.line(path.poses[:, :2], path.color, 1.6, casing=True)
    plot.ring(path.poses[0], path.color)
    plot.robot(path.poses[-1], path.color)
    keys = [
        Key("line", path.color, path.label),
        Key("ring", path.color, "start"),
        Key("robot", path.color, "robot"),
        Key("patch", WALL_BY_TEXTURE, "occupied"),
    ]
    return plot.finish(title, subtitle, keys)


def grid_layer(grid: OccupancyGrid) -> Layer:
    """The log-odds as shades, copied: white is surely free, black surely occupied, and what is unknown is left out."""
    rows, columns = _span(grid.log_odds != 0)
    log_odds = grid.log_odds[rows, columns].astype(np.float64)
    sure = np.tanh(np.abs(log_odds) / 2)[..., None]  # (28) once: 0.6; three times: 0.97
    end = np.where((log_odds < 0)[..., None], np.array(WHITE), np.array(WALL))
    image = np.round(np.array(UNKNOWN) * (1 - sure) + end * sure).astype(np.uint8)
    alpha = np.where(log_odds != 0, np.uint8(255), np.uint8(0))
    row, column = np.nonzero(grid.occupied[rows, columns])
    walls = grid.centers(np.stack([row + rows.start, column + columns.start], axis=-1))
    return Layer(image, alpha, walls, grid.cell, _upper_left(grid.origin, grid.cell, rows, columns))


def texture_layer(texture: "FloorTexture") -> Layer:
    """The painted cells, copied."""
    rows, columns = _span(texture.weight > 0)
    alpha = np.where(texture.weight[rows, columns] > 0, np.uint8(255), np.uint8(0))
    image = texture.color[rows, columns].copy()
    corner = _upper_left(texture.origin, texture.cell, rows, columns)
    return Layer(image, alpha, np.zeros((0, 2)), texture.cell, corner)


def map_limits(layer: Layer, *trajectories: Array) -> Limits:
    """Limits that show the walls of a map and whole trajectories (n, 3)."""
    walls = layer.walls
    if len(walls):
        walls = np.percentile(walls, [STRAY, 100 - STRAY], axis=0)
    return Limits.around(walls, *(poses[:, :2] for poses in trajectories))


def write_png(path: Path, image: Image) -> Path:
    """Write an RGB image (rows, columns, 3)."""
    encoded = cv2.imencode(".png", image[..., ::-1])[1]
    with replaced(path) as temporary:
        temporary.write_bytes(encoded.tobytes())
    return path


def _save(path: Path, image: Image, like: str, caption: str) -> Figure:
    return Figure(write_png(path, image), like, caption)


def _span(known: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns that hold everything known; one cell if nothing is."""
    if not known.any():
        return slice(0, 1), slice(0, 1)
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _upper_left(origin: tuple[int, int], cell: float, rows: slice, columns: slice) -> tuple[float, float]:
    """World position (m) of the upper left corner of a cut: the inverse of (24) and (25)."""
    return (columns.start - origin[1]) * cell, (origin[0] - rows.start) * cell
