"""The paper's figures, from a short drive."""

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

from pfslam_viz import figures_layers
from pfslam_viz.errors import InputError
from pfslam_viz.figures import require_matplotlib, write_figures
from pfslam_viz.figures_drawing import LEFT, TOP, Picture, draw_texture
from pfslam_viz.figures_layers import FREE, WALL, Limits, Path2D, grid_layer, map_limits, texture_layer
from pfslam_viz.figures_page import Figure, write_page
from pfslam_viz.recordings.recording import Lidar, Recording
from pfslam_viz.settings import MapConfig
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.paper.settings import PaperConfig
from pfslam_viz.viewer import colors


@dataclass
class Painted:
    """What figures ask of a floor texture."""

    color: np.ndarray
    weight: np.ndarray
    origin: tuple[int, int]
    cell: float


def read(path: Path) -> np.ndarray:
    """A picture (rows, columns, 3), RGB."""
    image = cv2.imread(str(path))
    assert image is not None
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


@pytest.fixture(scope="module")
def recording() -> Recording:
    """Straight through the middle of a 6 x 4 m room, 2 m in 40 scans."""
    n, angles = 40, np.linspace(-np.pi, np.pi, 180, endpoint=False)
    x = np.linspace(0, 2, n)[:, None]
    c, s = np.cos(angles), np.sin(angles)
    with np.errstate(divide="ignore"):
        ranges = np.minimum(np.where(c > 0, (4 - x) / c, (-2 - x) / c), 2 / np.abs(s))
    steps = np.zeros((n, 3))
    steps[1:, 0] = np.diff(x[:, 0])
    lidar = Lidar(angles, 0.1, 30.0, np.zeros(3))
    return Recording(
        "a <room>", "test", Path("room"), np.arange(float(n)) * 0.1, ranges.astype(np.float32), lidar, steps
    )


def test_writes_the_papers_figures_in_its_order(recording: Recording, tmp_path: Path) -> None:
    seen = []
    files = write_figures(
        recording, PaperConfig(particles=20), tmp_path / "out", 15, lambda step: seen.append(step.index)
    )
    names = ["01_dead_reckoning.png", "02_particle_filter.png", "04_map_00015.png", "04_map_00030.png", "index.html"]
    assert [file.name for file in files] == names
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == names
    assert seen == list(range(40))
    pictures = [read(file) for file in files[:-1]]
    assert pictures[2].shape == pictures[3].shape  # over time: the same limits
    page = files[-1].read_text(encoding="utf-8")
    assert re.findall(r'<img src="([^"]+)"', page) == names[:-1]
    assert "a &lt;room&gt;" in page and "no texture" in page


def test_walls_are_at_their_place_in_the_picture(recording: Recording, tmp_path: Path) -> None:
    """The right wall at x = 4 and the upper one at y = 2, in the PNG of dead reckoning, which is true here."""
    files = write_figures(recording, PaperConfig(particles=1), tmp_path, 1000)
    image = read(files[0]).astype(int)
    grid = OccupancyGrid(MapConfig())
    for ranges, x in zip(recording.ranges, np.linspace(0, 2, 40), strict=True):
        points = ranges[:, None] * np.stack([np.cos(recording.lidar.angles), np.sin(recording.lidar.angles)], axis=-1)
        grid.add(np.array([x, 0.0, 0.0]), points.astype(np.float64), np.zeros(2))
    plot = Picture(map_limits(grid_layer(grid), recording.dead_reckoning()), FREE, 0)
    for x, y, dark in [(4.03, 0.6, True), (3.8, 0.6, False), (4.2, 0.6, False), (1.0, 2.0, True), (1.0, 1.8, False)]:
        column = int(LEFT + (x - plot.limits.left) * plot.scale)
        row = int(TOP + (plot.limits.top - y) * plot.scale)
        assert (image[row, column].max() < 120) == dark, (x, y)


def test_grid_layer_is_cut_to_what_is_known_and_knows_where_it_is() -> None:
    grid = OccupancyGrid(MapConfig(cell=0.1, log_odds_bound=40))
    for _ in range(20):
        grid.add(np.zeros(3), np.array([[2.05, 1.05]]), np.zeros(2))
    layer = grid_layer(grid)
    assert layer.alpha.shape == (12, 21)  # y = 0 is the upper edge of its cell, (24)
    assert layer.upper_left == pytest.approx((0.0, 1.1))
    assert layer.image[0, 20].tolist() == pytest.approx(list(WALL), abs=1)
    assert layer.image[11, 0].min() > 250
    assert layer.alpha[0, 0] == 0 and layer.alpha[0, 20] == 255
    np.testing.assert_allclose(layer.walls, [[2.05, 1.05]])
    assert grid_layer(OccupancyGrid(MapConfig())).alpha.max() == 0  # nothing known, and no error


