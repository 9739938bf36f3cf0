"""Feeds the floor texture: pairs colour and disparity frames, finds the pose at which they were taken, reads them."""

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.images import UnusableImage, read_image
from pfslam_viz.recordings.recording import Frames
from pfslam_viz.settings import TextureConfig
from pfslam_viz.texture.floor_camera import FloorCamera, find_camera
from pfslam_viz.texture.floor_plane import FloorPlane
from pfslam_viz.texture.floor_texture import FloorTexture, Look
from pfslam_viz.texture.frame_plane import own_plane
from pfslam_viz.texture.kinect import FloorView

Images = tuple[NDArray[np.uint16], NDArray[np.uint8]]  # cropped
View = tuple[NDArray[np.uint16], NDArray[np.uint8], FloorPlane | None]  # and the frame's own floor, if it has one

FARTHEST_APART = 0.2  # s between the two frames of a pair; a robot that turns has looked elsewhere by then
AHEAD = 4  # pairs that are read in advance
KEPT_BYTES = 192_000_000  # images that wait for the floor to be painted anew: 173 pairs of a Kinect's
LOOKS = 3  # at frames that wait to be painted, where all poses are known
READERS = 2  # threads that read: one decodes a pair more slowly than it is painted


@dataclass(slots=True)
class SkippedFrames:
    """How many colour frames were not painted, by reason.

    ``missing``: the colour or disparity file is not there; ``unreadable``: damaged; ``wrong``: of another size or type
    than the Kinect's; ``without_disparity``: none was taken within 0.2 s; ``without_pose``: taken before the first or
    after the last scan.
    """

    missing: int = 0
    unreadable: int = 0
    wrong: int = 0
    without_disparity: int = 0
    without_pose: int = 0

    @property
    def total(self) -> int:
        """All of them."""
        return sum(getattr(self, f.name) for f in fields(self))

    def __str__(self) -> str:
        """Such as ``3 missing, 1 unreadable``; empty when there are none."""
        counts = [(getattr(self, f.name), f.name.replace("_", " ")) for f in fields(self)]
        return ", ".join(f"{n} {reason}" for n, reason in counts if n)


