"""Marks of made-up events, and those of a recording read back."""

from typing import TYPE_CHECKING

import numpy as np
import pytest

from pfslam_viz.viewer import entities
from pfslam_viz.viewer.contents import Spots
from pfslam_viz.viewer.entities import Entity
from pfslam_viz.viewer.events import Event
from pfslam_viz.viewer.marks import Marks
from tests.viewer.conftest import BLIND

if TYPE_CHECKING:
    from tests.viewer.conftest import Readable, Recorded


def event(step: int, level: str, closes_loop: bool = False) -> Event:
    return Event(step, 0.1 * step, level, "words", closes_loop)


def flat(marks: list[tuple[Entity, int, Spots]]) -> list[tuple[str, int, list[list[float]], list[str]]]:
    return [(row.template.split("/")[-1], step, s.points.tolist(), list(s.labels)) for row, step, s in marks]


def test_dots_stay_and_the_newest_one_says_what_happened_for_a_while() -> None:
    marks = Marks(2000, spacing=1.0)  # words stay for 50 scans
    found = flat(list(marks.of(event(10, "WARN"), np.array([1.0, 2.0, 0.5]), scan=10)))
    assert found == [("doubt", 10, [[1, 2]], []), ("newest", 10, [[1, 2]], ["words"])]
    assert not list(marks.expired(59))
    assert flat(list(marks.expired(60))) == [("newest", 60, [], [])]
    assert not list(marks.expired(61))
    found = flat(list(marks.of(event(70, "WARN"), np.array([3.0, 4.0, 0.5]), scan=70)))
    assert found[0] == ("doubt", 70, [[1, 2], [3, 4]], [])


def test_a_loop_that_is_known_at_the_end_shows_in_its_time() -> None:
    found = flat(list(Marks(2000, 1.0).of(event(100, "INFO", closes_loop=True), np.zeros(3), scan=1999)))
    assert found == [("loop", 100, [[0, 0]], []), ("newest", 100, [[0, 0]], ["words"]), ("newest", 150, [], [])]


def test_the_least_important_are_sparse() -> None:
    marks = Marks(2000, spacing=1.0)
    drawn = [k for k in range(50) if list(marks.of(event(k, "DEBUG"), np.array([0.3 * k, 0.0, 0.0]), k))]
    assert drawn == list(range(0, 50, 4))  # 1.2 m apart


def test_what_is_about_the_run_as_a_whole_has_no_place() -> None:
    assert not list(Marks(2000, 1.0).of(event(1999, "INFO"), np.zeros(3), 1999))


def test_marks_are_read_back_at_the_poses_where_it_happened(recorded: "Recorded", read_back: "type[Readable]") -> None:
    file, best = read_back(recorded.path), [s.estimate.best[:2] for s in recorded.steps]
    (row,) = file.temporal(entities.DOUBTED_AT.path("filter"))
    assert row["step"] == BLIND[0]
    np.testing.assert_allclose(np.array(row["positions"])[:, :2], [best[BLIND[0]]], atol=1e-5)
    words = {row["step"]: row.get("labels") or [] for row in file.temporal(entities.NEWEST.path("filter"))}
    assert words == {BLIND[0]: ["no match with map"], BLIND[0] + 20: [], 59: ["loop closed with scan 0"]}
    (row,) = file.temporal(entities.CLOSED_AT.path("filter"))
    assert row["step"] == 59
    rows = file.temporal(entities.RESAMPLED_AT.path("filter"))
    assert rows[0]["step"] == 3 and {row["step"] % 4 for row in rows} == {3}
    points = np.array(rows[-1]["positions"])[:, :2]
    np.testing.assert_allclose(points, [best[row["step"]] for row in rows], atol=1e-5)
    assert np.hypot(*np.diff(points, axis=0).T).min() >= 0.5
    assert len(points) == pytest.approx(5.0 / 0.65, abs=3)  # 5 m of way
