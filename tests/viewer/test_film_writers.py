"""Films read back: how many pictures there are, what is on them, how long they stay."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from pfslam_viz.errors import PfslamError
from pfslam_viz.viewer import film_writers
from pfslam_viz.viewer.film_writers import film_writer

LEVELS = (0, 100, 200)


def shaded(level: int, rows: int = 96, columns: int = 128) -> NDArray[np.uint8]:
    """One colour, with a mark whose place tells up from down: blue on the top left."""
    picture = np.full((rows, columns, 3), level, np.uint8)
    picture[: rows // 4, : columns // 4] = (255, 0, 0)
    return picture


def write(path: Path, rows: int = 96) -> Path:
    writer = film_writer(path)
    for level in LEVELS:
        writer.add(shaded(level, rows))
    writer.close()
    return path


def frames_of(path: Path) -> list[NDArray[np.uint8]]:
    film = cv2.VideoCapture(str(path))
    assert round(film.get(cv2.CAP_PROP_FPS)) == 25
    frames = []
    while (read := film.read())[0]:
        frames.append(np.asarray(read[1], np.uint8))
    return frames


@pytest.mark.parametrize("name", ["film.mp4", "film.webm", "h264.mp4"])
def test_a_film_holds_its_last_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    if name == "h264.mp4":
        pytest.importorskip("av", reason="needs the extra film")
    else:
        monkeypatch.setattr(film_writers, "has_h264", lambda: False)
    frames = frames_of(write(tmp_path / name))
    assert len(frames) == 3 + 38  # 1.5 s at 25 a second
    shown = [float(frame[48:].mean()) for frame in frames[:3] + frames[-1:]]
    assert shown == pytest.approx([0, 100, 200, 200], abs=4)
    blue, green, red = frames[-1][4:20, 4:28].mean(axis=(0, 1))
    assert blue > 200 and green < 60 and red < 60


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_an_animation_holds_its_last_picture_and_starts_again(tmp_path: Path, suffix: str) -> None:
    with Image.open(write(tmp_path / f"film{suffix}")) as film:
        assert (getattr(film, "n_frames", 1), film.info["loop"], film.size) == (3, 0, (128, 96))
        shown, durations = [], []
        for k in range(3):
            film.seek(k)
            shown.append(float(np.asarray(film.convert("RGB"))[48:].mean()))
            durations.append(film.info["duration"])
        red, _, blue = np.asarray(film.convert("RGB"))[4:20, 4:28].mean(axis=(0, 1))
    assert shown == pytest.approx(LEVELS, abs=4)
    assert durations == [100, 100, 1500]
    assert blue > 200 and red < 60


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_film_of_odd_height_loses_a_row(tmp_path: Path, suffix: str) -> None:
    assert frames_of(write(tmp_path / f"film{suffix}", rows=97))[0].shape == (96, 128, 3)


def test_libraries_keep_quiet(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "film.webm")
    assert capfd.readouterr() == ("", "")


def test_a_film_that_was_not_written_is_an_error(tmp_path: Path) -> None:
    writer = film_writer(tmp_path / "film.webm")
    writer.add(shaded(1))
    (tmp_path / "film.webm").unlink()
    with pytest.raises(PfslamError, match="could not be written"):
        writer.close()
