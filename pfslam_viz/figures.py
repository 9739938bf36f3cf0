"""The paper's figures of a recording, as PNG, and a page that shows them in its order."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from pfslam_viz.config import Config
from pfslam_viz.errors import InputError
from pfslam_viz.figures_layers import (
    DEAD_RECKONING,
    FILTER,
    TRUTH,
    Array,
    Image,
    Layer,
    Path2D,
    grid_layer,
    map_limits,
    texture_layer,
)
from pfslam_viz.figures_page import Figure, write_page
from pfslam_viz.files import replaced
from pfslam_viz.outputs import check_figures, marked_png
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result
from pfslam_viz.step import Step

if TYPE_CHECKING:
    from pfslam_viz.texture.floor_texture import FloorTexture

MOST_PARTICLES = 500  # drawn


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
                trajectory=np.array(self.online),
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
    ``on_step`` is called after every scan. Raises InputError if matplotlib is missing, a file cannot be written, or
    one is there that is no figure of ours.
    """
    require_matplotlib()
    if every < 1:
        raise InputError(f"--every {every}: must be at least 1")
    check_figures(out)
    if len(recording) == 0:
        raise InputError(f"{recording.name}: no scans to draw")
    replay = Replay(recording, config)
    collector = _Collector(every)
    for step in replay:
        collector.add(step)
        if on_step is not None:
            on_step(step)
    result = replay.result()
    result.require_map()
    figures = [*_whole(result, out), *_over_time(result, collector.snapshots, out)]
    page = write_page(out / "index.html", result, figures)
    return [*(figure.path for figure in figures), page]


def require_matplotlib() -> None:
    """Raise InputError, with what to do, where matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise InputError("figures are drawn with matplotlib, which is missing: pip install 'pfslam-viz[figures]'")


def _whole(result: Result, out: Path) -> list[Figure]:
    """Figures 1 to 6: the whole drive."""
    from pfslam_viz.figures_drawing import draw_map, draw_texture

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
    from pfslam_viz.figures_drawing import draw_map, draw_texture

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


def write_png(path: Path, image: Image) -> Path:
    """Write an RGB image (rows, columns, 3)."""
    encoded = cv2.imencode(".png", image[..., ::-1])[1]
    with replaced(path) as temporary:
        temporary.write_bytes(marked_png(encoded.tobytes()))
    return path


def _save(path: Path, image: Image, like: str, caption: str) -> Figure:
    return Figure(write_png(path, image), like, caption)
