"""One cell of a study: one recording under one configuration, which has the seed, run and scored.

``evaluate`` runs a cell a seed; ``sweep`` runs many, on many machines. Both run them here.
"""

from collections.abc import Callable

import numpy as np

from pfslam_viz.compiling.compile import compile_all
from pfslam_viz.compiling.needed import needed
from pfslam_viz.config import Config
from pfslam_viz.evaluation.map_quality import map_quality
from pfslam_viz.evaluation.metrics import finite, scores, speed
from pfslam_viz.evaluation.report import Scores
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result

WARM_UP = 3  # scans that are run first, so that no time includes the compiling of kernels


def seeded(config: Config, seed: int) -> Config:
    """The configuration with another seed."""
    return config.model_copy(update={"seed": seed})


def warm_up(recording: Recording, config: Config) -> None:
    """Compile the kernels that the configuration needs, or load them from the cache, and run a few scans.

    These load whatever else is loaded at first.
    """
    compile_all(needed([config]))
    for _ in Replay(recording.select(0, WARM_UP), config, texture=False):
        pass


def run_cell(
    recording: Recording,
    config: Config,
    on_scan: Callable[[], object] = lambda: None,
    threads: int | None = None,
) -> tuple[Result, Scores]:
    """Replay ``recording`` under ``config`` and score it; ``on_scan`` is called after every scan.

    The floor texture is left out: it does not change an estimate, and its time is not the filter's. ``threads`` as in
    :class:`~pfslam_viz.replay.Replay`. Raises PfslamError where the run comes out empty.
    """
    replay = Replay(recording, config, texture=False, threads=threads)
    n_eff = []
    for step in replay:
        n_eff.append(step.estimate.n_eff)
        on_scan()
    result = replay.result()
    result.require_map()
    return result, score(result) | {"filter": _filter(result, np.array(n_eff))}


def score(result: Result) -> Scores:
    """One run: against truth and relations where known, the map's quality always, and the time it took."""
    poses = result.estimate
    scored: Scores = finite(scores(result.recording, result.stamps, poses, result.truth))
    scored["map"] = finite(map_quality(result.recording, poses, result.grid).as_dict())
    scored["map"]["resamplings"] = result.resamplings
    took = finite(speed(result))
    scored["speed"] = {key: took[key] for key in ("total_s", "ms_per_scan", "times_real_time")}
    return scored


def score_dead_reckoning(result: Result) -> Scores:
    """The same for odometry alone, which takes no time worth telling."""
    poses = result.dead_reckoning
    scored: Scores = finite(scores(result.recording, result.stamps, poses, result.truth))
    scored["map"] = finite(map_quality(result.recording, poses, result.dead_reckoning_grid).as_dict())
    return scored


def _filter(result: Result, n_eff: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> dict[str, float | int | None]:
    """How the particles fared: N_eff (30) over the scans, and scans that had no correlation with the map."""
    return {
        "n_eff_mean": float(n_eff.mean()) if len(n_eff) else None,
        "n_eff_min": float(n_eff.min()) if len(n_eff) else None,
        "uninformative": result.uninformative,
    }
