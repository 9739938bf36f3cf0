"""Pictures written as a film: MP4, WebM, GIF or WebP, whichever the file's ending asks for.

What writes which was measured on a hundred pictures of 1280 x 720 (docs/sharing.md). OpenCV's own encoders, which are
here anyway, do for WebM. H.264, which plays everywhere, needs PyAV (the extra ``film``), at a fifth of the size of the
MPEG-4 Part 2 that OpenCV writes without it. Pillow, which comes with Rerun, writes GIFs of a twentieth of the size of
OpenCV's, and without their specks.
"""

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import PfslamError

Picture = NDArray[np.uint8]  # (rows, columns, 3) BGR

VIDEOS = (".mp4", ".webm")
ANIMATIONS = (".gif", ".webp")
RATES = {".mp4": 25, ".webm": 25, ".gif": 10, ".webp": 10}  # pictures a second
HOLD_SECONDS = 1.5  # the last picture stays so long
CRF = 20  # of H.264: quality that keeps thin lines and small print; the smaller the better
WEBP_QUALITY = 70
PALETTE = 255  # colours of a GIF, one left for what does not change


class FilmWriter(Protocol):
    """Takes the pictures of a film in their order; they are all of one size."""

    def add(self, picture: Picture) -> None:
        """Append a picture."""

    def close(self) -> None:
        """Complete the file. Raises PfslamError or OSError where it could not be written."""


def has_h264() -> bool:
    """Whether PyAV is here."""
    return find_spec("av") is not None


def film_writer(path: Path) -> FilmWriter:
    """What writes a film with the ending of ``path`` there."""
    ending = path.suffix.lower()
    if ending in ANIMATIONS:
        return _Animation(path, RATES[ending])
    if ending == ".mp4" and has_h264():
        return _H264(path, RATES[ending])
    return _OpenCv(path, "VP80" if ending == ".webm" else "mp4v", RATES[ending])


class _OpenCv:
    """VP8 or MPEG-4 Part 2, with the libraries that OpenCV brings along."""

    def __init__(self, path: Path, code: str, rate: int) -> None:
        self._path, self._code, self._rate = path, code, rate
        self._writer: Any = None
        self._last: Picture | None = None
        self._pictures = 0

    def add(self, picture: Picture) -> None:
        self._last = _even(picture)
        if self._writer is None:
            self._open(self._last.shape[1], self._last.shape[0])
        with _silent_stderr():  # a line a picture where the disk is full
            self._writer.write(self._last)
        self._pictures += 1

    def _open(self, width: int, height: int) -> None:
        import cv2

        code = cv2.VideoWriter.fourcc(*self._code)
        with _silent_stderr():  # FFmpeg there does not know its own names of WebM's codecs, and says so
            self._writer = cv2.VideoWriter(str(self._path), cv2.CAP_FFMPEG, code, self._rate, (width, height))
        if not self._writer.isOpened():
            raise PfslamError(f"OpenCV cannot write {self._path.suffix} here: choose another ending")

    def close(self) -> None:
        import cv2

        if self._last is not None:
            for _ in range(round(HOLD_SECONDS * self._rate)):
                self.add(self._last)
        self._writer.release()
        with _silent_stderr():
            written = cv2.VideoCapture(str(self._path), cv2.CAP_FFMPEG).get(cv2.CAP_PROP_FRAME_COUNT)
        if abs(written - self._pictures) > 1:  # OpenCV does not tell of what it could not write
            raise PfslamError("the film could not be written (is the disk full?)")


class _H264:
    """H.264 in MP4, with PyAV."""

    def __init__(self, path: Path, rate: int) -> None:
        import av

        self._rate = rate
        self._file: Any = av.open(str(path), "w", options={"movflags": "faststart"})
        self._stream: Any = self._file.add_stream("libx264", rate=rate, options={"crf": str(CRF)})
        self._stream.pix_fmt = "yuv420p"
        self._last: Picture | None = None

    def add(self, picture: Picture) -> None:
        import av

        if self._last is None:
            self._stream.height, self._stream.width = _even(picture).shape[:2]
        self._last = np.ascontiguousarray(_even(picture))
        self._file.mux(self._stream.encode(av.VideoFrame.from_ndarray(self._last, format="bgr24")))

    def close(self) -> None:
        if self._last is not None:
            for _ in range(round(HOLD_SECONDS * self._rate)):
                self.add(self._last)
        self._file.mux(self._stream.encode())
        self._file.close()


class _Animation:
    """GIF or WebP, with Pillow; written at the end, pictures wait as PNG."""

    def __init__(self, path: Path, rate: int) -> None:
        self._path, self._milliseconds = path, round(1000 / rate)
        self._waiting: list[bytes] = []

    def add(self, picture: Picture) -> None:
        import cv2

        self._waiting.append(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes())

    def close(self) -> None:
        first, *others = self._paletted() if self._path.suffix.lower() == ".gif" else self._pictures()
        durations = [self._milliseconds] * len(others) + [round(1000 * HOLD_SECONDS)]
        options: dict[str, Any] = {"save_all": True, "append_images": others, "duration": durations, "loop": 0}
        if self._path.suffix.lower() == ".webp":
            options |= {"quality": WEBP_QUALITY, "method": 4, "kmin": 9, "kmax": 17}
        first.save(self._path, **options)

    def _pictures(self) -> Iterator[Any]:
        from PIL import Image

        return (Image.open(io.BytesIO(data)).convert("RGB") for data in self._waiting)

    def _paletted(self) -> Iterator[Any]:
        """With one palette for all, and without dither: what does not change stays the same, and costs nothing."""
        from PIL import Image

        samples = [np.asarray(picture)[::4, ::4] for picture in self._pictures()]
        palette = Image.fromarray(np.concatenate(samples)).quantize(PALETTE, method=Image.Quantize.FASTOCTREE)
        return (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in self._pictures())


def _even(picture: Picture) -> Picture:
    """Without the last row or column where their number is odd: colours are stored for two by two pixels."""
    return picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2]


@contextmanager
def _silent_stderr() -> Iterator[None]:
    """Nothing that a library in C writes to standard error gets there."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)
