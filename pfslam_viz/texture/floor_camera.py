"""The camera that the floor is painted with: found in the recording's own images, or as the robot file has it."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.images import UnusableImage, read_image
from pfslam_viz.recordings.recording import Frames
from pfslam_viz.robot import CameraGeometry
from pfslam_viz.texture.floor_plane import FloorPlane, down_of, fit_floor

Source = Literal["fitted", "filed"]

LOOKED_AT = 32  # disparity frames, spread evenly over the drive
LEAST_FRAMES = 3  # that must show the floor,
LEAST_SHARE = 1 / 3  # and of those that were looked at
MOST_SPREAD = math.radians(0.5)  # of the plane's direction over the frames,
MOST_HEIGHT_SPREAD = 0.02  # m, and of the camera's height: beyond, the robot rocks, or it was not the floor
FAR_ANGLE, FAR_HEIGHT = math.radians(1.0), 0.02  # a file that is off by more is worth a word
READERS = 2  # threads


@dataclass(frozen=True, slots=True)
class FloorCamera:
    """The camera in use, and what the images say of it.

    Attributes:
        geometry: what the floor is painted with, its height counted from the floor.
        filed: the robot file's.
        source: which of the two kinds it is.
        looked_at: how many disparity frames were.
        frames: those in which the floor was found.
        spread: rad, of the floor's direction over these frames, as a standard deviation by the MAD; NaN without any.
        height_spread: m, of the height.
        found: pitch, roll (rad) and height (m) by the images, the medians over the frames; None where these are too
            few or do not agree.
        why_not: why there is none, as a phrase; empty if there is.
    """

    geometry: CameraGeometry
    filed: CameraGeometry
    source: Source
    looked_at: int
    frames: int
    spread: float
    height_spread: float
    found: tuple[float, float, float] | None
    why_not: str = ""

    def as_dict(self) -> dict[str, str | int | float | None]:
        """What metrics.json and ``info`` tell; angles in degrees, m."""
        return {
            "source": self.source,
            "pitch_deg": round(math.degrees(self.geometry.pitch), 3),
            "roll_deg": round(math.degrees(self.geometry.roll), 3),
            "height_m": round(self.geometry.position[2], 4),
            "frames": self.frames,
            "spread_deg": round(math.degrees(self.spread), 3) if math.isfinite(self.spread) else None,
        }

    def tolerance(self, filed: float) -> float:
        """m within which a point is floor, where ``filed`` would do for a camera that is as filed.

        Half of it is enough for a fitted camera, and spares the feet of walls and furniture; more where the frames
        disagree, as the floor two metres ahead does by then.
        """
        if self.source == "filed":
            return filed
        return min(0.5 * filed + 2.0 * (self.height_spread + 2.0 * self.spread), filed)

    @property
    def seen_enough(self) -> bool:
        """Whether the floor is seen in as many frames as it takes to tell it, whether they agree or not."""
        return _enough(self.frames, self.looked_at)

    @property
    def text(self) -> str:
        """The camera in words, such as ``fitted to 32 frames: 20.69° down, ...``."""
        k = self.geometry
        pose = f"{math.degrees(k.pitch):.2f}° down, roll {_degrees(k.roll)}°, {k.position[2]:.3f} m high"
        if self.source == "filed":
            return f"as filed: {pose}" + (f"; {self.why_not}" if self.why_not else "")
        spread = f"± {math.degrees(self.spread):.2f}°, {1e3 * self.height_spread:.0f} mm"
        filed = f"{math.degrees(self.filed.pitch):.2f}°, {self.filed.position[2]:.3f} m"
        return f"fitted to {self.frames} frames: {pose} ({spread}; the file says {filed})"

    @property
    def note(self) -> str | None:
        """What a user should know: the file is off by more than 1° or 2 cm, or nothing could be fitted."""
        if self.found is None:
            return f"camera: {self.why_not}; the robot file's is used" if self.why_not else None
        pitch, roll, height = self.found
        turned = _angle(down_of(pitch, roll), down_of(self.filed.pitch, self.filed.roll))
        if turned <= FAR_ANGLE and abs(height - self.filed.position[2]) <= FAR_HEIGHT:
            return None
        said = (
            f"camera: by the floor in {self.frames} frames it looks {math.degrees(pitch):.2f}° down from {height:.3f} m"
            f" (roll {_degrees(roll)}°); the robot file says {math.degrees(self.filed.pitch):.2f}° and"
            f" {self.filed.position[2]:.3f} m (roll {_degrees(self.filed.roll)}°)"
        )
        if self.source == "fitted":
            return f"{said}; the floor is painted with the former"
        return f"{said}, which the floor is painted with: --set texture.camera=fitted takes the former"


def find_camera(frames: Frames, source: Source = "fitted") -> FloorCamera:
    """Find the camera's pitch, roll and height by the floor in some tens of ``frames``; yaw and place stay as filed.

    With ``source`` "filed" the file's camera is used whatever is found, and so it is where the frames do not agree.
    The same files are fitted once.
    """
    there = [path for path in frames.disparity_paths if path is not None]
    spread = np.unique(np.linspace(0, max(len(there) - 1, 0), LOOKED_AT).round().astype(int))
    picked = [there[k] for k in spread[: len(there)]]
    planes = _planes(tuple((path, _version(path)) for path in picked), frames.camera)
    return settle(planes, len(picked), frames.camera, source)


@lru_cache(maxsize=8)
def _planes(files: tuple[tuple[Path, int], ...], camera: CameraGeometry) -> tuple[FloorPlane, ...]:
    """The floors in those ``files`` (each with its version) that show one."""
    with ThreadPoolExecutor(READERS, thread_name_prefix="floor") as pool:
        found = pool.map(lambda file: _plane(file[0], camera), files)
        return tuple(plane for plane in found if plane is not None)


def _version(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def settle(planes: Sequence[FloorPlane], looked_at: int, filed: CameraGeometry, source: Source) -> FloorCamera:
    """The camera by the ``planes`` that were found in ``looked_at`` frames: their medians, if they agree."""
    if not planes:
        why = "the floor is seen in no disparity frame" if looked_at else "there are no disparity frames"
        return FloorCamera(filed, filed, "filed", looked_at, 0, math.nan, math.nan, None, why)
    values = np.array([(p.pitch, p.roll, p.height) for p in planes])
    pitch, roll, height = (float(v) for v in np.median(values, axis=0))
    middle = down_of(pitch, roll)
    # The angles to the middle are lengths in the plane: of a normal one per axis, the median is 1.1774 of its spread.
    spread = float(np.median([_angle(p.down, middle) for p in planes])) / 1.1774
    height_spread = 1.4826 * float(np.median(np.abs(values[:, 2] - height)))
    why = ""
    if not _enough(len(planes), looked_at):
        why = f"the floor is seen in {len(planes)} of {looked_at} disparity frames, too few"
    elif spread > MOST_SPREAD or height_spread > MOST_HEIGHT_SPREAD:
        why = (
            f"the floors in {len(planes)} frames do not agree"
            f" (± {math.degrees(spread):.2f}°, {100 * height_spread:.1f} cm)"
        )
    found = None if why else (pitch, roll, height)
    geometry = filed
    if source == "fitted" and found is not None:
        x, y, _ = filed.position
        geometry = filed.model_copy(update={"pitch": pitch, "roll": roll, "position": (x, y, height)})
    used: Source = "filed" if geometry is filed else "fitted"
    return FloorCamera(geometry, filed, used, looked_at, len(planes), spread, height_spread, found, why)


def _plane(path: Path, camera: CameraGeometry) -> FloorPlane | None:
    try:
        image = read_image(path)
    except UnusableImage:
        return None
    k = camera.intrinsics
    return fit_floor(image, camera) if image.shape == (k.height, k.width) and image.dtype == np.uint16 else None


def _enough(frames: int, looked_at: int) -> bool:
    return frames >= max(LEAST_FRAMES, LEAST_SHARE * looked_at)


def _degrees(angle: float) -> str:
    return f"{round(math.degrees(angle), 2) + 0.0:.2f}"  # no minus before a zero


def _angle(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
