"""Which scan each picture of a film shows, and what becomes of the file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.viewer import film
from pfslam_viz.viewer.film import Clock, Scene

if TYPE_CHECKING:
    from tests.viewer.conftest import Recorded


@pytest.fixture
def clock() -> Clock:
    """Eleven scans, four a second."""
    return Clock(np.arange(11), 0.25 * np.arange(11, dtype=np.float64))


def test_the_clock_is_the_recordings_own(recorded: "Recorded") -> None:
    found = Clock.read(recorded.path)
    assert found.steps.tolist() == list(range(60))
    np.testing.assert_allclose(found.seconds, 0.25 * np.arange(60), atol=1e-6)


def test_what_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "x.rrd").write_bytes(b"GIF89a" * 10)
    (tmp_path / "short.rrd").write_bytes(b"RRF2")
    other = rr.RecordingStream("other")
    other.save(tmp_path / "other.rrd")
    other.log("x", rr.Points3D([[0, 0, 0]]))
    other.disconnect()
    for name, message in (
        ("none.rrd", "no such file"),
        ("x.rrd", "no Rerun recording"),
        ("short.rrd", "short.rrd"),
        ("other.rrd", "no scans"),
    ):
        with pytest.raises(InputError, match=message):
            Clock.read(tmp_path / name)


def test_at_the_robots_own_speed_every_picture_shows_the_newest_scan(clock: Clock) -> None:
    steps = clock.pictured(1.0, 10)  # 2.5 s: a picture every 0.1 s, a scan every 0.25 s
    assert len(steps) == 26
    assert steps.tolist()[:8] == [0, 0, 0, 1, 1, 2, 2, 2]
    assert steps[-1] == 10


def test_a_fast_film_leaves_scans_out_but_not_the_last(clock: Clock) -> None:
    assert clock.pictured(7.0, 5).tolist() == [0, 5, 10]  # 1.4 s a picture, the last at 2.5 s
    assert clock.pictured(1000.0, 5).tolist() == [0, 10]


def test_too_many_pictures(clock: Clock) -> None:
    with pytest.raises(InputError, match="62,501 pictures"):
        clock.pictured(0.001, 25)


def test_a_film_is_not_slower_than_the_robot_by_default(clock: Clock) -> None:
    assert clock.default_speed() == 1.0
    assert Clock(np.array([0, 1]), np.array([5.0, 65.0])).default_speed() == 4.0  # a minute in 15 s


def test_a_span_of_scans(clock: Clock) -> None:
    span = clock.span(3, 5)
    assert span.steps.tolist() == [3, 4, 5] and span.seconds.tolist() == [0.75, 1.0, 1.25]
    assert clock.span(None, None).steps.tolist() == clock.steps.tolist()
    assert clock.span(4, 4).pictured(2.0, 25).tolist() == [4]
    for first, last, message in ((5, 3, "--from 5 comes after --to 3"), (0, 11, "--to 11.*0 to 10"), (12, None, "12")):
        with pytest.raises(InputError, match=message):
            clock.span(first, last)


class Stage:
    """A viewer whose picture is as bright as the scan's number."""

    drawn: list[int]

    def seek(self, step: int) -> float:
        return 0.0

    def settle(self) -> None:
        self.drawn = []

    def picture_at(self, step: int) -> NDArray[np.uint8]:
        self.drawn.append(step)
        return np.full((60, 80, 3), step, np.uint8)

    def reports(self) -> list[str]:
        return ["a view: odd"]


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Stage:
    shown = Stage()

    @contextmanager
    def stand_in(recording: Path, scene: Scene) -> Iterator[Stage]:
        yield shown

    monkeypatch.setattr(film, "_stage", stand_in)
    return shown


def test_a_film_shows_the_scans_in_order_and_draws_each_once(stage: Stage, tmp_path: Path) -> None:
    done: list[int] = []
    steps = np.array([10, 10, 90, 90, 180])
    reports = film.film(Path("x.rrd"), tmp_path / "new" / "x.gif", Scene(width=40), steps, lambda: done.append(1))
    assert (stage.drawn, len(done), reports) == ([10, 90, 180], 5, ["a view: odd"])
    with Image.open(tmp_path / "new" / "x.gif") as made:
        assert made.size == (40, 30)
        made.seek(getattr(made, "n_frames", 1) - 1)
        assert np.asarray(made.convert("L")).mean() == pytest.approx(180, abs=1)
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["x.gif"]


def test_a_still_picture(stage: Stage, tmp_path: Path) -> None:
    film.still(Path("x.rrd"), tmp_path / "x.png", Scene(), 77)
    assert np.all(np.asarray(cv2.imread(str(tmp_path / "x.png"))) == 77)


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".gif", ".webp"])
def test_a_film_that_is_stopped_leaves_the_old_file(stage: Stage, tmp_path: Path, suffix: str) -> None:
    def stop() -> None:
        raise PfslamError("stopped")

    path = tmp_path / f"x{suffix}"
    path.write_text("an older film")
    with pytest.raises(PfslamError, match="stopped"):
        film.film(Path("x.rrd"), path, Scene(), np.array([1, 2]), stop)
    assert path.read_text() == "an older film"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.slow
def test_a_film_of_the_real_viewer(recorded: "Recorded", tmp_path: Path) -> None:
    path = tmp_path / "x.webp"
    try:
        reports = film.film(recorded.path, path, Scene("3-d", (640, 480), 320), np.array([0, 59]))
    except PfslamError as error:
        if "Vulkan" not in str(error):
            raise
        pytest.skip(str(error))
    assert reports == []
    with Image.open(path) as made:
        assert made.size == (320, 240)
        first = np.asarray(made.convert("RGB"), float)
        made.seek(1)
        assert np.abs(first - np.asarray(made.convert("RGB"), float)).max(axis=2).mean() > 1.0  # the robot has moved
    with pytest.raises(InputError, match="'Nope'; there are Compare, Filter, Error, Texture, 3-D, About"):
        film.still(recorded.path, tmp_path / "x.png", Scene("Nope"), 0)
    assert list(tmp_path.iterdir()) == [path]
