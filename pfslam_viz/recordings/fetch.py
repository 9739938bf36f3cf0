"""``pfslam-viz fetch``: public recordings to the disk, with their licence beside them."""

from contextlib import suppress
from pathlib import Path

import numpy as np
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn

from pfslam_viz import console
from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.files import replaced
from pfslam_viz.recordings import carmen, npz
from pfslam_viz.recordings.catalog import DEMO, find_named, recordings_dir
from pfslam_viz.recordings.download import Check, Patience, Request, download_all, has_digest
from pfslam_viz.recordings.images import is_of_moderate_size
from pfslam_viz.recordings.sources import SOURCES, RemoteFile, Source

ORIGIN = "https://raw.githubusercontent.com"
# So many frames failing before one succeeds means that the server, not a frame, is the matter.
_HOPELESS = 8

_MOST_FRAME = 8 << 20  # bytes; they have 0.2 to 0.6 MB
_PNG_END = b"\0\0\0\0IEND\xaeB`\x82"


def fetch(
    name: str,
    data: Path | None = None,
    *,
    rgbd: bool = False,
    every: int = 1,
    base_url: str | None = None,
    connections: int = 4,
    progress: bool = True,
    patience: Patience | None = None,
) -> list[Path]:
    """Download a public recording into ``data/NAME`` (or where its files already lie), leaving out what is there.

    A file is checked (digest; a frame must decode to the right size and type) before it gets its name. A file of the
    same name with other content is kept as ``FILE.old``.

    Args:
        name: ``20``, ``21``, ``23``, ``intel``, ``fr079``, ``aces``, ``mit-csail`` or ``fr-clinic``.
        data: the folder; :func:`~pfslam_viz.recordings.catalog.recordings_dir` by default.
        rgbd: also the Kinect's images, about 1 GB a set.
        every: only every so many colour images, each with the disparity image nearest in time.
        base_url: a mirror with the same paths (owner/repository/commit/path) or with the files' own names.
        connections: how many files at a time.
        progress: show progress bars.
        patience: time limits and tries.

    Returns:
        The paths of all the recording's files, fetched now or before.

    Raises:
        InputError: there is no such recording, or an argument is out of range.
        PfslamError: something could not be fetched. What was complete stays; the same call resumes.
    """
    source = _source(name, rgbd)
    if every < 1 or connections < 1:
        raise InputError("--every and --connections must be 1 or more")
    if base_url is not None and not base_url.startswith(("http://", "https://")):
        raise InputError(f"--base-url {base_url}: must start with http:// or https://")
    folder = _destination(name, recordings_dir() if data is None else data)
    mirror = _Mirror(base_url)
    try:
        paths = _fetch_files(source, folder, mirror, connections, progress, patience)
    finally:
        with suppress(OSError):
            folder.rmdir()  # only if nothing came
    _keep_notice(source, folder)
    if rgbd:
        paths += _fetch_frames(source, folder, every, mirror, connections, progress, patience)
    return paths


def _source(name: str, rgbd: bool) -> Source:
    source = SOURCES.get(name)
    if source is None or not source.files:
        known = ", ".join(known.name for known in SOURCES.values() if known.files)
        why = "is made on first use, not fetched" if name == DEMO else "is not a recording that can be fetched"
        raise InputError(f"'{name}' {why}; there are {known}")
    if rgbd and source.frames == (0, 0):
        raise InputError(f"{name} has no colour and disparity images: leave out --rgbd")
    return source


def _destination(name: str, data: Path) -> Path:
    """``data/NAME``, or the folder that has files of the recording already."""
    place = find_named(name, data) if data.is_dir() else None
    if place is None:
        return data / name
    return place.path if place.path.is_dir() else place.path.parent


class _Mirror:
    """Where files come from: the origin, or a mirror that may keep them under their own names."""

    def __init__(self, base_url: str | None) -> None:
        self._base = (base_url or ORIGIN).rstrip("/")
        self._own_names = base_url is not None

    def urls(self, file: RemoteFile) -> list[str]:
        paths = [file.path, file.name] if self._own_names else [file.path]
        return [f"{self._base}/{path}" for path in paths]


def _keep_notice(source: Source, folder: Path) -> None:
    """Write licence and origin beside the data, and print them the first time."""
    path = folder / f"SOURCE-{source.name}.txt"
    if path.exists():
        return
    with replaced(path) as temporary:
        temporary.write_text(source.notice, encoding="utf-8")
    console.tell(source.notice)


def _fetch_files(
    source: Source, folder: Path, mirror: _Mirror, connections: int, progress: bool, patience: Patience | None
) -> list[Path]:
    """The recording's own files, a progress bar for each."""
    paths = {file: _already_here(file, folder) for file in source.files}
    missing = [file for file, path in paths.items() if path is None]
    columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TimeRemainingColumn())
    failures: list[str] = []
    with Progress(*columns, console=console.messages(), disable=not progress) as bars:
        requests = [_request(file, folder, mirror, bars) for file in missing]
        for _, error in download_all(requests, connections, patience):
            if error is not None:
                failures.append(str(error))
    if failures:
        more = f" (and {len(failures) - 1} more)" if len(failures) > 1 else ""
        raise PfslamError(f"{failures[0]}{more}; complete files are kept: run the same command again for the rest")
    return [path or folder / file.name for file, path in paths.items()]