def test_texture_layer() -> None:
    color, weight = np.zeros((50, 80, 3), np.uint8), np.zeros((50, 80), np.float32)
    color[10, 30], weight[10, 30] = (200, 100, 50), 1
    color[12, 33], weight[12, 33] = (1, 2, 3), 0.5
    layer = texture_layer(Painted(color, weight, (20, 40), 0.1))  # type: ignore[arg-type]
    assert layer.image.shape == (3, 4, 3)
    assert layer.upper_left == pytest.approx((-1.0, 1.0))
    assert layer.image[0, 0].tolist() == [200, 100, 50] and layer.image[2, 3].tolist() == [1, 2, 3]
    assert layer.alpha.tolist() == [[255, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 255]]


def test_wrong_use_is_one_line(recording: Recording, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--every 0"):
        write_figures(recording, PaperConfig(), tmp_path, 0)
    with pytest.raises(InputError, match="no scans"):
        write_figures(recording.select(0, 0), PaperConfig(), tmp_path)


def test_colors_are_the_viewers() -> None:
    for name in ("DEAD_RECKONING", "FILTER", "TRUTH"):
        assert getattr(figures_layers, name) == getattr(colors, name)


def test_without_matplotlib_it_is_said_what_to_install(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pfslam_viz.figures.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'pfslam-viz\[figures\]'"):
        require_matplotlib()
    with pytest.raises(InputError, match=r"pfslam-viz\[figures\]"):
        write_figures(recording, PaperConfig(), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_users_own_matplotlib_settings_do_not_matter(recording: Recording, tmp_path: Path) -> None:
    import matplotlib

    plain = write_figures(recording, PaperConfig(particles=2), tmp_path / "a", 1000)
    with matplotlib.rc_context({"font.size": 30, "lines.linewidth": 9, "image.origin": "lower", "axes.grid": False}):
        other = write_figures(recording, PaperConfig(particles=2), tmp_path / "b", 1000)
    assert [path.read_bytes() for path in plain[:-1]] == [path.read_bytes() for path in other[:-1]]


def test_page_shows_every_section_once(recording: Recording, tmp_path: Path) -> None:
    from pfslam_viz.replay import Replay

    replay = Replay(recording.select(0, 3), PaperConfig(particles=2))
    for _ in replay:
        pass
    figures = [
        Figure(tmp_path / f"{k}.png", like, f"<{k}>") for k, like in enumerate(["3, 4", "5, 6", "7 to 15", "7 to 15"])
    ]
    page = write_page(tmp_path / "index.html", replay.result(), figures).read_text(encoding="utf-8")
    assert re.findall(r"<h2>(.*?) <small>", page) == [
        "Particle filter",
        "Texture map",
        "Trajectory and occupancy grid over time",
    ]
    assert page.count("<figure>") == 4 and "&lt;2&gt;" in page and "no texture" not in page
    assert "2 particles" in page


def test_texture_is_drawn_on_the_floor_with_walls_beside_it() -> None:
    grid = OccupancyGrid(MapConfig(cell=0.1, log_odds_bound=40))
    for _ in range(5):
        grid.add(np.zeros(3), np.array([[4.05, -2.05], [4.05, 2.05], [-1.05, 0.05]]), np.zeros(2))
    color, weight = np.zeros((40, 40, 3), np.uint8), np.zeros((40, 40), np.float32)
    color[10:20, 20:30], weight[10:20, 20:30] = (200, 100, 50), 1  # x 0 to 1 m, y 0 to 1 m
    layer, limits = grid_layer(grid), Limits(-2, 5, -3, 3)
    path = Path2D(np.array([[0.2, -2.0, 0], [0.4, -2.0, 0]]), (0, 114, 220), "particle filter")
    floor = texture_layer(Painted(color, weight, (20, 20), 0.1))  # type: ignore[arg-type]
    picture = draw_texture(limits, layer, floor, path, "floor", "")
    plot = Picture(limits, FREE, 0)

    def pixel(x: float, y: float) -> list[int]:
        row, column = TOP + (plot.limits.top - y) * plot.scale, LEFT + (x - plot.limits.left) * plot.scale
        color: list[int] = picture[int(row), int(column)].tolist()
        return color

    assert pixel(0.3, 0.4) == pytest.approx([200, 100, 50], abs=1)
    assert pixel(0.95, 0.95) == pytest.approx([200, 100, 50], abs=1)
    assert pixel(1.2, 0.4) == pytest.approx([255, 255, 255], abs=1)  # free, and not painted
    assert pixel(4.05, 2.05) == pytest.approx([120, 126, 136], abs=4)
    assert pixel(4.05, -2.05) == pytest.approx([120, 126, 136], abs=4)
