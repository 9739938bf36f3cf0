"""The camera's images of the moment, decoded ahead of time beside the filter."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.recording import Frames
from pfslam_viz.viewer import contents
from pfslam_viz.viewer.contents import Jpeg
from pfslam_viz.viewer.entities import COLOR_IMAGE, DISPARITY_IMAGE, Entity

AHEAD = 2  # images that are decoded before they are due; not many, so that the floor's painter finds them decoded


@dataclass
class _Kind:
    entity: Entity
    stamps: NDArray[np.float64]
    paths: list[Path]
    encode: Callable[[Path], Jpeg | None]
    next: int = 0
    pending: dict[int, "Future[Jpeg | None]"] = field(default_factory=dict)


class CameraImages:
    """Colour and disparity frames as JPEG, at most ``budget`` of each kind, evenly spread."""

    def __init__(self, frames: Frames | None, span: tuple[float, float], budget: int) -> None:
        self.logged = self.available = 0
        self._kinds: list[_Kind] = []
        self._pool: ThreadPoolExecutor | None = None
        if frames is None:
            return
        for entity, stamps, paths, encode in (
            (COLOR_IMAGE, frames.color_stamps, frames.color_paths, contents.color_jpeg),
            (DISPARITY_IMAGE, frames.disparity_stamps, frames.disparity_paths, contents.disparity_jpeg),
        ):
            there = [
                i for i, path in enumerate(paths) if path is not None and stamps[i] <= span[1] and stamps[i] >= span[0]
            ]
            kept = there[:: max(-(-len(there) // budget), 1)]
            if kept:
                files = [path for i in kept if (path := paths[i]) is not None]
                self._kinds.append(_Kind(entity, np.asarray(stamps)[kept], files, encode))
                self.available = max(self.available, len(there))

    def due(self, stamp: float) -> Iterator[tuple[Entity, Jpeg]]:
        """Entity and JPEG of each image that has come since the last call; the newest where several have."""
        for kind in self._kinds:
            if kind.next == len(kind.stamps) or stamp < kind.stamps[kind.next]:
                continue
            current = int(np.searchsorted(kind.stamps, stamp, side="right")) - 1
            contents = self._decoded(kind, current).result()
            for passed in range(kind.next, current + 1):
                kind.pending.pop(passed, None)
            kind.next = current + 1
            for coming in range(kind.next, min(kind.next + AHEAD, len(kind.paths))):
                self._decoded(kind, coming)
            if contents is not None:
                self.logged += kind is self._kinds[0]
                yield kind.entity, contents

    def close(self) -> None:
        """Stop decoding."""
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)

    def _decoded(self, kind: _Kind, index: int) -> "Future[Jpeg | None]":
        if self._pool is None:
            self._pool = ThreadPoolExecutor(1, thread_name_prefix="camera-images")
        if index not in kind.pending:
            kind.pending[index] = self._pool.submit(kind.encode, kind.paths[index])
        return kind.pending[index]
