"""The yardstick of the benchmarks is the same filter, and a benchmark's numbers are what they say."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz.config import load_config
from pfslam_viz.recordings.recording import Lidar, Recording
from pfslam_viz.slam.occupancy_grid import OccupancyGrid

pytest.importorskip("benchmarks", reason="needs the checkout on the path: run python -m pytest in its folder")

from benchmarks import case, claims, contact_sheet
from benchmarks.literal_filter import LiteralFilter, LiteralMap

ANGLES = np.radians(np.linspace(-135, 135, 271))


def room(n: int = 12) -> Recording:
    """A robot that drives 5 cm a scan along x through a room of 6 x 4 m, from its middle."""
    lidar = Lidar(ANGLES, 0.1, 30.0, np.zeros(3))
    x = 0.05 * np.arange(n)[:, None]
    with np.errstate(divide="ignore"):
        ahead = np.where(np.cos(ANGLES) > 0, 3.0 - x, 3.0 + x) / np.abs(np.cos(ANGLES))
        ranges = np.minimum(ahead, 2.0 / np.abs(np.sin(ANGLES)))
    odometry = np.zeros((n, 3))
    odometry[1:, 0] = 0.05
    return Recording(
        "room", "ece276a", Path("room"), np.arange(float(n)) * 0.1, ranges.astype(np.float32), lidar, odometry
    )


def test_the_literal_map_is_the_filters_map() -> None:
    config = load_config("paper")
    literal, grid = LiteralMap(config), OccupancyGrid(config.map)
    rng = np.random.default_rng(0)
    for _ in range(3):
        pose, points = rng.normal(0, 0.3, 3), rng.uniform(-4, 4, (300, 2))
        literal.add(pose, points, np.zeros(2))
        grid.add(pose, points, np.zeros(2))
    rows, columns = np.nonzero(grid.log_odds)
    shift = np.array(grid.origin) - literal.origin
    same = np.isclose(literal.log_odds[rows - shift[0], columns - shift[1]], grid.log_odds[rows, columns])
    assert same.mean() > 0.97  # Bresenham's line and a rounded one differ where a ray passes between two cells
    assert np.count_nonzero(literal.log_odds) == pytest.approx(len(rows), rel=0.01)


def test_without_noise_the_literal_filter_is_dead_reckoning() -> None:
    config = load_config("paper", ["particles=5", "motion.variance=[0.0, 0.0, 0.0]"])
    literal = LiteralFilter(room(), config)
    literal.run()
    np.testing.assert_allclose(literal.poses, room().dead_reckoning(), atol=1e-12)
    assert all((seconds[1:] > 0).all() for seconds in literal.seconds.values())


def test_the_literal_filter_prefers_the_particle_that_fits() -> None:
    literal = LiteralFilter(room(1), load_config("paper", ["particles=2"]))
    literal.run()
    literal.particles = np.array([[0.0, 0.0, 0.0], [0.5, 0.5, 0.3]])
    points = room(1).ranges[0, :, None] * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)
    literal.update(points)
    assert literal.weights[0] > 0.8


@pytest.mark.parametrize("name", ["pfslam", "literal"])
def test_a_case_measures_what_it_says(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr("pfslam_viz.recordings.catalog.load_recording", lambda *_: room())
    settings = case.Case("room", particles=7, beams=100, cell=0.1, stop=10, filter=name)
    numbers = case.run(settings)
    assert (numbers["scans"], numbers["particles"], numbers["beams"], numbers["cell"]) == (10, 7, 100, 0.1)
    assert numbers["real_time"] == pytest.approx(0.9 / numbers["seconds"])
    measured = sum(phase["mean"] for phase in numbers["phases"].values()) * 10 / 1e3
    assert measured < numbers["seconds"]
    assert ("log" in numbers["phases"]) == (numbers["file_mb"] is not None) == (name == "pfslam")
    assert 50 < numbers["peak_mb"] < 4000
    assert case.Case(**asdict(settings)) == settings


def test_a_contact_sheet_holds_all_pictures_and_stays_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Five of 160 x 90 pixels, of one colour each: three rows of two, the last tile empty."""
    shots = [(f"{k}", np.full((90, 160, 3), 40 * k, np.uint8)) for k in range(1, 6)]
    sheet = contact_sheet.tiled(shots)
    height = round(contact_sheet.TILE * 90 / 160)
    high = height + contact_sheet.TITLE + contact_sheet.MARGIN
    assert sheet.shape == (3 * high, 2 * (contact_sheet.TILE + 2 * contact_sheet.MARGIN), 3)
    middles = [sheet[(k // 2) * high + high // 2, (k % 2 * 2 + 1) * sheet.shape[1] // 4] for k in range(6)]
    assert [int(color[0]) for color in middles] == [40, 80, 120, 160, 200, 255]
    noise = np.random.default_rng(0).integers(0, 256, (90, 160, 3)).astype(np.uint8)
    path = tmp_path / "images" / "noise.webp"
    best = contact_sheet.write_small(noise, path)
    assert best == path.stat().st_size
    monkeypatch.setattr(contact_sheet, "MOST_BYTES", best - 1)
    assert 0 < contact_sheet.write_small(noise, path) < best


def test_the_claims_page_has_each_studys_first_table_between_its_marks() -> None:
    page = "2 runs: 1 x 2; 2 runs, 0.10 core-hours\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n\nnote\n\n| not | this |\n"
    table = claims.first_table(page)
    assert table == "| a | b |\n| --- | --- |\n| 1 | 2 |\n\n2 runs: 1 x 2; 2 runs, 0.10 core-hours."
    old = "A\n<!-- x -->\nold\n<!-- end -->\nB\n<!-- y -->\nown\n<!-- end -->\n"
    assert claims.filled(old, {"x": "new"}) == old.replace("old", "new")
    with pytest.raises(AssertionError, match="no <!-- z -->"):
        claims.filled(old, {"z": "new"})


def test_the_claims_page_says_what_all_runs_took(tmp_path: Path) -> None:
    rows = ["cell_s,code,python,numpy,scipy,numba", "1800.0,c1,3,2,1,0", "3600.0,c1,3,2,1,0", "1800.0,c2,3,2,1,0"]
    (tmp_path / "results.csv").write_text("\n".join(rows) + "\n")
    said = claims.cost(tmp_path / "results.csv").splitlines()
    assert said[0] == "3 runs, 2.0 hours of one worker:"
    assert [line[:18] for line in said[2:]] == ["- 2 runs with code", "- 1 runs with code"]
