"""The recordings in Rerun's real viewer. The pictures stay in $PFSLAM_TEST_OUTPUT, or in pytest's temporary folder."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.viewer.headless import HeadlessViewer, headless_viewer

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor, Recorded


pytestmark = pytest.mark.slow


@contextmanager
def viewer_or_skip() -> Iterator[HeadlessViewer]:
    try:
        with headless_viewer((1280, 720)) as running:
            yield running
    except PfslamError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def viewer() -> Iterator[HeadlessViewer]:
    with viewer_or_skip() as running:
        yield running


@pytest.fixture
def fresh_viewer() -> Iterator[HeadlessViewer]:
    """One that has seen no other recording, whose layout it would keep."""
    with viewer_or_skip() as running:
        yield running


def maps_of(picture: NDArray[Any]) -> NDArray[Any]:
    """Where the two maps are on the first tab; the legend and the events are beside them."""
    rows, columns = picture.shape[:2]
    return picture[int(0.12 * rows) : int(0.68 * rows), : 2 * (14 * columns // 36)]


def test_no_view_complains_at_start_middle_and_end(viewer: HeadlessViewer, output: Path, recorded: "Recorded") -> None:
    viewer.open(recorded.path)
    scans = len(recorded.steps)
    assert viewer.last_step() == scans - 1
    for step in (0, scans // 2, scans - 1):
        viewer.seek(step)
        viewer.photograph(output / f"corridor_compare_{step}.png")
        assert viewer.reports() == [], step


@pytest.mark.parametrize("tab", ["Filter", "Error", "Texture", "3-D", "About"])
def test_no_view_of_the_other_tabs_complains(
    viewer: HeadlessViewer, output: Path, recorded: "Recorded", tab: str
) -> None:
    viewer.open(recorded.path)
    viewer.show_tab(tab)
    viewer.seek(len(recorded.steps) // 2)
    viewer.photograph(output / f"corridor_{tab}.png")
    assert viewer.reports() == []


def test_a_tab_that_is_not_there_is_named(viewer: HeadlessViewer, recorded: "Recorded") -> None:
    viewer.open(recorded.path)
    with pytest.raises(InputError, match="there are Compare, Filter, Error, Texture, 3-D, About"):
        viewer.show_tab("Nope")


def test_the_compare_tab_shows_both_maps_framed_alike(
    viewer: HeadlessViewer, output: Path, recorded: "Recorded", shares: Callable[[Path], dict[str, float]]
) -> None:
    viewer.open(recorded.path)
    viewer.show_tab("Compare")
    viewer.seek(len(recorded.steps) - 1)
    picture = output / "corridor_compare_end.png"
    viewer.photograph(picture)
    found = shares(picture)
    assert found["white"] > 0.1 and found["unknown"] > 0.1
    assert found["orange"] > 0.0003 and found["blue"] > 0.0003
    image = np.asarray(cv2.imread(str(picture)), int)
    white = np.abs(image - 255).max(axis=2) < 5
    left, right = np.hsplit(maps_of(white), 2)
    # the same 8 m by 3 m corridor, drawn from nearly the same poses: columns of floor in the same place on both sides
    columns = [np.flatnonzero(half.mean(axis=0) > 0.2) for half in (left, right)]
    assert abs(columns[0][0] - columns[1][0]) < 40 and abs(columns[0][-1] - columns[1][-1]) < 40


def test_a_recording_without_camera_opens_too(
    viewer: HeadlessViewer,
    output: Path,
    plain_corridor: "Corridor",
    make_recording: "Callable[..., Recorded]",
    tmp_path: Path,
) -> None:
    made = make_recording(plain_corridor, tmp_path / "plain.rrd")
    viewer.open(made.path)
    viewer.seek(30)
    viewer.photograph(output / "plain.png")
    assert viewer.reports() == []


def test_the_demo_is_shown_without_complaint_from_start_to_end(
    fresh_viewer: HeadlessViewer, output: Path, demo: Path, shares: Callable[[Path], dict[str, float]]
) -> None:
    viewer = fresh_viewer
    viewer.open(demo)
    last = viewer.last_step()
    assert last > 2000
    for step in (0, last // 2, last):
        viewer.seek(step)
        picture = output / f"demo_compare_{step}.png"
        viewer.photograph(picture)
        assert viewer.reports() == [], step
        found = shares(picture)
        assert found["unknown"] > 0.3, step
        floor = np.abs(np.asarray(cv2.imread(str(picture)), int) - 255).max(axis=2) < 5
        reckoned, filtered = np.hsplit(maps_of(floor), 2)
        assert filtered.mean() > 0.2 * reckoned.mean() > 0.002, step  # one scan is enough to show the floor
        if step > 0:
            assert found["white"] > 0.02 and min(found["orange"], found["blue"]) > 0.001, step
    viewer.seek(last // 2)
    for tab in ("Filter", "Error", "Texture", "3-D", "About"):
        viewer.show_tab(tab)
        viewer.photograph(output / f"demo_{tab}.png")
        assert viewer.reports() == [], tab
