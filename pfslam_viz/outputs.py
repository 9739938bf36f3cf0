"""What may be written over: outputs of our own, told by their content. Files of anybody else's are never replaced.

The checks run before anything is read or run, and again as the first file of an output is opened from Python.
"""

import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path

from pfslam_viz.errors import InputError
from pfslam_viz.files import read_small

APPLICATION_ID = "pfslam-viz"
PNG_MARK = b"\x00\x00\x00\x13tEXtSoftware\x00pfslam-viz(~\xe6\xb1"
"""The chunk of a PNG image that says who wrote it."""

_HEAD = 1 << 16  # bytes: whose a file is stands at its beginning
_PNG = b"\x89PNG\r\n\x1a\n"
_IHDR_END = 33  # bytes of a PNG's signature and first chunk
_TUM = re.compile(rb"[-\d.]+ -?\d+\.\d{9} -?\d+\.\d{9} 0 0 0 -?\d\.\d{12} -?\d\.\d{12}\n")
_YAML = re.compile(
    rb"image: .+\nmode: trinary\nresolution: \S+\norigin: \[-?\d+\.\d{9}, -?\d+\.\d{9}, 0\.0\]\nnegate: 0\n"
    rb"occupied_thresh: \S+\nfree_thresh: \S+\n"
)
_FIGURE = re.compile(r"0[1-3]_(dead_reckoning|particle_filter|texture)\.png|0[45]_(map|texture)_\d{5,}\.png")
_FIGURES_PAGE = b": particle-filter SLAM</title>"
TRAJECTORIES = ("estimate", "online", "dead_reckoning", "truth")
EXPORTED = (*(f"{name}.tum" for name in TRAJECTORIES), "map.pgm", "map.yaml", "metrics.json")


def refuse_foreign(path: Path, ours: Callable[[bytes], bool], what: str) -> None:
    """Raise InputError where ``path`` is a file that is not empty and that ``ours``, given its beginning, disowns."""
    head = _head(path)
    if head and not ours(head):
        raise InputError(
            f"{path}: is there already and is no {what} of pfslam-viz's, so it is not overwritten; choose another name,"
            " or remove it first"
        )


def check_recording(path: Path, application_id: str = APPLICATION_ID) -> None:
    """Raise InputError where a Rerun recording would overwrite another file, or another program's recording."""
    ours = {APPLICATION_ID.encode(), application_id.encode()}
    refuse_foreign(path, lambda head: head[:3] == b"RRF" and any(name in head for name in ours), "Rerun recording")


def check_export(folder: Path) -> None:
    """Raise InputError where an export into ``folder`` would overwrite a file that is none of an export's."""
    for name in TRAJECTORIES:
        refuse_foreign(folder / f"{name}.tum", lambda head: _TUM.match(head) is not None, "trajectory")
    yaml = folder / "map.yaml"
    refuse_foreign(yaml, lambda head: _YAML.fullmatch(head) is not None, "map")
    refuse_foreign(folder / "map.pgm", lambda head: head[:3] == b"P5\n" and yaml.is_file(), "map")
    refuse_foreign(folder / "metrics.json", lambda _: _is_metrics(folder), "metrics")


def check_figures(folder: Path) -> None:
    """Raise InputError where figures in ``folder`` would overwrite a file that is none of them."""
    page = folder / "index.html"
    refuse_foreign(page, lambda head: _FIGURES_PAGE in head, "page of figures")
    shown = _head(page)
    for path in _matching(folder, _FIGURE):
        named = f'src="{path.name}"'.encode() in shown
        refuse_foreign(path, lambda head, named=named: named or is_own_png(head), "figure")  # type: ignore[misc]


def check_sweep(folder: Path) -> None:
    """Raise InputError where a sweep in ``folder`` would overwrite files of others: it has none of a sweep's own.

    Whether a results.csv that is there is a sweep's is for the sweep to say.
    """
    if _head(folder / "results.csv"):
        return
    own = re.compile(r"results\.parquet|table\.md|sweep\.rrd|index\.html|(curves|maps)(-\d+)?\.png")
    for path in _matching(folder, own):
        refuse_foreign(path, lambda _: False, "sweep's file")


def check_film(path: Path) -> None:
    """Raise InputError where a film or picture would overwrite anything but one of the same kind.

    Who made it cannot be told: most of these formats have no place for that.
    """
    kinds: dict[str, Callable[[bytes], bool]] = {
        ".png": lambda head: head.startswith(_PNG),
        ".gif": lambda head: head[:4] == b"GIF8",
        ".webp": lambda head: head[:4] == b"RIFF" and head[8:12] == b"WEBP",
        ".webm": lambda head: head[:4] == b"\x1a\x45\xdf\xa3",
        ".mp4": lambda head: head[4:8] == b"ftyp",
    }
    ending = path.suffix.lower()
    if ending in kinds:
        refuse_foreign(path, kinds[ending], f"{ending} file")


def marked_png(image: bytes) -> bytes:
    """A PNG image with :data:`PNG_MARK`."""
    return image[:_IHDR_END] + PNG_MARK + image[_IHDR_END:]


def is_own_png(head: bytes) -> bool:
    """Whether a PNG image begins with our mark."""
    return head.startswith(_PNG) and head[_IHDR_END:].startswith(PNG_MARK)


def _head(path: Path) -> bytes:
    """The beginning of a file; nothing where there is none. Raises InputError for one that cannot be read."""
    try:
        if not path.is_file():
            return b""
        with path.open("rb") as file:
            return file.read(_HEAD)
    except OSError as error:
        raise InputError(
            f"{path}: is there already and cannot be read, so it is not overwritten: {error.strerror}"
        ) from None


def _matching(folder: Path, names: re.Pattern[str]) -> Iterable[Path]:
    try:
        return sorted(path for path in folder.iterdir() if names.fullmatch(path.name))
    except OSError:
        return ()


def _is_metrics(folder: Path) -> bool:
    """Whether metrics.json is a run's, or lies beside the trajectory of one: from Python, it may hold anything."""
    if (folder / "estimate.tum").is_file():
        return True
    try:
        values = json.loads(read_small(folder / "metrics.json"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(values, dict) and {"recording", "config", "seed", "path_length_m"} <= values.keys()
