"""The two markdown pages of a recording: what each entity shows, and what was run with which settings."""

import platform
from collections.abc import Iterable, Sequence

from pfslam_viz import __version__
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.viewer.entities import RUNS

RUN_ENTITIES: tuple[tuple[str, str], ...] = (
    ("world/{run}/map", "the filter's map: white is free, black occupied, grey-green unknown"),
    ("world/{run}/walls", "in 3-D: the occupied cells, raised (a drawing; the lidar sees one height)"),
    ("world/{run}/particles", "every particle, from yellow (no weight) to dark violet (the heaviest)"),
    ("world/{run}/headings", "where some of the particles look, in the same colours"),
    ("world/{run}/scan/hit", "light blue: lidar end points on a cell that the map already held occupied"),
    ("world/{run}/scan/miss", "magenta: lidar end points where the map held no wall"),
    ("world/{run}/robot", "{color} arrow: the best particle's pose"),
    ("world/{run}/trajectory/done", "{color}: the best particle at every scan, as it was estimated then"),
    ("world/{run}/trajectory/open", "{color}: its latest stretch"),
    ("world/{run}/mean", "{color} dot: the weighted mean of the particles"),
    ("world/{run}/covariance", "{color} ellipse: two standard deviations about the mean"),
    ("world/{run}/lineages", "pale violet: the ancestors that today's particles still have"),
    ("world/{run}/history", "violet: the whole trajectory of the particle that is best now"),
    ("world/{run}/hindsight", "violet: the whole trajectory as known at the end, at the last step"),
    ("world/{run}/correction", "magenta arrow: what scan matching moved the pose by, ten times as long"),
    ("world/{run}/degenerate", "magenta line: the direction in which this scan cannot place the robot"),
    ("world/{run}/closures", "violet: pairs of scans recognised as the same place"),
    ("world/{run}/texture", "the floor's colours as the camera saw them, over the map"),
    ("world/{run}/robot/camera", "the colour image of the moment, where the camera is"),
    ("camera/{run}/disparity", "the depth image of the moment: bright is near, black is no depth"),
)

SHARED_ENTITIES: tuple[tuple[str, str], ...] = (
    ("world/dead_reckoning/map", "the map that the same scans draw from odometry alone"),
    ("world/dead_reckoning/scan", "vermilion: the lidar's end points from the dead-reckoned pose"),
    ("world/dead_reckoning/robot", "vermilion arrow: the dead-reckoned pose"),
    ("world/dead_reckoning/trajectory/done", "vermilion: where odometry alone leads"),
    ("world/dead_reckoning/trajectory/open", "vermilion: its latest stretch"),
    ("world/truth/robot", "green arrow: the true pose"),
    ("world/truth/trajectory/done", "green, thin: where the robot truly went"),
    ("world/truth/trajectory/open", "green, thin: its latest stretch"),
)

CURVES: tuple[tuple[str, str], ...] = (
    ("plots/drift/{run}", "m between dead reckoning and the filter"),
    ("plots/heading_drift/{run}", "degrees between them"),
    ("plots/error/{run}", "m from the filter's pose, as it was estimated then, to the truth"),
    ("plots/error/dead_reckoning", "m from dead reckoning to the truth"),
    ("plots/n_eff/{run}", "effective number of particles, 1 / Σ w²"),
    ("plots/spread/{run}", "m: standard deviation of the particles' positions"),
    ("plots/correlation/{run}", "share of the end points that fall on occupied cells"),
    ("plots/score/{run}", "mean agreement of the matched scan with the map, 0 to 1"),
    ("plots/correction/{run}", "m that scan matching moved the pose"),
    ("plots/lineages/{run}", "distinct ancestors since all particles last shared one"),
)

INTRODUCTION = (
    "Drag the timeline at the bottom, or press the space bar to play. `step` counts scans; `time` is seconds since the"
    " first one. **Compare** shows what the wheels and the gyro alone believe (dead reckoning, vermilion) beside what"
    " the particle filter makes of it ({runs}), on the same piece of floor. The truth, where it is known, is green."
    " **Filter** follows the robot and its particles."
)


def help_page(runs: Sequence[str], logged: Iterable[str] | None) -> str:
    """What each entity in ``logged`` shows (None: all there can be), for the given runs."""
    known = None if logged is None else set(logged)
    colors = [color.name for color in RUNS[: len(runs)]]
    named = colors[0] if len(runs) == 1 else ", ".join(f"{r} {c}" for r, c in zip(runs, colors, strict=True))
    lines = ["# What you see", "", INTRODUCTION.format(runs=named), ""]
    for run, color in zip(runs, colors, strict=True):
        title = "Particle filter" if len(runs) == 1 else f"`{run}`"
        lines += _table(title, [(p.format(run=run), what.format(color=color)) for p, what in RUN_ENTITIES], known)
    lines += _table("Dead reckoning and truth", list(SHARED_ENTITIES), known)
    curves = [(path.format(run=run), what) for path, what in CURVES for run in runs]
    lines += _table("Curves", list(dict.fromkeys(curves)), known)
    return "\n".join(lines)


def _table(title: str, rows: list[tuple[str, str]], known: set[str] | None) -> list[str]:
    kept = [f"| `/{path}` | {what} |" for path, what in rows if known is None or path in known]
    return [f"## {title}", "", "| entity | shows |", "| --- | --- |", *kept, ""] if kept else []


def about_page(recording: Recording, configs: Sequence[Config], left_out: Sequence[str] = ()) -> str:
    """The recording, the configurations, what was left out, and the versions."""
    import numpy
    import rerun

    lidar, frames = recording.lidar, recording.frames
    camera = "none" if frames is None else f"{sum(path is not None for path in frames.color_paths):,} colour frames"
    lines = [
        f"# {recording.name}",
        "",
        "| recording | |",
        "| --- | --- |",
        f"| format | {recording.format} |",
        f"| scans | {len(recording):,} of {recording.ranges.shape[1]:,} beams |",
        f"| span | {recording.duration:.1f} s |",
        f"| lidar | {lidar.range_min:g} to {lidar.range_max:g} m |",
        f"| camera | {camera} |",
        f"| truth | {'known' if recording.truth is not None else 'unknown'} |",
        "",
    ]
    if recording.notes:
        lines += ["## Notes", "", *(f"- {note}" for note in recording.notes), ""]
    for config in configs:
        settings = _flat(config.model_dump(exclude={"name"}))
        lines += [f"## Configuration `{config.name}`", "", "| key | value |", "| --- | --- |"]
        lines += [*(f"| {key} | {value} |" for key, value in settings), ""]
    if left_out:
        lines += ["## Left out of this recording", "", *(f"- {phrase}" for phrase in left_out), ""]
    python = platform.python_version()
    lines += [
        "## Versions",
        "",
        f"pfslam-viz {__version__}, rerun {rerun.__version__}, NumPy {numpy.__version__}, Python {python}",
    ]
    return "\n".join(lines)


def _flat(values: dict[str, object], prefix: str = "") -> list[tuple[str, str]]:
    out: list[tuple[str, str]] = []
    for key, value in values.items():
        if isinstance(value, dict):
            out += _flat(value, f"{prefix}{key}.")
        else:
            out.append((f"{prefix}{key}", f"{value:g}" if isinstance(value, float) else str(value)))
    return out
