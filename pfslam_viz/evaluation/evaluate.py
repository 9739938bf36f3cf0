"""Runs configurations over a recording, with several seeds each, and scores every run."""

from collections.abc import Callable, Sequence

from pfslam_viz.config import Config, load_config
from pfslam_viz.evaluation.map_quality import map_quality
from pfslam_viz.evaluation.metrics import finite, scores, speed
from pfslam_viz.evaluation.report import Method, Report, Run, Scores
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Replay, Result

OnProgress = Callable[[str, int, int], None]

WARM_UP = 3  # scans that are run first, so that no time includes the compiling of kernels


def evaluate(
    recording: Recording,
    configs: Sequence[Config],
    seeds: Sequence[int],
    on_progress: OnProgress | None = None,
    paper: bool = True,
) -> Report:
    """Replay ``recording`` under every configuration and seed, with dead reckoning beside it.

    With ``paper``, the paper's filter runs too unless it is among ``configs``. The floor texture is left out: it does
    not change an estimate, and its time is not the filter's. ``on_progress(what, scans done, scans in all)`` is
    called after every scan.
    """
    wanted = [*configs]
    if paper and all(config.name != "paper" for config in wanted):
        wanted.append(load_config("paper"))
    total = len(wanted) * len(seeds) * len(recording)
    done = 0
    methods: list[Method] = []
    dead_reckoning: Method | None = None
    for config in wanted:
        for _ in Replay(recording.select(0, WARM_UP), config, texture=False):
            pass
        runs = []
        for seed in seeds:
            replay = Replay(recording, config.model_copy(update={"seed": seed}), texture=False)
            for _ in replay:
                done += 1
                if on_progress is not None:
                    on_progress(f"{config.name}, seed {seed}", done, total)
            result = replay.result()
            result.require_map()
            runs.append(Run(seed, score(result)))
            if dead_reckoning is None:
                dead_reckoning = Method("dead reckoning", None, (Run(None, score_dead_reckoning(result)),))
        methods.append(Method(config.name, config, tuple(runs)))
    if dead_reckoning is not None:
        methods.insert(0, dead_reckoning)
    return Report(recording.name, recording.format, len(recording), recording.duration, tuple(methods))


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
