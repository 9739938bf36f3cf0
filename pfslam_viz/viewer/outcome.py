"""What came of a run, as a table for the page about the recording: errors, gap, path, times and what happened."""

from collections.abc import Iterator, Mapping

from pfslam_viz import geometry
from pfslam_viz.evaluation.map_quality import end_to_start_gap
from pfslam_viz.evaluation.relations import relation_errors
from pfslam_viz.evaluation.trajectory_error import trajectory_error
from pfslam_viz.replay import Result

Row = tuple[str, str, str]  # name, the filter's value, dead reckoning's


def outcome(results: Mapping[str, Result]) -> list[str]:
    """Lines of markdown: a column for each run, by name, and dead reckoning's. None for runs without a scan."""
    columns = {name: list(_rows(result)) for name, result in results.items() if len(result.stamps)}
    if not columns:
        return []
    first = next(iter(columns.values()))
    names = [name for name, _, _ in first]
    values = {run: {name: value for name, value, _ in rows} for run, rows in columns.items()}
    lines = [
        "## Result",
        "",
        f"| | {' | '.join(columns)} | dead reckoning |",
        "| --- |" + " --- |" * (len(columns) + 1),
    ]
    for name, (_, _, reckoned) in zip(names, first, strict=True):
        cells = [values[run].get(name, "") for run in columns]
        lines.append(f"| {name} | {' | '.join(cells)} | {reckoned} |")
    return [*lines, ""]


def _rows(result: Result) -> Iterator[Row]:
    """The filter's values are those of the trajectory as known at the end, except where it says so."""
    n, paths = len(result.stamps), (result.estimate, result.dead_reckoning)
    if result.truth is not None:
        ours, online, theirs = (trajectory_error(result.truth, p) for p in (result.estimate, result.online, paths[1]))
        yield (
            "error, rmse",
            _error(ours.position_rmse, ours.heading_rmse),
            _error(theirs.position_rmse, theirs.heading_rmse),
        )
        yield (
            "error, worst",
            _error(ours.position_max, ours.heading_max),
            _error(theirs.position_max, theirs.heading_max),
        )
        yield "error on the way, rmse", _error(online.position_rmse, online.heading_rmse), ""
    if result.recording.relations is not None:
        found = [relation_errors(result.recording.relations, result.stamps, p) for p in paths]
        words = ["" if e is None else _error(e.translation.mean, e.rotation.mean) for e in found]
        yield "error of relations, mean", words[0], words[1]
    gaps, lengths = ([f"{f(p):.2f} m" for p in paths] for f in (end_to_start_gap, geometry.path_length))
    yield "end-to-start gap", gaps[0], gaps[1]
    yield "path length", lengths[0], lengths[1]
    seconds = sum(float(values.sum()) for values in result.seconds.values()) + result.finish_seconds
    recorded = float(result.stamps[-1] - result.stamps[0])
    faster = f", {recorded / seconds:.1f}x real time" if seconds > 0 else ""
    yield "time", f"{seconds:.1f} s{faster}", ""
    of_all = f" of {len(result.recording):,}, interrupted" if result.interrupted else ""
    yield "scans", f"{n:,}{of_all}", ""
    yield "resampled", f"after {result.resamplings:,} scans", ""
    yield "no match with the map", f"{result.uninformative:,} scans", ""
    yield "loops closed", f"{len(result.closures):,}", ""
    if result.kept is not None:
        yield "kept", f"{result.kept.trajectory} trajectory ({result.kept.sigmas:+.1f} sigmas)", ""
        if doubted := result.kept.doubted:
            yield "against odometry that is right elsewhere", f"at {len(doubted):,} of the key scans", ""


def _error(meters: float, degrees: float) -> str:
    return f"{meters:.3f} m, {degrees:.2f}°"
