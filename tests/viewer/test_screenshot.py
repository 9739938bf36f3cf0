from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.viewer import screenshot

if TYPE_CHECKING:
    from tests.viewer.conftest import Recorded


def shaded(*levels: int) -> list[NDArray[np.uint8]]:
    return [np.full((40, 60, 3), level, np.uint8) for level in levels]


def test_a_still_picture(tmp_path: Path) -> None:
    path = tmp_path / "images" / "one.png"
    screenshot.write(shaded(77), path, 100)
    assert np.all(np.asarray(cv2.imread(str(path))) == 77)


@pytest.mark.parametrize("suffix", ["webp", "gif"])
def test_an_animation_holds_its_last_picture(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"many.{suffix}"
    screenshot.write(shaded(0, 100, 200), path, 100)
    read, animation = cv2.imreadanimation(str(path))
    assert read
    assert [round(float(frame[..., :3].mean()), -1) for frame in animation.frames] == [0, 100, 200]
    assert list(animation.durations) == [100, 100, 1200]


def test_a_missing_recording_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert screenshot.main([str(tmp_path / "absent.rrd"), str(tmp_path / "x.png")]) == 2
    assert capsys.readouterr().err == f"screenshot: {tmp_path / 'absent.rrd'}: no such file\n"


@pytest.mark.slow
def test_the_readme_picture_is_made(recorded: "Recorded", tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "demo.png"
    status = screenshot.main([str(recorded.path), str(path), "--step", "30", "--size", "800x500", "--width", "400"])
    message = capsys.readouterr().err
    if "Vulkan" in message:
        pytest.skip(message)
    assert status == 0, message
    assert np.asarray(cv2.imread(str(path))).shape == (232, 400, 3)