class TexturePainter:
    """Paints the floor as the filter goes: tell it every pose, in order, and ask for :attr:`texture`.

    Each colour frame goes with the disparity frame nearest in time, and with the pose at the disparity's stamp, linear
    between the scans before and after. Frames that cannot be used are counted in :attr:`skipped`. The camera is
    :attr:`camera`, found in the frames or as filed, as the configuration wants it. Where it is to be found, a frame
    whose floor is elsewhere is painted with its own plane: see :func:`~pfslam_viz.texture.frame_plane.own_plane`.
    """

    def __init__(
        self,
        frames: Frames,
        config: TextureConfig,
        cell: float,
        *,
        keep: bool = False,
        camera: FloorCamera | None = None,
    ) -> None:
        """``keep`` the first images, up to :data:`KEPT_BYTES`, so that :meth:`repaint` need not read them again.

        ``camera`` is one that was found before.
        """
        self.frames = frames
        self.config = config
        self.camera = camera or find_camera(frames, config.camera)
        tolerance = self.camera.tolerance(config.floor_tolerance)
        narrowed = config.model_copy(update={"floor_tolerance": tolerance})
        self.texture = FloorTexture(self.camera.geometry, narrowed, cell)
        self._own_planes = config.camera == "fitted" and self.camera.seen_enough
        self.skipped = SkippedFrames()
        self.painted = 0
        self.pairs = pair(frames.color_stamps, frames.disparity_stamps)
        self.skipped.without_disparity = len(frames.color_stamps) - len(self.pairs)
        self._stamps = frames.disparity_stamps[self.pairs[:, 1]] if len(self.pairs) else np.zeros(0)
        self._next = 0
        self._last: tuple[float, NDArray[np.float64]] | None = None
        self._read: dict[int, Future[View]] = {}
        self._kept: dict[int, View] = {}
        self._room = KEPT_BYTES if keep else 0
        self._reader: ThreadPoolExecutor | None = None
        self._beside = 0  # looks at frames that other threads take while earlier ones are painted
        self._looks: deque[Future[Look]] = deque()

    def add_pose(self, stamp: float, pose: ArrayLike) -> tuple[int, int] | None:
        """The robot was at ``pose`` (3,) at ``stamp`` s: paint every frame taken since the pose before.

        Returns the index of the colour and of the disparity frame painted last, or None if there was none.
        """
        here = np.asarray(pose, dtype=np.float64).copy()
        done = None
        while self._next < len(self.pairs) and self._stamps[self._next] <= stamp:
            at = float(self._stamps[self._next])
            if self._last is None and at < stamp:
                self.skipped.without_pose += 1
            else:
                before, there = self._last or (stamp, here)
                then = geometry.interpolate_poses([before, stamp], [there, here], [at])[0] if before < stamp else here
                if self._paint(self._next, then):
                    done = int(self.pairs[self._next, 0]), int(self.pairs[self._next, 1])
            self._next += 1
        self._last = stamp, here
        return done

    def finish(self) -> None:
        """No more poses: the frames that are left have none."""
        self.skipped.without_pose += len(self.pairs) - self._next
        self._next = len(self.pairs)
        self._paint_looks()
        self.close()

    def close(self) -> None:
        """Stop reading ahead."""
        if self._reader is not None:
            self._reader.shutdown(wait=True, cancel_futures=True)
            self._reader = None
        self._read.clear()

    def repaint(self, stamps: ArrayLike, poses: ArrayLike) -> FloorTexture:
        """Paint anew along a whole trajectory, poses (n, 3) at increasing stamps (n,) s, as known in hindsight."""
        fresh = TexturePainter(self.frames, self.config, self.texture.cell, camera=self.camera)
        fresh._kept, self._kept = self._kept, {}
        fresh._beside = LOOKS
        for stamp, pose in zip(np.asarray(stamps, np.float64), np.asarray(poses, np.float64), strict=True):
            fresh.add_pose(float(stamp), pose)
        fresh.finish()
        return fresh.texture

    def _paint(self, index: int, pose: NDArray[np.float64]) -> bool:
        try:
            disparity, color, plane = self._view_of(index)
        except UnusableImage as unusable:
            setattr(self.skipped, unusable.reason, getattr(self.skipped, unusable.reason) + 1)
            return False
        if self._beside and self._reader is not None:
            self._looks.append(self._reader.submit(self.texture.look, disparity, color, pose, plane))
            self._paint_looks(self._beside)
        else:
            self.texture.add_cropped(disparity, color, pose, plane)
        self.painted += 1
        return True

    def _paint_looks(self, left: int = 0) -> None:
        """Paint what was looked at beside, in order, until so many looks are left."""
        while len(self._looks) > left:
            self.texture.paint(self._looks.popleft().result())

    def _view_of(self, index: int) -> View:
        """What a pair shows. The next pairs are read meanwhile: decoding costs more than painting."""
        if self._reader is None:
            self._reader = ThreadPoolExecutor(READERS, thread_name_prefix="frames")
        for k in range(index, min(index + 1 + AHEAD, len(self.pairs))):
            if k not in self._read and k not in self._kept:
                self._read[k] = self._reader.submit(self._look_at, k)
        if index in self._kept:
            return self._kept.pop(index)
        view = self._read.pop(index).result()
        self._room -= view[0].nbytes + view[1].nbytes
        if self._room >= 0:
            self._kept[index] = view
        return view

    def _look_at(self, index: int) -> View:
        color, disparity = self.pairs[index]
        view = self.texture.view
        images = read_images(self.frames.color_paths[color], self.frames.disparity_paths[disparity], view)
        own = own_plane(images[0], view, self.camera.geometry) if self._own_planes else None
        return *images, own


def pair(color_stamps: ArrayLike, disparity_stamps: ArrayLike) -> NDArray[np.intp]:
    """(k, 2) indices of every colour frame and of the disparity frame nearest to it, in order of the disparity's stamp.

    Both stamps (a,), (b,) must increase. Of two equally near frames the earlier one counts. Colour frames without a
    disparity frame within FARTHEST_APART are left out.
    """
    color, disparity = np.asarray(color_stamps, np.float64), np.asarray(disparity_stamps, np.float64)
    if len(color) == 0 or len(disparity) == 0:
        return np.zeros((0, 2), np.intp)
    after = np.clip(np.searchsorted(disparity, color), 1, max(len(disparity) - 1, 1))
    before, after = after - 1, np.minimum(after, len(disparity) - 1)
    nearest = np.where(color - disparity[before] <= disparity[after] - color, before, after)
    pairs = np.stack([np.arange(len(color)), nearest], axis=-1)
    return pairs[np.abs(color - disparity[nearest]) <= FARTHEST_APART]


def read_images(color: Path | None, disparity: Path | None, view: FloorView) -> Images:
    """The disparity and the RGB image of a pair, checked and cropped to the rows in which ``view`` can have floor."""
    import cv2

    try:
        depth_image, color_image = view.crop(read_image(disparity), read_image(color))
    except ValueError:
        raise UnusableImage("wrong") from None
    # Copies: views of the rows would keep whole images alive.
    return depth_image.copy(), np.asarray(cv2.cvtColor(color_image, cv2.COLOR_BGR2RGB), np.uint8)
