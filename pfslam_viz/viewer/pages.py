"""The two markdown pages of a recording: what each entity shows, and what was run with which settings."""

import platform
from collections.abc import Iterable, Mapping, Sequence

from pfslam_viz import __version__
from pfslam_viz.config import Config
from pfslam_viz.recordings.findings import Severity, of
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.viewer.colors import COLOR_NAMES, FILTER, Color
from pfslam_viz.viewer.entities import ENTITIES, Entity, Kind
from pfslam_viz.viewer.outcome import outcome

INTRODUCTION = (
    "Drag the timeline at the bottom, or press the space bar to play. `step` counts scans; `time` is seconds since the"
    " first one. **Compare** shows what the wheels and the gyro alone believe (dead reckoning, vermilion) beside what"
    " the particle filter makes of it ({runs}), on the same piece of floor. The truth, where it is known, is green."
    " **Filter** follows the robot and its particles. **Error**, where the truth is known, colours the trajectories by"
    " their distance from it. **Events** lists what happened: click an event's `#`, at its left, to go there. In the"
    " panel at the left (Ctrl+Shift+B) each entity has an eye, which hides it."
)

PLOTTED = (Kind.CURVE, Kind.MARKS)
SHOWN: tuple[tuple[Severity, str], ...] = (("wrong", "Wrong"), ("doubtful", "Doubtful"))


def help_page(colors: Mapping[str, Color], logged: Iterable[str] | None) -> str:
    """What each entity in ``logged`` shows (None: all there can be), for runs of these names and colours."""
    known = None if logged is None else set(logged)
    runs, named = list(colors), _named(colors)
    lines = ["# What you see", "", INTRODUCTION.format(runs=named), ""]
    rows = [row for row in ENTITIES if row.kind not in PLOTTED]
    own, shared = [r for r in rows if r.owner == "{run}"], [r for r in rows if r.owner != "{run}"]
    for run, color in colors.items():
        title = "Particle filter" if len(runs) == 1 else f"`{run}`"
        lines += _list(title, [line for row in own for line in _lines(row, run, color)], known)
    lines += _list("Dead reckoning and truth", [line for row in shared for line in _lines(row, "", FILTER)], known)
    curves = [row for row in ENTITIES if row.kind in PLOTTED]
    of_curves = [line for row in curves for run, color in colors.items() for line in _lines(row, run, color)]
    lines += _list("Curves", list(dict.fromkeys(of_curves)), known)
    return "\n".join(lines)


def _named(colors: Mapping[str, Color]) -> str:
    """The one run's colour, or each run with its colour."""
    names = [COLOR_NAMES[color] for color in colors.values()]
    return names[0] if len(names) == 1 else ", ".join(f"{r} {c}" for r, c in zip(colors, names, strict=True))


def legend_page(colors: Mapping[str, Color], recording: Recording) -> str:
    """What the colours beside the maps mean, in few words, and what to look for."""
    lines = [
        "**Look for** walls: dead reckoning doubles and bends them.",
        "",
        "- white free, black wall, grey-green unknown, pale between rays",
        "- vermilion: dead reckoning; arrow at the edge: so far out of view",
        *([f"- {_named(colors)}: the filter, as estimated then"] if len(colors) == 1 else []),
        *(f"- {COLOR_NAMES[color]}: {run}" for run, color in colors.items() if len(colors) > 1),
        *(["- thin green: the truth"] if recording.truth is not None else []),
        "- the lidar now: light blue on a known wall, magenta on none",
        "- dots on the way: magenta resampled, crimson doubtful",
        "- violet, last step: in hindsight, closed loops",
        "- ellipse: the robot, by 2 sigmas",
    ]
    return "\n".join(lines)


def filter_legend_page(colors: Mapping[str, Color]) -> str:
    """The same beside the curves of the tab Filter."""
    lines = [
        *(f"- {COLOR_NAMES[color]}: {run if len(colors) > 1 else 'the filter'}" for run, color in colors.items()),
        "- magenta: threshold, resamplings",
        "- particles: yellow light, green average, dark violet heavy",
        "- pale violet: their ancestors",
        "- magenta arrow: correction, x 10",
    ]
    return "\n".join(lines)


def _lines(row: Entity, run: str, run_color: Color) -> list[tuple[str, str]]:
    """Path and help of what a row logs; none of what is not visible."""
    if not row.help:
        return []
    color = row.rgb(run_color)
    text = row.help.format(color=COLOR_NAMES[color] if color else "")
    if row.kind is not Kind.TRAIL:
        return [(row.path(run), text)]
    done, *latest = row.visible(run)
    return [(done, text), *((path, f"{text.split(':')[0]}: its latest stretch") for path in latest)]


def _list(title: str, rows: list[tuple[str, str]], known: set[str] | None) -> list[str]:
    kept = [f"- `/{path}`: {what}" for path, what in rows if known is None or path in known]
    return [f"## {title}", "", *kept, ""] if kept else []


def about_page(
    recording: Recording,
    configs: Sequence[Config],
    left_out: Sequence[str] = (),
    results: Mapping[str, Result] | None = None,
) -> str:
    """The recording, what came of the runs, the configurations, how much of it all is drawn, and the versions."""
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
    lines += outcome(results or {})
    for severity, title in SHOWN:
        if found := of(recording.findings, severity):
            lines += [f"## {title}", "", *(f"- {finding.line}" for finding in found), ""]
    if recording.notes:
        lines += ["## Notes", "", *(f"- {note}" for note in recording.notes), ""]
    if frames is not None and any(config.texture.enabled for config in configs):
        from pfslam_viz.texture.floor_camera import find_camera

        lines += ["## Camera", ""]
        cameras = [(c.name, find_camera(frames, c.texture.camera)) for c in configs if c.texture.enabled]
        lines += [f"- `{name}`: {camera.text}" for name, camera in cameras]
        lines += dict.fromkeys(f"- {camera.note}" for _, camera in cameras if camera.note)
        textures = [(name, result.texture) for name, result in (results or {}).items()]
        lines += [f"- `{name}`: floor {t.tilted_text}" for name, t in textures if t is not None and t.tilted]
        lines += [""]
    for config in configs:
        settings = _flat(config.model_dump(exclude={"name"}))
        lines += [f"## Configuration `{config.name}`", "", "| key | value |", "| --- | --- |"]
        lines += [*(f"| {key} | {value} |" for key, value in settings), ""]
    if left_out:
        lines += ["## How much of it is drawn", "", *(f"- {phrase}" for phrase in left_out), ""]
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
