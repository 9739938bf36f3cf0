"""Films and pictures of a recording in Rerun's viewer, which draws without a window."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.files import replaced
from pfslam_viz.viewer.film_writers import RATES, Picture, film_writer
from pfslam_viz.viewer.headless import MENU_BAR, HeadlessViewer, headless_viewer

STILLS = (".png",)
LEAST_SIZE, MOST_SIZE = (320, 240), (3840, 2160)  # pixels
DEFAULT_SECONDS = 15.0  # the most that a film takes where no speed is asked for
MOST_PICTURES = 10_000


@dataclass(frozen=True, slots=True)
class Scene:
    """What is photographed: a tab of the layout in a window of ``size`` (width, height) pixels, menu bar not counted.

    Pictures are scaled to ``width`` pixels, unless it is None.
    """

    view: str = "Compare"
    size: tuple[int, int] = (1280, 720)
    width: int | None = None


@dataclass(frozen=True, slots=True)
class Clock:
    """A recording's scans: their numbers (n,), ascending, and when each was taken (n,), s."""

    steps: NDArray[np.int64]
    seconds: NDArray[np.float64]

    @classmethod
    def read(cls, path: Path) -> "Clock":
        """From a .rrd file. Raises InputError for what is none, and for one that has no scans."""
        from rerun.chunk import RrdReader

        if not path.is_file():
            raise InputError(f"{path}: no such file")
        with path.open("rb") as file:
            if file.read(3) != b"RRF":
                raise InputError(
                    f"{path}: is no Rerun recording; make one with: pfslam-viz replay RECORDING --save x.rrd"
                )
        at: dict[int, float] = {}
        try:
            for chunk in RrdReader(str(path)).stream():
                if {"step", "time"} <= set(chunk.timeline_names):
                    rows = chunk.to_record_batch()
                    steps, nanoseconds = (rows.column(name).cast("int64").to_numpy() for name in ("step", "time"))
                    at.update(zip(steps.tolist(), (nanoseconds / 1e9).tolist(), strict=True))
        except (RuntimeError, ValueError, OSError) as error:
            raise InputError(f"{path}: cannot be read: {error}") from None
        if not at:
            raise InputError(f"{path}: has no scans on a timeline 'step'; was it written by pfslam-viz?")
        order = sorted(at)
        return cls(np.array(order, np.int64), np.array([at[step] for step in order]))

    def span(self, first: int | None, last: int | None) -> "Clock":
        """The scans from ``first`` to ``last``, both included; None is the recording's own. Raises InputError."""
        low, high = int(self.steps[0]), int(self.steps[-1])
        for option, step in (("--from", first), ("--to", last)):
            if step is not None and not low <= step <= high:
                raise InputError(f"{option} {step}: the recording has scans {low} to {high}")
        first, last = low if first is None else first, high if last is None else last
        if first > last:
            raise InputError(f"--from {first} comes after --to {last}")
        inside = slice(int(np.searchsorted(self.steps, first)), int(np.searchsorted(self.steps, last, side="right")))
        return Clock(self.steps[inside], self.seconds[inside])

    def default_speed(self) -> float:
        """As fast as the robot, or so many times as fast that a film takes :data:`DEFAULT_SECONDS`."""
        return max(float(self.seconds[-1] - self.seconds[0]) / DEFAULT_SECONDS, 1.0)

    def pictured(self, speed: float, rate: int) -> NDArray[np.int64]:
        """The scan that each picture of a film shows, (m,).

        Pictures follow each other at ``rate`` a second, and the robot moves ``speed`` times as fast as it did; each
        shows the newest scan that there was, the last one the last scan. Raises InputError where they were too many.
        """
        duration = float(self.seconds[-1] - self.seconds[0])
        pictures = int(np.ceil(round(duration / speed * rate, 6))) + 1
        if pictures > MOST_PICTURES:
            raise InputError(
                f"--speed {speed:g}: the film would have {pictures:,} pictures, {MOST_PICTURES:,} are the most; make it"
                " faster, or show less with --from and --to"
            )
        at = self.seconds[0] + np.minimum(np.arange(pictures) * speed / rate, duration)
        newest = np.searchsorted(self.seconds, at + 1e-9, side="right") - 1
        return np.asarray(self.steps[newest], np.int64)


def still(
    recording: Path, out: Path, scene: Scene, step: int, on_picture: Callable[[], None] = lambda: None
) -> list[str]:
    """Write what the viewer shows of a recording at a scan as PNG; what its views complain of.

    ``on_picture`` is called when the picture was taken, and before it is written.
    Raises InputError for a view that is not there, PfslamError where the viewer cannot run or the file not be written.
    """
    import cv2

    with replaced(out) as temporary, _stage(recording, scene) as viewer:
        viewer.seek(step)
        viewer.settle()
        picture = scaled(viewer.picture_at(step), scene.width)
        on_picture()
        # Encoded here and written by Python: on Windows OpenCV finds no path with letters outside the code page.
        done, data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])
        try:
            temporary.write_bytes(data.tobytes() if done else b"")
        except OSError as error:
            raise PfslamError(f"{out}: could not be written: {error.strerror}") from None
        return viewer.reports()


def film(
    recording: Path, out: Path, scene: Scene, steps: NDArray[np.int64], on_picture: Callable[[], None] = lambda: None
) -> list[str]:
    """Write a film of the scans ``steps`` (m,), a picture each; what the viewer's views complain of.

    ``on_picture`` is called after each. The file gets its name when it is complete, whatever ends this before. Raises
    InputError for a view that is not there, PfslamError where the viewer cannot run or the file not be written.
    """
    with replaced(out) as temporary:
        writer = film_writer(temporary)
        with _stage(recording, scene) as viewer:
            viewer.seek(int(steps[0]))
            viewer.settle()
            shown = None
            for step in steps.tolist():
                if step != shown:
                    shown, picture = step, scaled(viewer.picture_at(step), scene.width)
                writer.add(picture)
                on_picture()
            reports = viewer.reports()
        try:
            writer.close()
        except PfslamError as error:
            raise PfslamError(f"{out}: {error}") from None
    return reports


def scaled(picture: Picture, width: int | None) -> Picture:
    """The picture, ``width`` pixels wide unless that is None."""
    import cv2

    if width is None or width == picture.shape[1]:
        return picture
    height = round(picture.shape[0] * width / picture.shape[1])
    return np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


@contextmanager
def _stage(recording: Path, scene: Scene) -> Iterator[HeadlessViewer]:
    """The viewer with the recording open, at the right tab."""
    width, height = scene.size
    with headless_viewer((width, height + MENU_BAR)) as viewer:
        viewer.open(recording)
        viewer.show_tab(scene.view)
        yield viewer


def rate_of(out: Path) -> int:
    """Pictures a second of a film with this ending."""
    return RATES[out.suffix.lower()]
