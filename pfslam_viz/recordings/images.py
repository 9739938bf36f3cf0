"""The Kinect's images, which are PNG files."""

import zlib
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

PNG_START = b"\x89PNG\r\n\x1a\n"
KEPT = 24  # images
MOST_PIXELS = 1 << 24  # a camera of 16 megapixels; the Kinect has 0.3


class UnusableImage(Exception):
    """An image that is not there or damaged; ``reason`` is ``missing``, ``unreadable`` or ``wrong``."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


@lru_cache(maxsize=KEPT)
def read_image(path: Path | None) -> NDArray[np.generic]:
    """A PNG's pixels as they are stored, channels in OpenCV's order BGR; read-only.

    The last :data:`KEPT` are remembered: the floor is painted with images that the viewer shows as well.
    """
    import cv2

    if path is None:
        raise UnusableImage("missing")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise UnusableImage("missing") from None
    except OSError:
        raise UnusableImage("unreadable") from None
    if not _is_whole_png(data) or not is_of_moderate_size(data):
        raise UnusableImage("unreadable")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise UnusableImage("unreadable")
    pixels = np.asarray(image)
    pixels.flags.writeable = False
    return pixels


def is_of_moderate_size(data: bytes) -> bool:
    """Whether a PNG says of itself that it has no more than :data:`MOST_PIXELS`; it may hold none of them."""
    width, height = (int.from_bytes(data[at : at + 4], "big") for at in (16, 20))
    return 0 < width * height <= MOST_PIXELS


def _is_whole_png(data: bytes) -> bool:
    """Whether every chunk is there, up to the last, with the checksum it should have.

    Asked before decoding, because the decoder grumbles on the terminal and fills what is missing with black.
    """
    at = len(PNG_START)
    if not data.startswith(PNG_START):
        return False
    while at + 12 <= len(data):
        end = at + 12 + int.from_bytes(data[at : at + 4], "big")
        if end > len(data) or zlib.crc32(data[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            return False
        if data[at + 4 : at + 8] == b"IEND":
            return True
        at = end
    return False
