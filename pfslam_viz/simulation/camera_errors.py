"""What a real Kinect does that its model does not say: another mounting, noise, holes, exposure and motion blur.

Measured on the one real disparity image of the course (480 x 640), about the plane fitted to its floor: the disparities
are whole numbers and spread by 1.25 (by the MAD; 1.37 as a standard deviation) about it. Neighbours err alike: the
correlation is 0.91 one pixel apart, 0.59 sixteen apart and 0.50 at 32; an average over 31 x 31 pixels keeps 1.0 of it.
There is no reading (2047) in the last eight columns, in 0.9 % of the floor's pixels in blotches of some hundred, and
to the left of near things, where they hide the projector's pattern.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError
from pfslam_viz.robot import CameraGeometry

Array = NDArray[np.float64]

NO_READING = 2047  # the Kinect's own code
SMOOTH, FINE = 0.8, 0.6  # parts of the noise, as measured: 1.0 and 0.77 of 1.25
PATCHES = 60  # pixels: the smooth part changes over as many,
GRAIN = 3.0  # and the fine one over these
BLOTCH = 9.0  # pixels: the size of a hole, as the deviation of a Gaussian
BLIND_COLUMNS = 8  # on the right
PROJECTOR = 0.075 * 585.05  # m times pixels: from the depth camera to the projector
BLUR_PARTS = 4  # pictures that make a blurred one
EXPOSURE_PERIODS = (11.0, 27.0)  # s


@dataclass(frozen=True, slots=True)
class CameraErrors:
    """How the camera differs from what the recording tells; by default not at all.

    Attributes:
        pitch, roll: deg, what the camera is truly turned by; None is what is told.
        height: m above the floor, likewise.
        noise: standard deviation of the disparity about what it should be; a real one has 1.25.
        holes: share of the pixels in blotches without a reading; a real one has 0.01. If there are any, there are the
            shadows and blind columns too.
        exposure: the pictures get brighter and darker by up to this share over the drive.
        blur: s that the colour camera's shutter is open.
    """

    pitch: float | None = None
    roll: float | None = None
    height: float | None = None
    noise: float = 0.0
    holes: float = 0.0
    exposure: float = 0.0
    blur: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("pitch", -80.0, 80.0), ("roll", -45.0, 45.0), ("height", 0.05, 3.0), ("noise", 0.0, 50.0),
            ("holes", 0.0, 0.9), ("exposure", 0.0, 0.9), ("blur", 0.0, 0.5),
        ):  # fmt: skip
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise InputError(f"the camera's {name} must be from {low:g} to {high:g}, not {value}")

    def mounted(self, told: CameraGeometry) -> CameraGeometry:
        """The true camera, where ``told`` is the one of the robot file; both heights from the floor."""
        x, y, z = told.position
        return told.model_copy(
            update={
                "pitch": told.pitch if self.pitch is None else math.radians(self.pitch),
                "roll": told.roll if self.roll is None else math.radians(self.roll),
                "position": (x, y, z if self.height is None else self.height),
            }
        )

    def disturb(self, disparity: Array, rng: np.random.Generator) -> Array:
        """Exact disparities (rows, columns), NO_READING where there are none, with noise and holes."""
        out = disparity.copy()
        known = disparity < NO_READING
        if self.noise > 0:
            rows, columns = disparity.shape
            coarse = rng.standard_normal((rows // PATCHES + 2, columns // PATCHES + 2))
            field = SMOOTH * _unit(_grown(coarse, disparity.shape)) + FINE * _unit(
                _blurred(rng, disparity.shape, GRAIN)
            )
            out[known] += self.noise * field[known]
        if self.holes > 0:
            blotches = _blurred(rng, disparity.shape, BLOTCH)
            out[blotches < np.quantile(blotches, self.holes)] = NO_READING
            out[_shadow(disparity)] = NO_READING
            out[:, -BLIND_COLUMNS:] = NO_READING
        return out

    def gain(self, time: float) -> float:
        """What the pictures' brightness is multiplied by at ``time`` s."""
        waves = [math.sin(2 * math.pi * time / period + k) for k, period in enumerate(EXPOSURE_PERIODS)]
        return 1.0 + self.exposure * sum(waves) / len(waves)

    def shutter(self, time: float) -> Array:
        """The times (n,) s of the pictures whose mean is the one taken at ``time``."""
        if self.blur == 0:
            return np.array([time])
        return time + self.blur * ((np.arange(BLUR_PARTS) + 0.5) / BLUR_PARTS - 0.5)


def _shadow(disparity: Array) -> NDArray[np.bool_]:
    """Where something nearer, further right in the row, hides the projector's pattern."""
    dd = np.where(disparity < NO_READING, 3.31 - 0.00304 * disparity, 0.0)
    lit = np.arange(disparity.shape[1]) - PROJECTOR * np.maximum(dd, 0.0) / 1.03
    to_the_right = np.minimum.accumulate(lit[:, ::-1], axis=1)[:, ::-1]
    shadow: NDArray[np.bool_] = lit > to_the_right + 1.0
    return shadow


def _grown(values: Array, shape: tuple[int, ...]) -> Array:
    import cv2

    return np.asarray(cv2.resize(values, (shape[1], shape[0]), interpolation=cv2.INTER_CUBIC), np.float64)


def _blurred(rng: np.random.Generator, shape: tuple[int, ...], sigma: float) -> Array:
    import cv2

    return np.asarray(cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), sigma), np.float64)


def _unit(values: Array) -> Array:
    """The same with a standard deviation of 1."""
    return values / max(float(values.std()), 1e-12)
