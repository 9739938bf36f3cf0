"""What the recording's entities are called, how they are coloured, and the page that explains both.

Colours are told apart under protanopia, deuteranopia and tritanopia (a test simulates all three), and are of middle
lightness, so that they show on the white floor of a map, on black walls, and on the viewer's dark and light theme.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from pfslam_viz import __version__
from pfslam_viz.config import Config
from pfslam_viz.recordings.recording import Recording

Color = tuple[int, int, int]

DEAD_RECKONING: Color = (213, 94, 0)  # vermilion
FILTER: Color = (0, 114, 220)  # blue
TRUTH: Color = (0, 158, 115)  # bluish green
HIT: Color = (86, 196, 245)  # light blue
MISS: Color = (204, 40, 140)  # magenta
HINDSIGHT: Color = (120, 70, 200)  # violet
NEUTRAL: Color = (128, 128, 128)
RUNS: tuple[Color, ...] = (FILTER, (204, 40, 140), (230, 159, 0), (120, 70, 200), (86, 180, 233), (100, 100, 40))
"""One colour for each run that is compared."""

WEIGHT_RAMP: tuple[Color, ...] = (
    (253, 231, 37),
    (181, 222, 43),
    (110, 206, 88),
    (53, 183, 121),
    (31, 158, 137),
    (38, 130, 142),
    (49, 104, 142),
    (62, 73, 137),
    (72, 40, 120),
    (68, 1, 84),
)
"""Viridis in ten levels, from no weight (yellow) to the heaviest particle (dark violet)."""

MAP_Z, TEXTURE_Z, LIDAR_Z, PARTICLE_Z, TRAIL_Z, POSE_Z = 0.0, 0.01, 0.03, 0.05, 0.06, 0.09
"""Heights (m) that keep the layers of a flat scene from hiding each other."""

HELP = "help"
ABOUT = "about"


@dataclass(frozen=True, slots=True)
class Entities:
    """Entity paths of one run. ``run`` is ``filter``, or the run's name where several share a recording."""

    run: str = "filter"

    @property
    def root(self) -> str:
        """Everything that the run draws in space."""
        return f"world/{self.run}"

    def filter(self, name: str) -> str:
        """Something that the filter knows, such as ``particles``."""
        return f"{self.root}/{name}"

    def dead_reckoning(self, name: str) -> str:
        """Something that odometry alone gives."""
        return f"world/dead_reckoning/{name}"

    def truth(self, name: str) -> str:
        """Something that only a simulation or a reference system knows."""
        return f"world/truth/{name}"

    def plot(self, name: str) -> str:
        """The run's curve in the plot ``name``."""
        return f"plots/{name}/{self.run}"

    def shared_plot(self, name: str, curve: str) -> str:
        """A curve that belongs to no run."""
        return f"plots/{name}/{curve}"

    @property
    def overview_camera(self) -> str:
        """The pinhole that looks down on the whole map; the same for every run."""
        return "world/overview"

    @property
    def follow(self) -> str:
        """The frame that moves with the robot and does not turn."""
        return self.filter("follow")

    @property
    def disparity_image(self) -> str:
        """The depth camera's image, coloured."""
        return f"camera/{self.run}/disparity"


PAGE: tuple[tuple[str, str, str], ...] = (
    # what it is called for the reader, its path below the run, what it shows
    ("map", "{run}/map", "the filter's occupancy grid: white is free, black occupied, grey-green unknown"),
    ("particles", "{run}/particles", "every particle, yellow (no weight) to dark violet (the heaviest)"),
    ("headings", "{run}/headings", "where some of the particles look, in the same colours"),
    ("hits", "{run}/scan/hit", "light blue: lidar end points on a cell the map already held occupied"),
    ("misses", "{run}/scan/miss", "magenta: lidar end points where the map held nothing"),
    ("trajectory", "{run}/trajectory/done", "blue: the best particle's pose at every scan, as it was estimated then"),
    ("", "{run}/trajectory/open", "its latest stretch (two entities keep seeking fast and the file small)"),
    ("robot", "{run}/robot", "blue: the best particle's pose now"),
    ("mean", "{run}/mean", "blue cross: the weighted mean of the particles"),
    ("covariance", "{run}/covariance", "blue ellipse: two standard deviations of the particles about their mean"),
    ("lineages", "{run}/lineages", "violet: the ancestors that today's particles still have, back in time"),
    ("history", "{run}/history", "violet: the whole trajectory of the particle that is best now"),
    ("correction", "{run}/correction", "magenta arrow: how far scan matching moved the pose, drawn ten times as long"),
    ("degenerate", "{run}/degenerate", "magenta line: the direction in which this scan cannot tell where it is"),
    ("loops", "{run}/closures", "violet: pairs of scans recognised as the same place"),
    ("hindsight", "{run}/hindsight", "violet: the whole trajectory as known at the end, shown at the last step"),
    ("texture", "{run}/texture", "the floor as the camera saw it, painted over the map"),
    ("camera", "{run}/robot/camera", "the colour image of the moment, where the camera is"),
    ("disparity", "@camera/{run}/disparity", "the depth camera's image: bright is near, black has no depth"),
    ("map", "dead_reckoning/map", "the map that the same scans draw from odometry alone"),
    ("trajectory", "dead_reckoning/trajectory/done", "vermilion: odometry alone"),
    ("", "dead_reckoning/trajectory/open", "its latest stretch"),
    ("scan", "dead_reckoning/scan", "vermilion: the lidar's end points from the dead-reckoned pose"),
    ("robot", "dead_reckoning/robot", "vermilion: the dead-reckoned pose"),
    ("trajectory", "truth/trajectory/done", "green: where the robot truly went"),
    ("", "truth/trajectory/open", "its latest stretch"),
    ("robot", "truth/robot", "green: the true pose"),
)

