"""The tables at the end of a run: how far each trajectory went and how good it is, and what the run took."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from pfslam_viz import geometry
from pfslam_viz.replay import PHASES, Result
from pfslam_viz.slam.protocol import Kept

COMPILED = 0.05  # s that are worth telling


def summary(
    result: Result,
    seconds: float,
    log_seconds: float = 0.0,
    file: Path | None = None,
    left_out: Sequence[str] = (),
) -> Group:
    """What is shown at the end of a run: the two trajectories side by side, then the run itself.

    ``seconds`` the whole run took but for compiling, ``log_seconds`` of them for sending it to Rerun; ``file`` is the
    .rrd that was written; ``left_out`` says what is not in it, a phrase each.
    """
    config = result.config
    title = f"{result.recording.name}, {config.name}: {len(result.stamps):,} scans, {config.particles:,} particles"
    paths = _trajectories(f"{title}, seed {config.seed}", {"particle filter": result})
    run = Table(box=None, show_header=False, pad_edge=False)
    run.add_column(style="dim")
    run.add_column()
    for name, text in _run(result, seconds, log_seconds):
        run.add_row(name, text)
    if result.interrupted:
        run.add_row("interrupted", f"after {len(result.stamps):,} of {len(result.recording):,} scans")
    if file is not None:
        run.add_row("recording", f"{file.name}, {file.stat().st_size / 1e6:.1f} MB")
    for phrase in left_out:
        run.add_row("holds", phrase)
    return Group(paths, run)


def comparison(results: Sequence[Result], seconds: float, file: Path | None = None) -> Group:
    """The same for several runs over one recording, a column for each; ``seconds`` they took together."""
    first = results[0]
    title = f"{first.recording.name}: {len(first.stamps):,} of {len(first.recording):,} scans, {seconds:.1f} s in all"
    parts: list[RenderableType] = [_trajectories(title, {result.config.name: result for result in results})]
    if file is not None:
        parts.append(Text(f"recording  {file.name}, {file.stat().st_size / 1e6:.1f} MB"))
    return Group(*parts)


def _trajectories(title: str, results: Mapping[str, Result]) -> Table:
    """A column for each result, by name, and dead reckoning's."""
    table = Table(title=Text(title), title_justify="left")
    table.add_column()
    for name in results:
        table.add_column(Text(name), justify="right")
    table.add_column("dead reckoning", justify="right", style="dim")
    for rows in zip(*(_accuracy(result) for result in results.values()), strict=True):
        name, _, reckoned = rows[0]
        table.add_row(name, *(estimated for _, estimated, _ in rows), reckoned)
    return table


def _accuracy(result: Result) -> Iterator[tuple[str, str, str]]:
    """Rows about the two trajectories: name, the filter's value, dead reckoning's."""
    from pfslam_viz.evaluation.relations import relation_errors
    from pfslam_viz.evaluation.trajectory_error import trajectory_error

    paths = result.estimate, result.dead_reckoning
    if len(result.stamps) == 0:
        return
    length, gap = ([f"{f(p):.2f} m" for p in paths] for f in (geometry.path_length, _gap))
    yield "path length", length[0], length[1]
    yield "end-to-start gap", gap[0], gap[1]
    if result.truth is not None:
        errors = [trajectory_error(result.truth, p) for p in paths]
        rmse = [f"{e.position_rmse:.3f} m, {e.heading_rmse:.2f}°" for e in errors]
        worst = [f"{e.position_max:.3f} m, {e.heading_max:.2f}°" for e in errors]
        yield "error against truth, rmse", rmse[0], rmse[1]
        yield "error against truth, worst", worst[0], worst[1]
    if result.recording.relations is not None:
        relations = [relation_errors(result.recording.relations, result.stamps, p) for p in paths]
        mean = [
            "no relation in these scans" if r is None else f"{r.translation.mean:.3f} m, {r.rotation.mean:.2f}°"
            for r in relations
        ]
        yield "error of relations, mean", mean[0], mean[1]


def _gap(poses: geometry.Array) -> float:
    x, y = poses[-1, :2] - poses[0, :2]
    return math.hypot(x, y)


def _run(result: Result, seconds: float, log_seconds: float) -> Iterator[tuple[str, str]]:
    """Rows about the run: name and value."""
    n = len(result.stamps)
    if n == 0:
        return
    recorded = float(result.stamps[-1] - result.stamps[0])
    yield "time", f"{seconds:.1f} s, {n / seconds:,.0f} scans/s, {recorded / seconds:.1f}x real time"
    spent = {phase.replace("_", " "): float(result.seconds[phase].sum()) for phase in PHASES} | {"log": log_seconds}
    yield "ms a scan", ", ".join(f"{name} {1e3 * total / n:.2f}" for name, total in spent.items() if total > 0)
    if result.compile_seconds >= COMPILED:
        yield "compiling", f"{result.compile_seconds:.1f} s more, in this run only: not in the times above"
    yield "resampled", f"after {result.resamplings:,} of {n:,} scans"
    if result.kept is not None:
        yield "kept", _kept(result.kept)
        if doubted := result.kept.doubted:
            scans = f"scan {doubted[0]:,}" if len(doubted) == 1 else f"{len(doubted):,} scans, first at {doubted[0]:,}"
            yield "doubtful", f"at {scans}: odometry that is right elsewhere says otherwise, one of the two is wrong"
    if result.camera is not None:
        yield "camera", result.camera.text
    if result.texture is not None and result.texture.tilted:
        yield "floor", result.texture.tilted_text
    if result.uninformative:
        yield "no match", f"{result.uninformative:,} of {n:,} scans had no correlation with the map"


def _kept(kept: Kept) -> str:
    """Which trajectory was kept, and why."""
    if kept.trajectory == "settled" and kept.sigmas < 0.0:
        return f"settled: odometry speaks for it, and the scans not clearly against it ({kept.sigmas:.1f} sigmas)"
    if kept.trajectory == "settled":
        return f"settled: the scans speak for it by {kept.sigmas:.1f} sigmas"
    return "online: the scans do not speak for the settled trajectory"
