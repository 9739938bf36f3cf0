"""What is inside a recording, as plain values for the ``info`` command."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.catalog import find, load_place
from pfslam_viz.recordings.checking.check import READER_NOTE, check
from pfslam_viz.recordings.findings import Finding, in_order, verdict
from pfslam_viz.recordings.formats import LoadOptions, Place, WithoutScans, format_named
from pfslam_viz.recordings.recording import Frames, Recording, Relations, Stream

Array = NDArray[np.float64]
Description = dict[str, object]


def describe_path(
    name_or_path: str | Path, data: Path | None = None, robot: str | Path | None = None, **options: str | None
) -> Description:
    """What is inside a recording; of one that lacks just its scans, what its other sensors tell.

    Arguments and errors as for :func:`~pfslam_viz.recordings.catalog.load_recording`.
    """
    place, chosen = find(name_or_path, data, make_demo=True), LoadOptions(robot, **options)
    if (sensors := format_named(place.format).reader.without_scans(place, chosen)) is not None:
        return describe_sensors(place, sensors)
    contents = format_named(place.format).reader.contents(place, chosen)
    if contents is None:
        return describe(load_place(place, data, chosen))
    topics = {"topics": [dict(topic) for topic in contents.topics], "used": dict(contents.used)}
    if contents.problem is None:
        return describe(load_place(place, data, chosen)) | topics
    return {
        "name": place.name,
        "format": place.format,
        "path": str(place.path),
        "verdict": f"cannot be replayed: {contents.problem}",
        "findings": [],
        "notes": [],
        **topics,
    }


def describe(recording: Recording) -> Description:
    """Verdict, sensors, rates, spans, gaps, paths and findings of a recording, which is checked if it was not before.

    Values are what JSON can hold; units are in the keys.
    """
    recording = check(recording)
    lidar, first = recording.lidar, float(recording.stamps[0])
    none = (recording.ranges < lidar.range_min) | (recording.ranges > lidar.range_max)
    returns = recording.ranges[~none]
    span = float(lidar.angles[-1] - lidar.angles[0])
    out: Description = {
        "name": recording.name,
        "format": recording.format,
        "path": None if recording.path is None else str(recording.path),
        "verdict": verdict(recording.findings),
        "duration_s": round(recording.duration, 3),
        "first_stamp_s": first,
        "lidar": {
            "scans": len(recording),
            "beams": len(lidar.angles),
            "field_of_view_deg": round(float(np.degrees(span)), 3),
            "range_limits_m": [lidar.range_min, lidar.range_max],
            "no_return_share": round(float(none.mean()), 4),
            "scans_without_a_return": int(none.all(axis=1).sum()),
            "median_range_m": round(float(np.median(returns)), 2) if len(returns) else None,
            "on_robot_x_y_yaw": [round(float(v), 5) for v in lidar.pose],
            "height_m": round(lidar.height, 5),
        },
        "streams": _streams(recording.streams or (Stream("lidar", recording.stamps),), first),
        "odometry": _path(recording.dead_reckoning()),
    }
    findings = list(recording.findings)
    if recording.frames is not None:
        from pfslam_viz.texture.floor_camera import find_camera

        out["frames"] = _frames(recording.frames)
        camera = find_camera(recording.frames)
        out["camera"] = camera.as_dict() | {"text": camera.text}
        if camera.note:
            findings.append(Finding("note", "camera", camera.note))
    if recording.truth is not None:
        out["truth"] = {"poses": len(recording.truth.stamps), **_path(recording.truth.poses)}
    if recording.relations is not None:
        out["relations"] = _relations(recording.relations, recording)
    out["findings"] = [finding.as_dict() for finding in in_order(findings)]
    out["notes"] = list(recording.notes)
    return out


def describe_sensors(place: Place, sensors: WithoutScans) -> Description:
    """The same of a recording without scans: its odometry alone."""
    stamps = sensors.trajectory.stamps
    return {
        "name": place.number or place.name,
        "format": place.format,
        "path": str(place.path),
        "verdict": "cannot be replayed: its scans are missing",
        "duration_s": round(float(stamps[-1] - stamps[0]), 3),
        "first_stamp_s": float(stamps[0]),
        "streams": _streams(sensors.streams, float(stamps[0])),
        "odometry": {"wheel_path_m": round(sensors.wheel_path, 3), **_path(sensors.trajectory.poses)},
        "findings": [Finding("note", READER_NOTE, note).as_dict() for note in sensors.notes],
        "notes": list(sensors.notes),
    }


def _streams(streams: Iterable[Stream], first: float) -> Description:
    """Per stream: samples, mean rate, start and end from the first scan on, and the longest gap."""
    out: Description = {}
    for stream in streams:
        stamps = stream.stamps
        entry: Description = {"samples": len(stamps)}
        if len(stamps) > 1:
            gaps = np.diff(stamps)
            span = float(stamps[-1] - stamps[0])
            longest = int(np.argmax(gaps))
            entry |= {
                "rate_hz": round(len(gaps) / span, 2) if span > 0 else None,
                "start_s": round(float(stamps[0]) - first, 3) + 0.0,
                "end_s": round(float(stamps[-1]) - first, 3),
                "longest_gap_s": round(float(gaps[longest]), 3),
                "longest_gap_at_s": round(float(stamps[longest]) - first, 3),
            }
        out[stream.name] = entry
    return out


def _path(poses: Array) -> Description:
    gap = poses[-1] - poses[0]
    turned = np.diff(np.unwrap(poses[:, 2]))
    return {
        "path_m": round(geometry.path_length(poses), 3),
        "end_to_start_gap_m": round(float(np.hypot(gap[0], gap[1])), 3),
        "end_to_start_turn_deg": round(float(np.degrees(geometry.wrap(gap[2]))), 2),
        "turned_in_all_deg": round(float(np.degrees(np.abs(turned).sum())), 1),
    }


def _frames(frames: Frames) -> Description:
    def count(paths: tuple[Path | None, ...]) -> str:
        return f"{sum(path is not None for path in paths)} of {len(paths)}"

    return {
        "colour": count(frames.color_paths),
        "disparity": count(frames.disparity_paths),
        "camera_x_y_height_m": [round(v, 5) for v in frames.camera.position],
        "camera_pitch_deg": round(float(np.degrees(frames.camera.pitch)), 2),
    }


def _relations(relations: Relations, recording: Recording) -> Description:
    """How many there are, and how many are between stamps of scans (to 1 ms)."""
    ends = np.stack([relations.start, relations.end])
    after = np.clip(np.searchsorted(recording.stamps, ends), 1, max(len(recording) - 1, 1))
    near = [np.abs(recording.stamps[np.minimum(k, len(recording) - 1)] - ends) for k in (after - 1, after)]
    matched = (np.minimum(*near) < 1e-3).all(axis=0)
    return {"count": len(relations.start), "between_scans": int(matched.sum())}
