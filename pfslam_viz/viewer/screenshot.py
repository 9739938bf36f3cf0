"""Pictures of a recording in Rerun's viewer, for the README: still ones, and animated ones.

python -m pfslam_viz.viewer.screenshot demo.rrd docs/images/demo.png --step 2000
python -m pfslam_viz.viewer.screenshot demo.rrd docs/images/demo-3d.png --tab 3-D --step 2000
python -m pfslam_viz.viewer.screenshot demo.rrd docs/images/demo.webp --frames 40 --width 960
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.files import replaced
from pfslam_viz.viewer.headless import HeadlessViewer, headless_viewer

MENU_BAR = 36  # pixels at the top that belong to the viewer and not to the recording
ANIMATED = (".webp", ".gif")
HOLD = 12  # frames' time that the last picture of an animation stays


def main(arguments: Sequence[str] | None = None) -> int:
    """Take the pictures that the command line asks for; the exit status."""
    parser = argparse.ArgumentParser(prog="screenshot", description=__doc__.split("\n")[0])
    parser.add_argument("recording", type=Path, help="a .rrd file")
    parser.add_argument("out", type=Path, help="a .png, or a .webp or .gif to animate")
    parser.add_argument("--tab", default="Compare", help="Compare, Filter, Texture, 3-D or About")
    parser.add_argument("--step", type=int, default=None, help="the scan to show; the last one by default")
    parser.add_argument(
        "--frames", type=int, default=40, help="pictures in an animation, from the first scan to --step"
    )
    parser.add_argument("--milliseconds", type=int, default=150, help="time between them")
    parser.add_argument("--size", default="1600x900", help="of the viewer's window in pixels")
    parser.add_argument("--width", type=int, default=None, help="pixels to scale the picture to")
    given = parser.parse_args(arguments)
    try:
        size = tuple(int(side) for side in given.size.split("x"))
        if len(size) != 2 or not given.recording.is_file():
            raise InputError(
                f"{given.recording}: no such file" if len(size) == 2 else f"--size {given.size}: write WxH"
            )
        with headless_viewer((size[0], size[1])) as viewer:
            viewer.open(given.recording)
            viewer.show_tab(given.tab)
            last = viewer.last_step() if given.step is None else given.step
            animated = given.out.suffix.lower() in ANIMATED
            steps = np.linspace(0, last, given.frames).astype(int) if animated else [last]
            pictures = [picture(viewer, int(step), given.width) for step in steps]
            complaints = viewer.reports()
        write(pictures, given.out, given.milliseconds)
    except PfslamError as error:
        print(f"screenshot: {error}", file=sys.stderr)
        return error.exit_status
    for complaint in complaints:
        print(f"screenshot: the viewer reports: {complaint}", file=sys.stderr)
    return 1 if complaints else 0


def picture(viewer: HeadlessViewer, step: int, width: int | None) -> NDArray[np.uint8]:
    """What the viewer shows at a scan, (rows, columns, 3) BGR, without its menu bar."""
    import cv2

    viewer.seek(step)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        viewer.photograph(path)
        image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise PfslamError("the viewer gave no picture")
    image = image[MENU_BAR:]
    if width is not None:
        height = round(image.shape[0] * width / image.shape[1])
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(image, np.uint8)


def write(pictures: Sequence[NDArray[np.uint8]], path: Path, milliseconds: int) -> None:
    """Write one picture, or all of them as an animation; the last one stays a while."""
    import cv2

    with replaced(path) as temporary:
        if path.suffix.lower() in ANIMATED:
            animation = cv2.Animation()
            animation.frames = list(pictures)
            animation.durations = [milliseconds] * (len(pictures) - 1) + [HOLD * milliseconds]
            written = cv2.imwriteanimation(str(temporary), animation, [cv2.IMWRITE_WEBP_QUALITY, 70])
        else:
            written = cv2.imwrite(str(temporary), pictures[0], [cv2.IMWRITE_PNG_COMPRESSION, 9])
        if not written:
            raise PfslamError(f"{path}: the picture could not be written")


if __name__ == "__main__":
    sys.exit(main())
