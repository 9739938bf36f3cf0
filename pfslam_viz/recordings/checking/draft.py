"""A recording while it is checked: what has been found, and its values as mended so far."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.recordings.findings import Finding, Severity
from pfslam_viz.recordings.recording import Recording

Array = NDArray[np.float64]


@dataclass(slots=True)
class Draft:
    """``recording`` as mended so far, and the ``findings`` so far."""

    recording: Recording
    findings: list[Finding] = field(default_factory=list)
    _reckoned: tuple[Recording, Array] | None = None

    def add(self, severity: Severity, what: str, message: str, advice: str = "", scan: int | None = None) -> None:
        """Add a finding."""
        self.findings.append(Finding(severity, what, message, advice, scan))

    def mend(self, **changes: object) -> None:
        """Change fields of the recording."""
        self.recording = replace(self.recording, **changes)  # type: ignore[arg-type]

    @property
    def poses(self) -> Array:
        """Dead reckoning (n, 3) by the odometry as mended so far."""
        if self._reckoned is None or self._reckoned[0] is not self.recording:
            self._reckoned = self.recording, self.recording.dead_reckoning()
        return self._reckoned[1]

    @property
    def hopeless(self) -> bool:
        """Whether something wrong was found, so that what else is found may only follow from it."""
        return any(finding.severity == "wrong" for finding in self.findings)

    def intervals(self) -> Array:
        """Seconds (n - 1,) between scans, at least the median: stamps of logs are rougher than the scans."""
        gaps = np.diff(self.recording.stamps)
        intervals: Array = np.maximum(gaps, np.median(gaps)) if len(gaps) else gaps
        return intervals
