"""What was logged, read back from the file."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rerun as rr

from pfslam_viz.step import Step
from pfslam_viz.texture.floor_camera import find_camera
from pfslam_viz.viewer import drawing
from pfslam_viz.viewer.collector import StreamOptions
from pfslam_viz.viewer.sinks import open_sinks
from pfslam_viz.viewer.stream import replay_stream

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor, Readable, Recorded


EVERY_SCAN = [
    "world/filter/particles",
    "world/filter/headings",
    "world/filter/scan/hit",
    "world/filter/scan/miss",
    "world/filter/robot",
    "world/filter/mean",
    "world/filter/covariance",
    "world/filter/follow",
    "world/filter/trajectory/open",
    "world/filter/correction",
    "world/filter/degenerate",
    "world/dead_reckoning/scan",
    "world/dead_reckoning/robot",
    "world/dead_reckoning/trajectory/open",
    "world/truth/robot",
    "world/truth/trajectory/open",
    "plots/drift/filter",
    "plots/heading_drift/filter",
    "plots/error/filter",
    "plots/error/dead_reckoning",
    "plots/n_eff/filter",
    "plots/spread/filter",
    "plots/correlation/filter",
    "plots/lineages/filter",
    "plots/score/filter",
    "plots/correction/filter",
]


@pytest.fixture(scope="module")
def file(recorded: "Recorded", read_back: "type[Readable]") -> "Readable":
    return read_back(recorded.path)


def test_rerun_verifies_the_file(file: "Readable") -> None:
    assert "1 file verified" in file.verify()


def test_every_entity_that_the_help_page_names_is_there(file: "Readable") -> None:
    named = re.findall(r"- `/(.*?)`: ", file.static("help", "text")[0])
    assert set(EVERY_SCAN) < set(named) | {"world/filter/follow"}
    for entity in named:
        assert file.temporal(entity), entity


def test_every_drawn_entity_is_on_the_help_page(file: "Readable") -> None:
    page = file.static("help", "text")[0]
    for entity in file.entities:
        if file.temporal(entity) and entity != "world/filter/follow":  # a frame, not a drawing
            assert f"`/{entity}`" in page, entity


@pytest.mark.parametrize("entity", EVERY_SCAN)
def test_there_is_a_row_for_every_scan(file: "Readable", recorded: "Recorded", entity: str) -> None:
    rows = file.temporal(entity)
    assert [row["step"] for row in rows] == list(range(len(recorded.steps)))
    seconds = [row["time"].total_seconds() for row in rows]
    np.testing.assert_allclose(seconds, recorded.corridor.recording.times, atol=1e-6)


@pytest.mark.parametrize(
    ("trail", "pose"),
    [
        ("world/filter/trajectory", lambda step: step.estimate.best),
        ("world/dead_reckoning/trajectory", lambda step: step.dead_reckoning),
        ("world/truth/trajectory", lambda step: step.truth),
    ],
)
def test_the_trajectory_at_a_scan_has_exactly_the_points_up_to_it(
    file: "Readable", recorded: "Recorded", trail: str, pose: Callable[[Step], Any]
) -> None:
    done, between, latest = (file.temporal(f"{trail}/{part}") for part in ("done", "between", "open"))
    expected = np.array([pose(step)[:2] for step in recorded.steps])
    for k in (0, 1, 6, 7, 8, 33, len(recorded.steps) - 1):
        whole = [row for row in done if row["step"] <= k][-1]["strips"][0]
        for stretch in ([row for row in between if row["step"] <= k][-1]["strips"][0], latest[k]["strips"][0]):
            assert whole[-1][:2] == stretch[0][:2]  # they share the point where they meet
            whole = whole + stretch[1:]
        points = np.array(whole)[:, :2]
        np.testing.assert_allclose(points, expected[: k + 1], atol=1e-5)


def test_points_lie_where_the_step_has_them(file: "Readable", recorded: "Recorded") -> None:
    step = recorded.steps[30]
    hits = np.array(file.temporal("world/filter/scan/hit")[30]["positions"])
    misses = np.array(file.temporal("world/filter/scan/miss")[30]["positions"])
    np.testing.assert_allclose(hits[:, :2], step.end_points[step.hits], atol=0.0051)
    np.testing.assert_allclose(misses[:, :2], step.end_points[~step.hits], atol=0.0051)
    reckoned = np.array(file.temporal("world/dead_reckoning/scan")[30]["positions"])
    np.testing.assert_allclose(reckoned[:, :2], step.dead_reckoning_end_points, atol=0.0051)
    robot = file.temporal("world/filter/robot")[30]
    np.testing.assert_allclose(robot["translation"][0][:2], step.estimate.best[:2], atol=1e-6)
    z, w = robot["quaternion"][0][2:]
    assert 2 * np.arctan2(z, w) == pytest.approx(step.estimate.best[2], abs=1e-6)


def test_curves_are_the_numbers(file: "Readable", recorded: "Recorded") -> None:
    step = recorded.steps[42]
    best, reckoned, truth = step.estimate.best, step.dead_reckoning, step.truth
    assert truth is not None
    expected = {
        "plots/drift/filter": np.hypot(*(best - reckoned)[:2]),
        "plots/heading_drift/filter": np.degrees(reckoned[2] - best[2]),
        "plots/error/filter": np.hypot(*(best - truth)[:2]),
        "plots/error/dead_reckoning": np.hypot(*(reckoned - truth)[:2]),
        "plots/n_eff/filter": 1 / (step.estimate.weights**2).sum(),
        "plots/spread/filter": np.sqrt(step.estimate.covariance[0, 0] + step.estimate.covariance[1, 1]),
        "plots/correlation/filter": step.hits.mean(),
        "plots/score/filter": 0.8,
        "plots/correction/filter": 0.01,
    }
    for entity, value in expected.items():
        assert file.temporal(entity)[42]["scalars"][0] == pytest.approx(value, rel=1e-5), entity


def test_lows_are_kept_and_resampling_is_marked(file: "Readable", recorded: "Recorded") -> None:
    """The curve keeps the lowest value of a pixel, where an average showed none of the lows."""
    assert file.static("plots/n_eff/filter", "aggregation_policy") == [rr.components.AggregationPolicy.Min.value]
    marks = {row["step"]: row["scalars"][0] for row in file.temporal("plots/n_eff/filter/resampled")}
    assert marks == {s.index: 0.0 for s in recorded.steps if s.estimate.resampled}  # below the curve
    assert len(marks) == 15
    limits = file.temporal("plots/n_eff/filter/threshold")
    assert [(row["step"], row["scalars"]) for row in limits] == [(0, [20.0]), (59, [20.0])]  # half of 40 particles


def test_turns_are_counted_over_batches(corridor: "Corridor", read_back: "type[Readable]", tmp_path: Path) -> None:
    """Dead reckoning that turns 0.4 rad a scan further than the filter, seen in batches of seven."""
    with open_sinks(save=tmp_path / "x.rrd") as sink:
        stream = replay_stream(corridor.recording, corridor.config, sink)
        for step in corridor.steps():
            turned = step.estimate.best + np.array([0.0, 0.0, 0.4 * step.index])
            turned[2] = (turned[2] + np.pi) % (2 * np.pi) - np.pi
            stream.log(replace(step, dead_reckoning=turned))
            if step.index % 7 == 6:
                stream.flush()
    rows = read_back(tmp_path / "x.rrd").temporal("plots/heading_drift/filter")
    np.testing.assert_allclose([row["scalars"][0] for row in rows], np.degrees(0.4) * np.arange(60), atol=1e-6)


def test_the_map_shows_the_corridor_the_right_way_up(file: "Readable") -> None:
    row = file.temporal("world/filter/map")[-1]
    form, cell = row["format"][0], row["cell_size"][0]
    cells = np.array(row["data"][0]).reshape(form["height"], form["width"])
    x0, y0 = row["translation"][0][:2]

    def at(x: float, y: float) -> Any:
        return cells[form["height"] - 1 - int((y - y0) / cell), int((x - x0) / cell)]

    assert at(0.5, 0.0) < 10  # the floor where the robot drove
    walls = cells > 60
    ys = y0 + (form["height"] - 1 - np.nonzero(walls)[0] + 0.5) * cell
    xs = x0 + (np.nonzero(walls)[1] + 0.5) * cell
    near = np.abs(np.abs(ys) - 1.5) < 0.2  # the long walls, at y = -1.5 and 1.5
    ends = (np.abs(xs + 1.0) < 0.2) | (np.abs(xs - 7.0) < 0.2)
    assert np.mean(near | ends) > 0.85
    assert xs.max() > 6.5 and xs.min() > -1.5  # it is not mirrored: the start is near the left end


def test_a_match_is_drawn_ten_times_as_long_and_degenerate_only_where_it_is(
    file: "Readable", recorded: "Recorded"
) -> None:
    rows = file.temporal("world/filter/correction")
    heading = recorded.steps[20].estimate.best[2]
    np.testing.assert_allclose(rows[20]["vectors"][0][:2], [0.1 * np.cos(heading), 0.1 * np.sin(heading)], atol=1e-6)
    lines = file.temporal("world/filter/degenerate")
    assert lines[20]["strips"] == []
    start, end = np.array(lines[21]["strips"][0])
    np.testing.assert_allclose((end - start)[:2], [2.0, 0.0], atol=1e-5)


def test_hindsight_and_closures_show_at_the_end(file: "Readable", recorded: "Recorded") -> None:
    (row,) = file.temporal("world/filter/hindsight")
    assert row["step"] == len(recorded.steps) - 1
    assert len(row["strips"][0]) == len(recorded.steps)
    (row,) = file.temporal("world/filter/closures")
    first, last = recorded.steps[0].estimate.best, recorded.steps[-1].estimate.best
    assert row["step"] == len(recorded.steps) - 1
    np.testing.assert_allclose(row["strips"], [[[*first[:2], 0.09], [*last[:2], 0.09]]], atol=1e-6)


def test_camera_images_come_at_their_stamps(file: "Readable") -> None:
    rows = file.temporal("world/filter/robot/camera")
    assert [row["step"] for row in rows] == [0, 10, 20, 30, 40, 50]
    assert bytes(rows[0]["blob"][0][:2]) == b"\xff\xd8"  # JPEG
    assert [row["step"] for row in file.temporal("camera/filter/disparity")] == [1, 11, 21, 31, 41, 51]


def test_the_camera_in_the_scene_is_the_one_that_paints(
    corridor: "Corridor",
    make_recording: Callable[..., "Recorded"],
    read_back: "type[Readable]",
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames = corridor.recording.frames
    assert frames is not None
    fitted = frames.camera.model_copy(update={"position": (0.25, 0.0, 0.75)})
    found = replace(find_camera(frames), geometry=fitted)
    monkeypatch.setattr("pfslam_viz.texture.floor_camera.find_camera", lambda frames, source: found)
    file = read_back(make_recording(corridor, tmp_path / "fitted.rrd").path)
    np.testing.assert_allclose(file.static("world/filter/robot/camera", "translation"), [[0.25, 0.0, 0.75]], atol=1e-6)


def test_the_about_page_holds_the_configuration(file: "Readable") -> None:
    assert "| particles | 40 |" in file.static("about", "text")[0]
    assert "## Result" in file.static("about", "text")[0]


def test_options_thin_and_what_is_left_out_is_said(
    plain_corridor: "Corridor", make_recording: "Callable[..., Recorded]", read_back: "type[Readable]", tmp_path: Path
) -> None:
    options = StreamOptions(map_every=20, max_particles=10, max_beams=30)
    made = make_recording(plain_corridor, tmp_path / "thin.rrd", options)
    assert made.left_out == [
        "particles: 10 of 40 drawn (--max-particles)",
        "beams: 23 of 91 drawn (--max-beams)",
        "maps: 3 of 60 scans have one (--map-every)",
    ]
    file = read_back(made.path)
    assert [row["step"] for row in file.temporal("world/filter/map")] == [0, 20, 40, 59]  # and the final one
    assert len(file.temporal("world/filter/particles")[5]["positions"]) == 10
    about = file.static("about", "text")[0]
    assert all(phrase in about for phrase in made.left_out)
    absent = ["match", "correction", "closures", "hindsight", "texture", "robot/camera"]
    page = file.static("help", "text")[0]
    assert not any(f"world/filter/{name}`" in page for name in absent)


def test_large_pictures_are_sent_few_at_a_time(
    plain_corridor: "Corridor",
    make_recording: "Callable[..., Recorded]",
    read_back: "type[Readable]",
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """All maps at once, two at a time, or one at a time where one is more than the limit; the same rows."""
    files: list[Readable] = []
    for limit, most in ((100_000_000, None), (None, 2), (1, 1)):
        if limit is None:
            limit = 2 * max(len(row["data"][0]) for row in files[0].rows("world/filter/map"))
        monkeypatch.setattr(drawing, "CHUNK_BYTES", limit)
        made = make_recording(plain_corridor, tmp_path / f"{limit}.rrd", StreamOptions(map_every=1))
        files.append(read_back(made.path))
        rows = len(files[0].rows("world/filter/map"))
        assert 50 < rows <= 61
        assert max(files[-1].chunks("world/filter/map")) == (most or rows)
        assert sum(files[-1].chunks("world/filter/map")) == rows
        assert files[-1].temporal("world/filter/map") == files[0].temporal("world/filter/map")


def test_long_recordings_draw_less_of_a_scan_unless_told() -> None:
    assert StreamOptions().settled(4_785) == StreamOptions(None, 500, 270)
    assert StreamOptions().settled(20_000) == StreamOptions(None, 120, 120)
    assert StreamOptions(7, 500, None).settled(10**6) == StreamOptions(7, 500, 30)


def test_nothing_is_left_out_silently(recorded: "Recorded") -> None:
    assert recorded.left_out == []


def test_an_unfinished_run_opens_with_what_was_logged(
    corridor: "Corridor", read_back: "type[Readable]", tmp_path: Path
) -> None:
    path = tmp_path / "part.rrd"
    with open_sinks(save=path) as sink:
        stream = replay_stream(corridor.recording, corridor.config, sink)
        for step, _ in zip(corridor.steps(), range(25), strict=False):
            stream.log(step)
    file = read_back(path)
    assert "1 file verified" in file.verify()
    assert len(file.temporal("world/filter/particles")) == 25


def test_batches_are_sent_as_they_fill(
    plain_corridor: "Corridor", tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pfslam_viz.viewer.stream.BATCH_ROWS", 10)
    sent = []
    with open_sinks(save=tmp_path / "x.rrd") as sink:
        stream = replay_stream(plain_corridor.recording, plain_corridor.config, sink)
        send = sink.send_columns

        def spy(path: str, times: Any, columns: Any) -> None:
            sent.append((path, len(times[0].as_arrow_array())))
            send(path, times, columns)

        monkeypatch.setattr(sink, "send_columns", spy)
        for step, _ in zip(plain_corridor.steps(), range(25), strict=False):
            stream.log(step)
        assert [n for path, n in sent if path == "world/filter/particles"] == [10, 10]
    assert [n for path, n in sent if path == "world/filter/particles"] == [10, 10, 5]
