"""About how long a sweep will take, from a few scans of every configuration."""

from collections.abc import Mapping, Sequence
from time import perf_counter

from pfslam_viz.evaluation.cell import warm_up
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay
from pfslam_viz.sweep.plan import Cell

PROBE_SECONDS = 1.0  # for all probes together
FEWEST_SCANS = 10


def estimate_seconds(cells: Sequence[Cell], recordings: Mapping[str, Recording], workers: int) -> float:
    """Seconds for these cells on so many workers.

    Every configuration is run over the first scans of one recording, in this process, which also compiles its kernels.
    What a filter does after the last scan is not known beforehand, nor is what scoring takes: it is about as long.
    """
    variants = {id(cell.variant): cell for cell in cells}
    share = PROBE_SECONDS / max(len(variants), 1)
    pace = {key: _seconds_per_scan(recordings[cell.recording], cell, share) for key, cell in variants.items()}
    total = sum(len(recordings[cell.recording]) * pace[id(cell.variant)] for cell in cells)
    return total / max(min(workers, len(cells)), 1)


def _seconds_per_scan(recording: Recording, cell: Cell, share: float) -> float:
    scans, started = 0, perf_counter()
    try:
        warm_up(recording, cell.config)
        started = perf_counter()
        for step in Replay(recording, cell.config, texture=False, threads=1):
            scans = step.index + 1
            if scans >= FEWEST_SCANS and perf_counter() - started > share:
                break
    except Exception:  # it will fail as a cell, too, and be said there
        return 0.0
    return (perf_counter() - started) / max(scans, 1)