PLOTS: tuple[tuple[str, str], ...] = (
    ("plots/drift/{run}", "distance between dead reckoning and the filter, m"),
    ("plots/heading_drift/{run}", "angle between them, degrees"),
    ("plots/error/{run}", "distance of the filter's pose from the truth, m"),
    ("plots/error/dead_reckoning", "the same of dead reckoning"),
    ("plots/n_eff/{run}", "effective number of particles, 1 / Σ w²"),
    ("plots/spread/{run}", "standard deviation of the particles' positions, m"),
    ("plots/correlation/{run}", "share of the scan's end points that fall on occupied cells"),
    ("plots/score/{run}", "mean agreement of the matched scan with the map, 0 to 1"),
    ("plots/correction/{run}", "how far scan matching moved the pose, m"),
    ("plots/lineages/{run}", "distinct ancestors that the particles have had since they last shared one"),
)


def help_page(runs: Iterable[str], logged: Iterable[str] | None) -> str:
    """The markdown page that explains every entity in ``logged`` (None: all there can be), for the given runs."""
    known = None if logged is None else set(logged)
    lines = [
        "# What you see",
        "",
        "Drag the timeline at the bottom, or press space to play. `step` counts scans; `time` is seconds since the"
        " first one. Left is **dead reckoning** (vermilion), right the **particle filter** (blue); the **truth**,"
        " where it is known, is green. Both sides frame the same piece of floor.",
        "",
    ]
    for run in runs:
        table = [(t, *_resolve(path, run), what) for t, path, what in PAGE if "{run}" in path]
        lines += _table(run.replace("_", " "), table, known)
    shared = [(t, *_resolve(path, ""), what) for t, path, what in PAGE if "{run}" not in path]
    lines += _table("Dead reckoning and truth", shared, known)
    plots = [("", path.format(run=run), what) for path, what in PLOTS for run in runs]
    lines += _table("Curves", list(dict.fromkeys(plots)), known)
    return "\n".join(lines)


def _resolve(path: str, run: str) -> tuple[str]:
    return (path[1:].format(run=run) if path.startswith("@") else f"world/{path.format(run=run)}",)


def _table(title: str, rows: list[tuple[str, str, str]], known: set[str] | None) -> list[str]:
    kept = [f"| `/{path}` | {what} |" for _, path, what in rows if known is None or path in known]
    if not kept:
        return []
    return [f"## {title[:1].upper()}{title[1:]}", "", "| entity | shows |", "| --- | --- |", *kept, ""]


def about_page(recording: Recording, configs: Iterable[Config], notes: Iterable[str] = ()) -> str:
    """The markdown page with the recording, the configurations and the versions."""
    import platform

    import numpy
    import rerun

    frames = recording.frames
    lidar = recording.lidar
    lines = [
        f"# {recording.name}",
        "",
        "| recording | |",
        "| --- | --- |",
        f"| format | {recording.format} |",
        f"| scans | {len(recording):,} of {recording.ranges.shape[1]:,} beams |",
        f"| span | {recording.duration:.1f} s |",
        f"| lidar | {lidar.range_min:g} to {lidar.range_max:g} m |",
        f"| camera | {'none' if frames is None else f'{len(frames.color_stamps):,} colour frames'} |",
        f"| truth | {'known' if recording.truth is not None else 'unknown'} |",
        "",
    ]
    if recording.notes:
        lines += ["## Notes", "", *(f"- {note}" for note in recording.notes), ""]
    for config in configs:
        lines += [f"## Configuration `{config.name}`", "", "| key | value |", "| --- | --- |"]
        lines += [f"| {key} | {value} |" for key, value in _flatten(config.model_dump(exclude={"name"}))]
        lines.append("")
    left_out = list(notes)
    if left_out:
        lines += ["## Left out of this recording", "", *(f"- {note}" for note in left_out), ""]
    lines += [
        "## Versions",
        "",
        f"pfslam-viz {__version__}, rerun {rerun.__version__}, NumPy {numpy.__version__},"
        f" Python {platform.python_version()}",
    ]
    return "\n".join(lines)


def _flatten(values: dict[str, object], prefix: str = "") -> list[tuple[str, str]]:
    out: list[tuple[str, str]] = []
    for key, value in values.items():
        if isinstance(value, dict):
            out += _flatten(value, f"{prefix}{key}.")
        else:
            out.append((f"{prefix}{key}", f"{value:g}" if isinstance(value, float) else str(value)))
    return out
