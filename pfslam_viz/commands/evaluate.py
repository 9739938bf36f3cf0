"""``pfslam-viz evaluate``: run and score."""

from pfslam_viz import console
from pfslam_viz.commands.choices import ConfigChoice, RecordingChoice
from pfslam_viz.commands.progress import kernels, replay_progress
from pfslam_viz.commands.recordings import print_json
from pfslam_viz.commands.replay import read, tell_doubts
from pfslam_viz.evaluation.evaluate import evaluate


def run(
    chosen: RecordingChoice, config_choices: list[ConfigChoice], seeds: int, paper: bool, as_json: bool, quiet: bool
) -> None:
    """Score every configuration over ``seeds`` seeds, with the paper's filter beside them unless it is unwanted."""
    configs = [choice.load() for choice in config_choices]
    recording = read(chosen, quiet)
    with kernels(configs, quiet=quiet), replay_progress(recording, quiet, "evaluate") as bar:
        report = evaluate(recording, configs, range(seeds), on_progress=bar.show, paper=paper)
    if as_json:
        print_json(report.as_dict())
    else:
        console.results().print(report.table())
    tell_doubts(recording)
