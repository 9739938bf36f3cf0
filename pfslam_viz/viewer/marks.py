"""Events on the maps: dots where the robot was, and beside the newest one what happened there."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.contents import Spots
from pfslam_viz.viewer.entities import Entity
from pfslam_viz.viewer.events import DETAIL, DOUBT, Event

Array = NDArray[np.float64]

MOST_DETAILS = 150  # dots of the least important kind, if the robot goes straight on
CLOSEST = 0.5  # m between them
HELD = 40  # what share of a recording, 1 / HELD, the newest event's words stay
SHORTEST = 20  # scans that they stay at least


class Marks:
    """The marks of one run: :meth:`of` each of its events."""

    def __init__(self, scans: int, spacing: float) -> None:
        """For ``scans`` scans; the marks of least important events are ``spacing`` m from one to the next."""
        self._spacing, self._hold = spacing, max(scans // HELD, SHORTEST)
        self._until: int | None = None  # the scan at which the newest event's words end
        self._points: dict[str, list[Array]] = {}

    @classmethod
    def over(cls, recording: Recording) -> "Marks":
        """Spaced by how long the way is."""
        length = geometry.path_length(recording.dead_reckoning())
        return cls(len(recording), max(CLOSEST, float(length) / MOST_DETAILS))

    def of(self, event: Event, pose: Array, scan: int) -> Iterator[tuple[Entity, int, Spots]]:
        """What marks it, known at ``scan``, at the pose (3,) where it happened: entities, and what they show from when.

        What settled the run as a whole has no place, nor has the end of what lasted.
        """
        if event.level == DETAIL:
            row = entities.RESAMPLED_AT
        elif event.level == DOUBT:
            row = entities.DOUBTED_AT
        elif event.closes_loop:
            row = entities.CLOSED_AT
        else:
            return
        points = self._points.setdefault(row.template, [])
        if event.level == DETAIL and points and np.hypot(*(points[-1] - pose[:2])) < self._spacing:
            return
        points.append(np.array(pose[:2]))
        yield row, event.step, Spots(np.array(points, np.float32), row.z)
        if event.level != DETAIL:
            yield (
                entities.NEWEST,
                event.step,
                Spots(np.array(points[-1:], np.float32), entities.NEWEST.z, (event.text,)),
            )
            self._until = event.step + self._hold
            yield from self.expired(scan)

    def expired(self, scan: int) -> Iterator[tuple[Entity, int, Spots]]:
        """The end of the newest event's words, if that is due at ``scan``."""
        if self._until is not None and self._until <= scan:
            yield entities.NEWEST, self._until, Spots(np.zeros((0, 2), np.float32), entities.NEWEST.z)
            self._until = None
