from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from pfslam_viz.recordings.recording import Frames
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.viewer.camera_images import CameraImages
from pfslam_viz.viewer.contents import Jpeg
from pfslam_viz.viewer.entities import COLOR_IMAGE, Entity


def frames(folder: Path, count: int) -> Frames:
    paths: list[Path | None] = []
    for k in range(count):
        path = folder / f"{k}.png"
        cv2.imwrite(str(path), np.full((480, 640, 3), 10 * k, np.uint8))
        paths.append(path)
    paths[1] = None  # a stamp without a file
    stamps = np.arange(count, dtype=float)
    return Frames(stamps, tuple(paths), np.zeros(0), (), CameraGeometry(position=(0, 0, 0)))


def shade(jpeg: Jpeg) -> int:
    return int(np.mean(np.asarray(cv2.imdecode(jpeg.contents, cv2.IMREAD_GRAYSCALE))).round() / 10)


def seen(images: CameraImages, stamps: Iterable[float]) -> list[tuple[float, Entity, int]]:
    return [(stamp, row, shade(jpeg)) for stamp in stamps for row, jpeg in images.due(stamp)]


def test_each_image_comes_at_its_moment(tmp_path: Path) -> None:
    images = CameraImages(frames(tmp_path, 6), (0.0, 4.0), budget=100)
    found = seen(images, [0.0, 0.5, 1.5, 2.5, 4.0, 9.0])
    images.close()
    assert found == [
        (0.0, COLOR_IMAGE, 0),
        (2.5, COLOR_IMAGE, 2),
        (4.0, COLOR_IMAGE, 4),
    ]  # 3 was passed over, 5 is late
    assert images.logged == 3 and images.available == 4


def test_the_budget_thins_them(tmp_path: Path) -> None:
    images = CameraImages(frames(tmp_path, 10), (0.0, 9.0), budget=3)
    found = seen(images, np.arange(10.0))
    images.close()
    assert [k for _, _, k in found] == [0, 4, 7]


def test_no_frames_no_images() -> None:
    assert list(CameraImages(None, (0.0, 1.0), 5).due(0.5)) == []