def _already_here(file: RemoteFile, folder: Path) -> Path | None:
    """The very file, under its name here or, for a log, under the one at its origin."""
    names = [file.name, *([Path(file.path).name] if carmen.is_log(Path(file.path)) else [])]
    for path in (folder / name for name in names):
        if path.is_file() and file.digest is not None and has_digest(path, file.digest):
            return path
    return None


def _request(file: RemoteFile, folder: Path, mirror: _Mirror, bars: Progress) -> Request:
    target = folder / file.name
    task = bars.add_task(file.name, total=None)

    def check(path: Path) -> str | None:
        if file.digest is None or not has_digest(path, file.digest):
            return "its content is not what was published (the hash differs); not kept"
        if target.exists():  # and is not the file, or it would not be fetched
            old = target.replace(target.with_name(f"{target.name}.old"))
            console.tell(f"{target} held something else, which is now {old.name}")
        return None

    def on_bytes(received: int, total: int) -> None:
        bars.update(task, completed=received, total=total or None)

    return Request(mirror.urls(file), target, check, on_bytes)


def _fetch_frames(
    source: Source,
    folder: Path,
    every: int,
    mirror: _Mirror,
    connections: int,
    progress: bool,
    patience: Patience | None,
) -> list[Path]:
    """The Kinect's images, one progress bar for all of them."""
    frames = _choose_frames(source, folder, every)
    requests = [
        Request(mirror.urls(file), folder / file.name, check, most=_MOST_FRAME)
        for file, check in frames
        if not (folder / file.name).exists()
    ]
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f}, {task.fields[megabytes]:.0f} MB"),
        TimeRemainingColumn(),
    )
    failures: list[str] = []
    received = done = 0
    with Progress(*columns, console=console.messages(), disable=not progress) as bars:
        task = bars.add_task("frames", total=len(frames), completed=len(frames) - len(requests), megabytes=0.0)
        for request, error in download_all(requests, connections, patience):
            if error is None:
                done += 1
                received += request.target.stat().st_size
                bars.update(task, advance=1, megabytes=received / 1e6)
                continue
            failures.append(str(error))
            if done == 0 and len(failures) >= _HOPELESS:
                raise PfslamError(f"{failures[0]}; the first {len(failures)} frames all failed")
    if failures:
        raise PfslamError(
            f"{len(failures)} of {len(frames)} frames could not be fetched ({failures[0]});"
            " the others are kept: run the same command again for the rest"
        )
    return [folder / file.name for file, _ in frames]


def _choose_frames(source: Source, folder: Path, every: int) -> list[tuple[RemoteFile, Check]]:
    """Every ``every``-th colour image, each with the disparity image nearest in time; all of both for 1."""
    colors = np.arange(0, source.frames[0], every)
    disparities = np.arange(source.frames[1])
    if every > 1:
        path = folder / f"Kinect{source.name}.npz"
        arrays = npz.read_arrays(path, ["rgb_time_stamps", "disparity_time_stamps"])
        color_stamps = npz.vector(arrays, "rgb_time_stamps", path)[colors]
        disparity_stamps = npz.vector(arrays, "disparity_time_stamps", path)
        disparities = np.unique(np.abs(disparity_stamps[None, :] - color_stamps[:, None]).argmin(axis=1))
    chosen: list[tuple[RemoteFile, Check]] = [(source.color_frame(int(k) + 1), check_color) for k in colors]
    return chosen + [(source.disparity_frame(int(k) + 1), check_disparity) for k in disparities]


def check_color(path: Path) -> str | None:
    """What is wrong with a colour image, which must be 480 x 640 x 3 of 8 bits."""
    return _check_png(path, (480, 640, 3), np.dtype(np.uint8))


def check_disparity(path: Path) -> str | None:
    """What is wrong with a disparity image, which must be 480 x 640 of 16 bits."""
    return _check_png(path, (480, 640), np.dtype(np.uint16))


def _check_png(path: Path, shape: tuple[int, ...], dtype: np.dtype[np.generic]) -> str | None:
    import cv2

    content = path.read_bytes()
    if not content.endswith(_PNG_END):  # OpenCV would fill what is missing with black
        return "not a whole PNG image"
    if not is_of_moderate_size(content):
        return "an image of more pixels than any camera has"
    image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        return "not an image that can be decoded"
    if image.shape != shape or image.dtype != dtype:
        size = " x ".join(str(n) for n in image.shape)
        return f"an image of {size} {image.dtype}, not {' x '.join(str(n) for n in shape)} {dtype}"
    return None
