"""Runs configurations over a recording, with several seeds each, and scores every run."""

from collections.abc import Callable, Sequence

from pfslam_viz.config import Config, load_config
from pfslam_viz.evaluation.cell import run_cell, score_dead_reckoning, seeded, warm_up
from pfslam_viz.evaluation.report import Method, Report, Run
from pfslam_viz.recordings.recording import Recording

OnProgress = Callable[[str, int, int], None]


def evaluate(
    recording: Recording,
    configs: Sequence[Config],
    seeds: Sequence[int],
    on_progress: OnProgress | None = None,
    paper: bool = True,
) -> Report:
    """Run ``recording`` under every configuration and seed, a cell each, with dead reckoning beside it.

    With ``paper``, the paper's filter runs too unless it is among ``configs``. ``on_progress(what, scans done, scans in
    all)`` is called after every scan.
    """
    wanted = [*configs]
    if paper and all(config.name != "paper" for config in wanted):
        wanted.append(load_config("paper"))
    total = len(wanted) * len(seeds) * len(recording)
    done = 0
    methods: list[Method] = []
    dead_reckoning: Method | None = None
    for config in wanted:
        warm_up(recording, config)
        runs = []
        for seed in seeds:

            def on_scan(what: str = f"{config.name}, seed {seed}") -> None:
                nonlocal done
                done += 1
                if on_progress is not None:
                    on_progress(what, done, total)

            result, scored = run_cell(recording, seeded(config, seed), on_scan)
            runs.append(Run(seed, scored))
            if dead_reckoning is None:
                dead_reckoning = Method("dead reckoning", None, (Run(None, score_dead_reckoning(result)),))
        methods.append(Method(config.name, config, tuple(runs)))
    if dead_reckoning is not None:
        methods.insert(0, dead_reckoning)
    return Report(recording.name, recording.format, len(recording), recording.duration, tuple(methods))
