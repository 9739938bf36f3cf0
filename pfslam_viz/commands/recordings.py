"""``pfslam-viz recordings``, ``info`` and ``fetch``: what there is, what is in it, and how to get it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.table import Table

from pfslam_viz import console, streams

COLUMNS = ("name", "format", "length", "sensors", "status", "size")


def run_list(data: Path | None, as_json: bool) -> None:
    """Print the recordings that have a name."""
    from pfslam_viz.recordings.catalog import list_recordings, recordings_dir

    entries = list_recordings(data)
    if as_json:
        print_json([asdict(entry) for entry in entries])
        return
    table = Table(box=None, pad_edge=False, title=f"in {data or recordings_dir()}", title_justify="left")
    for column in COLUMNS:
        table.add_column(column)
    for entry in entries:
        table.add_row(*(show(getattr(entry, column)) for column in COLUMNS))
    console.results().print(table)


def run_info(
    name: str, data: Path | None, robot: str | None, as_json: bool, verbose: bool = False, **options: str | None
) -> None:
    """Print what is inside one recording: a page, everything if ``verbose``, or everything as JSON."""
    from pfslam_viz.commands.info_page import info_page
    from pfslam_viz.recordings.info import describe_path

    with console.status(f"reading {name}", quiet=as_json):
        description = describe_path(name, data, robot, **options)
    if as_json:
        print_json(description)
        return
    if not verbose:
        console.results().print(info_page(description))
        return
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(style="bold")
    table.add_column()
    shown = {key: value for key, value in description.items() if key != "notes"}
    shown["findings"] = [f"{f['severity']}: {f['message']}" for f in description["findings"]]  # type: ignore[attr-defined]
    for key, value in flatten(shown):
        table.add_row(key.replace("_", " "), show(value))
    console.results().print(table)


def run_fetch(
    name: str, data: Path | None, rgbd: bool, every: int, base_url: str | None, connections: int, quiet: bool
) -> None:
    """Download a public recording."""
    from pfslam_viz.recordings.fetch import fetch

    fetch(name, data, rgbd=rgbd, every=every, base_url=base_url, connections=connections, progress=not quiet)


def print_json(value: Any) -> None:
    """Print ``value`` on stdout; paths and NumPy values become what JSON has for them."""

    def plain(other: Any) -> Any:
        return other.tolist() if hasattr(other, "tolist") else str(other)

    streams.write_result(json.dumps(value, indent=2, default=plain) + "\n")


def flatten(value: Mapping[str, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Nested mappings as (dotted name, value) pairs."""
    rows: list[tuple[str, Any]] = []
    for key, inner in value.items():
        if isinstance(inner, Mapping):
            rows += flatten(inner, f"{prefix}{key} · ")
        else:
            rows.append((f"{prefix}{key}", inner))
    return rows


def show(value: Any) -> str:
    """A value as a person reads it."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:,.4g}" if abs(value) < 1e4 else f"{value:,.1f}"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        numbers = all(isinstance(item, int | float) for item in value)
        return (", " if numbers else "\n").join(show(item) for item in value) or "none"
    return str(value)
