"""The recordings in Rerun's real viewer. The pictures stay in $PFSLAM_TEST_OUTPUT, or in pytest's temporary folder."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.viewer.blueprint import BACKGROUND
from pfslam_viz.viewer.headless import headless_viewer

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def viewer():
    try:
        with headless_viewer((1280, 720)) as running:
            yield running
    except PfslamError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    chosen = os.environ.get("PFSLAM_TEST_OUTPUT")
    folder = Path(chosen) if chosen else tmp_path_factory.mktemp("pictures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def shares(picture):
    """Share of the pixels by colour: white floor, unknown background, black or dark, and the trajectories' colours."""
    image = cv2.cvtColor(cv2.imread(str(picture)), cv2.COLOR_BGR2RGB).astype(int)

    def near(color):
        return float(np.mean(np.abs(image - color).max(axis=2) < 25))

    return {
        name: near(color)
        for name, color in (
            ("white", (255, 255, 255)),
            ("unknown", BACKGROUND),
            ("orange", (213, 94, 0)),
            ("blue", (0, 110, 220)),
        )
    }


def test_no_view_complains_at_start_middle_and_end(viewer, output, recorded):
    viewer.open(recorded.path)
    scans = len(recorded.steps)
    assert viewer.last_step() == scans - 1
    for step in (0, scans // 2, scans - 1):
        viewer.seek(step)
        viewer.photograph(output / f"corridor_compare_{step}.png")
        assert viewer.reports() == [], step


@pytest.mark.parametrize("tab", ["Filter", "Texture", "3-D", "About"])
def test_no_view_of_the_other_tabs_complains(viewer, output, recorded, tab):
    viewer.open(recorded.path)
    viewer.show_tab(tab)
    viewer.seek(len(recorded.steps) // 2)
    viewer.photograph(output / f"corridor_{tab}.png")
    assert viewer.reports() == []


def test_a_tab_that_is_not_there_is_named(viewer, recorded):
    viewer.open(recorded.path)
    with pytest.raises(InputError, match="there are Compare, Filter, Texture, 3-D, About"):
        viewer.show_tab("Nope")


def test_the_compare_tab_shows_both_maps_framed_alike(viewer, output, recorded):
    viewer.open(recorded.path)
    viewer.show_tab("Compare")
    viewer.seek(len(recorded.steps) - 1)
    picture = output / "corridor_compare_end.png"
    viewer.photograph(picture)
    found = shares(picture)
    assert found["white"] > 0.1 and found["unknown"] > 0.1
    assert found["orange"] > 0.0003 and found["blue"] > 0.0003
    image = cv2.cvtColor(cv2.imread(str(picture)), cv2.COLOR_BGR2RGB).astype(int)
    white = np.abs(image - 255).max(axis=2) < 5
    top, bottom = int(0.12 * len(white)), int(0.68 * len(white))  # where the maps are
    left, right = np.hsplit(white[top:bottom], 2)
    # the same 8 m by 3 m corridor, drawn from nearly the same poses: columns of floor in the same place on both sides
    columns = [np.flatnonzero(half.mean(axis=0) > 0.2) for half in (left, right)]
    assert abs(columns[0][0] - columns[1][0]) < 40 and abs(columns[0][-1] - columns[1][-1]) < 40


def test_a_recording_without_camera_opens_too(viewer, output, plain_corridor, make_recording, tmp_path):
    made = make_recording(plain_corridor, tmp_path / "plain.rrd")
    viewer.open(made.path)
    viewer.seek(30)
    viewer.photograph(output / "plain.png")
    assert viewer.reports() == []
