"""The unit of a sensor's stamps, before anything is integrated over them."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.checking.clocks import UNITS
from pfslam_viz.recordings.findings import Finding

Array = NDArray[np.float64]

SLOWEST_GYRO = 0.5  # s between readings; nobody integrates a yaw rate that is read less often


def gyro_unit(stamps: Array) -> float:
    """The seconds in the unit of a gyro's sorted ``stamps`` (n,): 1, or that of ms, µs or ns."""
    if len(stamps) < 5:
        return 1.0
    interval = float(np.median(np.diff(stamps)))
    return next((factor for factor in (1.0, *UNITS) if interval * factor <= SLOWEST_GYRO), 1.0)


def unit_like(stamps: Array, start: float, end: float) -> float:
    """The seconds in the unit of ``stamps`` (n,) that, so scaled, lie in the time from ``start`` to ``end`` s.

    1 where they overlap it as they are, by half of their span or more, or in no unit.
    """
    finite = stamps[np.isfinite(stamps)]
    if len(finite) < 5:
        return 1.0
    low, high = np.percentile(finite, (1, 99))
    shares = {f: (min(f * high, end) - max(f * low, start)) / max(f * (high - low), 1e-12) for f in (1.0, *UNITS)}
    best = max(shares, key=lambda factor: shares[factor])
    return best if shares[best] >= 0.5 > shares[1.0] else 1.0


def converted(units: Mapping[str, float]) -> tuple[Finding, ...]:
    """A finding for every unit that some sensors' stamps had been written in; ``units`` in s, by sensor."""
    return tuple(
        Finding("note", f"stamps_in_{name}", f"{', '.join(named)}: stamps in {name}; converted to seconds")
        for factor, name in UNITS.items()
        if (named := [sensor for sensor, unit in units.items() if unit == factor])
    )
