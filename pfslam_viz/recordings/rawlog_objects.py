"""Objects of MRPT's binary serialisation: laser scans, odometry and movements out of a ``.rawlog``.

Nothing says how long an object is, so those of unknown classes cannot be stepped over: the bytes are searched for the
headers of the classes that are wanted instead, wherever they stand, and an object counts only if it is whole up to its
end byte. Layouts by the serializeFrom functions of MRPT 2 (module mrpt_obs), which read all versions there have been.
"""

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.rawlog_bytes import Bytes, Malformed, matrix, pose_2d, pose_3d

Array = NDArray[np.float64]

_WANTED = re.compile(
    rb"([\x80-\xff]|[\x01-\x7f]\0\0\0)((?:mrpt::obs::)?"
    rb"(?:CObservation2DRangeScan|CObservationOdometry|CActionRobotMovement2D|CActionCollection))"
)
_ODOMETRY_METHOD = 0


@dataclass(frozen=True, slots=True)
class Scan:
    """A laser scan: stamp in s (None if it has none), ranges (n,) m with 0 for no return, angles counter-clockwise.

    ``pose`` (3,) is the scanner's x, y, yaw on the robot; ``height`` its z; ``level`` how upright it is: 1 level, -1
    upside down, 0 looking up. ``start`` and ``resolution`` in rad are about its own upright axis.
    """

    stamp: float | None
    ranges: NDArray[np.float32]
    start: float
    resolution: float
    max_range: float
    pose: Array
    height: float
    level: float
    label: str


@dataclass(frozen=True, slots=True)
class Odometry:
    """The robot's pose (3,) by odometry at ``stamp`` s."""

    stamp: float | None
    pose: Array


@dataclass(frozen=True, slots=True)
class Movement:
    """The robot's increment (3,) since the frame before; ``by_odometry`` or by scan matching."""

    increment: Array
    by_odometry: bool


@dataclass(frozen=True, slots=True)
class Collection:
    """The beginning of a collection of movements, alternatives for one and the same step."""


def read_objects(data: bytes) -> Iterator[Scan | Odometry | Movement | Collection | Malformed]:
    """The wanted objects in the order of the file; a Malformed for each that is broken or of an unknown version."""
    at = 0
    while match := _WANTED.search(data, at):
        at = match.end()
        if match[1][0] & 0x7F != len(match[2]):
            continue
        source = Bytes(data, match.start())
        try:
            name, version, has_end = source.header()
            if name == "CActionCollection":
                yield Collection()
                continue
            value = _READERS[name](source, version)
            source.end(has_end)
        except Malformed as error:
            yield error
            continue
        at = source.at
        yield value


def other_classes(data: bytes) -> Counter[str]:
    """How many objects of other kinds of sensors there are, by class without namespace."""
    names = (
        match[2].decode().rpartition("::")[2]
        for match in re.finditer(rb"([\x80-\xff])((?:mrpt::obs::)?CObservation\w{2,40})", data)
        if match[1][0] & 0x7F == len(match[2])
    )
    return Counter(name for name in names if name not in _READERS and name != "CObservationComment")


def _scan(source: Bytes, version: int) -> Scan:
    if not 0 <= version <= 8:
        raise Malformed("version")
    aperture, counter_clockwise, max_range = source.take("fBf")
    x, y, z, rotation = pose_3d(source)
    if version < 6:
        matrix(source)
    count = source.whole()
    if not 0 < count <= 100_000 or not 0 < aperture <= 2 * math.pi + 0.1:
        raise Malformed("beams")
    ranges = source.array(count, "<f4").astype(np.float32)
    valid = source.array(count, "u1") != 0 if version >= 1 else ranges < max_range
    if version >= 2:
        source.take("f")  # standard deviation
    stamp = source.stamp() if version >= 3 else None
    label = ""
    if version >= 4:
        source.take("f")  # beam aperture
    if version >= 5:
        label = source.text()
        source.take("d")  # pitch between beams
    if version >= 7 and source.whole("B"):
        source.array(count, "<i4")
    if version >= 8:
        source.take("f")  # sweep's duration
    level = float(rotation[2, 2])
    ranges[~valid | ~np.isfinite(ranges)] = 0.0
    if (counter_clockwise == 0) != (level < 0):
        ranges = ranges[::-1]
    yaw = math.atan2(rotation[1, 0], rotation[0, 0])
    resolution = aperture / max(count - 1, 1)
    pose = np.array([x, y, yaw])
    return Scan(stamp, ranges, -aperture / 2, resolution, max_range, pose, z, level, label)


def _odometry(source: Bytes, version: int) -> Odometry:
    if not 0 <= version <= 2:
        raise Malformed("version")
    pose = pose_2d(source)
    source.text()
    stamp = source.stamp()
    if version >= 1:
        if source.whole("B") or version < 2:
            source.take("ii")
        if source.whole("B") and version >= 2:
            source.take("ddd")
        elif version < 2:
            source.take("ff")
    return Odometry(stamp, pose)


def _movement(source: Bytes, version: int) -> Movement:
    if not 0 <= version <= 7:
        raise Malformed("version")
    if version < 2:
        increment = _pose_density(source)
        method = source.whole()
    elif (method := source.whole()) == _ODOMETRY_METHOD:
        increment = pose_2d(source)
        # The motion model's settings: model, Gaussian, number of particles, the particles' own.
        source.take({2: "44x", 3: "i5fi4f", 4: "i6fi4f"}.get(version, "i6fi6f"))
    else:
        increment = _pose_density(source)
    if version >= 1:
        if source.whole("B") and version >= 7:
            source.take("ddd")
        elif version < 7:
            source.take("ff")
        if source.whole("B") or version < 7:
            source.take("ii")
    if version >= 6:
        source.take("Q")
    return Movement(increment, method == _ODOMETRY_METHOD)


def _pose_density(source: Bytes) -> Array:
    """The mean of a Gaussian over poses."""
    name, version, has_end = source.header()
    if name == "CPosePDFGaussian" and version <= 2:
        mean = pose_2d(source)
        if version == 0:
            matrix(source)
        else:
            source.take("6f" if version == 1 else "6d")
    elif name == "CPosePDFGaussianInf" and version == 0:
        mean = np.array(source.take("9d")[:3])
    else:
        raise Malformed(f"movements given as {name}")
    source.end(has_end)
    return mean


_READERS: dict[str, Callable[[Bytes, int], Scan | Odometry | Movement]] = {
    "CObservation2DRangeScan": _scan,
    "CObservationOdometry": _odometry,
    "CActionRobotMovement2D": _movement,
}
