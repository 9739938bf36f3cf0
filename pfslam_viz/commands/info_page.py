"""The page that ``info`` shows: the verdict, the sensors in a short table, and what to do about what was found."""

from collections.abc import Iterator, Mapping
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from pfslam_viz.recordings.info import Description

STYLES = {"wrong": "bold red", "doubtful": "yellow", "note": "dim"}


def info_page(about: Description) -> Group:
    """The page of one recording, from what :func:`~pfslam_viz.recordings.info.describe` says of it."""
    verdict = str(about["verdict"])
    style = "green" if verdict == "good" else STYLES["wrong" if verdict.startswith("cannot") else "doubtful"]
    title = Text.assemble((str(about["name"]), "bold"), ": ", (verdict, style))
    scans = _part(about, "lidar").get("scans")
    span = f"{about['duration_s']:,.1f} s, " if "duration_s" in about else ""
    what = f"{about['format']}, {span}" + (f"{scans:,} scans, " if scans else "")
    parts: list[RenderableType] = [title, Text(f"{what}{about['path'] or 'in memory'}", style="dim"), ""]
    if "odometry" in about:
        parts.append(_table(about))
    if topics := about.get("topics"):
        parts += ["", _topics(topics, _part(about, "used"))]
    if findings := _findings(about):
        parts += ["", findings]
    return Group(*parts)


def _table(about: Description) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()
    for name, text in _sensors(about):
        table.add_row(name, text)
    return table


def _sensors(about: Description) -> Iterator[tuple[str, str]]:
    """A row for each sensor: its name and what it is."""
    streams = _part(about, "streams")
    if lidar := _part(about, "lidar"):
        near, far = lidar["range_limits_m"]
        yield (
            "lidar",
            f"{lidar['beams']:,} beams over {lidar['field_of_view_deg']:.4g}°{_rate(streams.get('lidar'))},"
            f" {near:.3g} to {far:.4g} m, {100 * lidar['no_return_share']:.1f} % without a return",
        )
    else:
        yield "lidar", "none"
    path = _part(about, "odometry")
    moved = "none" if path["path_m"] == path["turned_in_all_deg"] == 0 else f"{path['path_m']:,.1f} m"
    turned = f", turns {path['turned_in_all_deg']:,.0f}° in all" if moved != "none" else ""
    yield "odometry", f"{moved}{turned}{_rate(streams.get('odometry') or streams.get('encoders'))}"
    if imu := streams.get("IMU"):
        yield "IMU", f"{imu['samples']:,} readings{_rate(imu)}"
    if frames := _part(about, "frames"):
        yield "camera", f"{frames['colour']} colour and {frames['disparity']} disparity frames"
        yield "", str(_part(about, "camera")["text"])
    else:
        yield "camera", "none"
    known = []
    if truth := _part(about, "truth"):
        known.append(f"{truth['poses']:,} poses")
    if relations := _part(about, "relations"):
        known.append(f"{relations['count']:,} relations")
    yield "truth", " and ".join(known) or "unknown"


def _topics(topics: Any, used: Mapping[str, Any]) -> Table:
    """The topics of a log, and which of them are read."""
    table = Table(box=None, pad_edge=False)
    columns = (("topic", "left"), ("type", "left"), ("messages", "right"), ("Hz", "right"), ("", "left"))
    for heading, side in columns:
        table.add_column(heading, justify="left" if side == "left" else "right")
    for topic in topics:
        taken = topic["name"] in used.values()
        rate = "" if topic["rate_hz"] is None else f"{topic['rate_hz']:.4g}"
        style = "bold" if taken else "dim"
        table.add_row(
            topic["name"], topic["type"], f"{topic['messages']:,}", rate, "read" if taken else "", style=style
        )
    return table


def _rate(stream: Mapping[str, Any] | None) -> str:
    rate = stream.get("rate_hz") if stream else None
    return f", {rate:.3g} Hz" if rate else ""


def _findings(about: Description) -> Table | None:
    found = about["findings"]
    assert isinstance(found, list)
    if not found:
        return None
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column()
    table.add_column()
    for finding in found:
        table.add_row(Text(finding["severity"], style=STYLES[finding["severity"]]), Text(finding["message"]))
        if finding["advice"]:
            table.add_row("", Text(f"→ {finding['advice']}"))
    return table


def _part(about: Description, key: str) -> Mapping[str, Any]:
    part = about.get(key) or {}
    assert isinstance(part, Mapping)
    return part
