"""Which recording, how it is read, and which of its scans: what a user chose, as a value."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pfslam_viz.errors import InputError

if TYPE_CHECKING:
    from pfslam_viz.recordings.recording import Recording


@dataclass(frozen=True, slots=True)
class RecordingChoice:
    """RECORDING, how it is read, the scans ``start:stop:stride``, and ``--force``."""

    name: str
    data: Path | None = None
    robot: str | None = None
    start: int = 0
    stop: int | None = None
    stride: int = 1
    scan_topic: str | None = None
    odom_topic: str | None = None
    base_frame: str | None = None
    force: bool = False

    def require(self) -> None:
        """Raise InputError where there is no such recording. Reads nothing, and leaves the demo to be made later."""
        from pfslam_viz.recordings.catalog import DEMO, find

        if self.name != DEMO:
            find(self.name, self.data)

    def load(self) -> "Recording":
        """The recording, cut to the chosen scans.

        Raises InputError when there is none, when it is wrong (unless forced), or no scan is left.
        """
        from pfslam_viz.recordings.catalog import load_recording

        recording = load_recording(
            self.name,
            self.data,
            self.robot,
            scan_topic=self.scan_topic,
            odom_topic=self.odom_topic,
            base_frame=self.base_frame,
            force=self.force,
        )
        if (self.start, self.stop, self.stride) == (0, None, 1):
            return recording
        selected = recording.select(self.start, self.stop, self.stride) if self.start < len(recording) else None
        if selected is None or len(selected) == 0:
            raise InputError(
                f"no scan is left of {self.name}: it has {len(recording)}, and --start {self.start}"
                f"{'' if self.stop is None else f' --stop {self.stop}'} was asked for"
            )
        return selected
