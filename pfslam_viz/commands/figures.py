"""``pfslam-viz figures``: the paper's figures of a recording."""

from pathlib import Path

from pfslam_viz import console
from pfslam_viz.commands.choices import ConfigChoice, RecordingChoice
from pfslam_viz.commands.progress import kernels, replay_progress
from pfslam_viz.commands.replay import read, tell_doubts
from pfslam_viz.figures import require_matplotlib, write_figures
from pfslam_viz.files import check_writable
from pfslam_viz.outputs import check_figures


def run(chosen: RecordingChoice, config_choice: ConfigChoice, out: Path, every: int, quiet: bool) -> None:
    """Run the filter once and write the pictures into the folder ``out``."""
    require_matplotlib()
    check_writable(out, folder=True)
    check_figures(out)
    config = config_choice.load()  # a mistake in it shows before a long load
    recording = read(chosen, quiet)
    with kernels([config], recording, quiet=quiet), replay_progress(recording, quiet, "figures") as progress:
        write_figures(recording, config, out, every, on_step=lambda *_: progress.advance())
    if not quiet:
        console.results().print(f"{out / 'index.html'} shows them all", markup=False, soft_wrap=True)
    tell_doubts(recording)
