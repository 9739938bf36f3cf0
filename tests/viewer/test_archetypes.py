from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rerun as rr

from pfslam_viz.step import Step
from pfslam_viz.viewer import archetypes
from pfslam_viz.viewer.colors import WEIGHT_RAMP
from pfslam_viz.viewer.contents import Boxes, Cells, Jpeg, Lines
from pfslam_viz.viewer.scan_batch import Ragged, ScanBatch, ScanCopy

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor


PACKED = [(r << 24) | (g << 16) | (b << 8) | 255 for r, g, b in WEIGHT_RAMP]


def columns(sent: Any) -> dict[str, Any]:
    """Rows by component name: lists of what each row holds."""
    return {c.component_descriptor().component.split(":")[-1]: c.as_arrow_array().to_pylist() for c in sent}


@pytest.fixture
def two_scans(corridor: "Corridor") -> list[Step]:
    steps = corridor.steps()
    return [next(steps), next(steps)]


def batch(steps: Any, beams: int = 500) -> ScanBatch:
    return ScanBatch.of([ScanCopy.of(step, beams) for step in steps])


def test_particles_are_coloured_by_weight_and_the_heaviest_comes_last(two_scans: list[Step]) -> None:
    points, arrows = archetypes.particle_columns(batch(two_scans), 500, 0.05)
    points, arrows = columns(points), columns(arrows)
    for step, positions, colors in zip(two_scans, points["positions"], points["colors"], strict=True):
        estimate = step.estimate
        assert len(positions) == len(estimate.particles)
        np.testing.assert_allclose(positions[-1][:2], estimate.best[:2], atol=0.005)
        assert colors[-1] in PACKED[6:] and PACKED.index(colors[-1]) > PACKED.index(colors[0])
        lightest = np.argmin(estimate.weights)
        np.testing.assert_allclose(positions[0][:2], estimate.particles[lightest, :2], atol=0.005)
        assert positions[-1][2] > positions[0][2]  # and lies on top
    heading = two_scans[1].estimate.best[2]
    vector = arrows["vectors"][1][-1]
    assert np.arctan2(vector[1], vector[0]) == pytest.approx(heading, abs=0.01)


def test_equal_weights_are_of_middle_colour_and_not_all_black() -> None:
    """As after resampling. Ten times an average weight is the darkest, none the lightest."""
    n = 10
    assert archetypes.weight_levels(np.full(n, 1.0, np.float32)).tolist() == [5] * n
    levels = archetypes.weight_levels(np.array([0.0, 0.2, 1.0, 3.0, 10.0, 500.0], np.float32))
    assert levels.tolist() == [0, 1, 5, 7, 9, 9]


def test_thinning_keeps_the_heaviest(two_scans: list[Step]) -> None:
    points, _ = archetypes.particle_columns(batch(two_scans), 7, 0.05)
    rows = columns(points)["positions"]
    assert [len(row) for row in rows] == [7, 7]  # 40 particles, every sixth
    np.testing.assert_allclose(rows[0][-1][:2], two_scans[0].estimate.best[:2], atol=0.005)


def test_coordinates_are_rounded_to_a_centimetre() -> None:
    rows = columns(archetypes.point_columns(Ragged.of([np.array([[1.2345, -0.0051]], np.float32)]), 0.0))["positions"]
    np.testing.assert_allclose(rows[0][0], [1.23, -0.01, 0.0], atol=1e-6)


def test_empty_scans_are_rows_too() -> None:
    empty = np.zeros((0, 2), np.float32)
    rows = columns(archetypes.point_columns(Ragged.of([empty, np.ones((1, 2), np.float32), empty]), 0.0))["positions"]
    assert [len(row) for row in rows] == [0, 1, 0]
    rows = columns(archetypes.strip_columns([empty, np.ones((2, 2), np.float32)], 0.5))["strips"]
    assert [len(row) for row in rows] == [0, 1]
    assert rows[1][0] == [[1.0, 1.0, 0.5], [1.0, 1.0, 0.5]]


def test_ellipse_axes_are_two_standard_deviations() -> None:
    angle = np.radians(30)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    covariance = turn @ np.diag([0.09, 0.01]) @ turn.T
    rows = columns(archetypes.ellipse_columns(np.array([[1.0, 2.0, 0.3]]), covariance[None], 0.0))
    matrix = np.array(rows["mat3x3"][0][0]).reshape(3, 3).T
    lengths = sorted(np.linalg.norm(matrix[:2, :2], axis=0))
    assert lengths == pytest.approx([0.2, 0.6])
    longest = matrix[:2, np.argmax(np.linalg.norm(matrix[:2, :2], axis=0))]
    assert abs(longest @ [np.cos(angle), np.sin(angle)]) == pytest.approx(0.6)
    assert rows["translation"][0][0] == pytest.approx([1.0, 2.0, 0.0])


def test_poses_turn_about_z() -> None:
    rows = columns(archetypes.pose_columns(np.array([[1.0, 2.0, np.pi / 2]]), 0.0))
    assert rows["quaternion"][0][0] == pytest.approx([0, 0, np.sqrt(0.5), np.sqrt(0.5)])


@pytest.mark.parametrize(("depth", "model"), [((), "L"), ((4,), "RGBA")])
def test_cells_become_grid_maps_row_by_row_from_the_top(depth: tuple[int, ...], model: str) -> None:
    first, second = (
        np.arange(np.prod(shape), dtype=np.uint8).reshape(shape) for shape in ((2, 3, *depth), (1, 2, *depth))
    )
    shown = columns(
        archetypes.content_columns([Cells(first, 0.5, (-1.0, 2.0, 0.01)), Cells(second, 0.25, (3.0, 4.0, 0.5))])
    )
    forms = [form for (form,) in shown["format"]]
    assert [(form["height"], form["width"]) for form in forms] == [(2, 3), (1, 2)]
    assert [form["color_model"] for form in forms] == [rr.ColorModel[model].value] * 2
    assert shown["data"] == [[list(range(first.size))], [list(range(second.size))]]
    assert shown["cell_size"] == [[0.5], [0.25]]
    np.testing.assert_allclose(shown["translation"], [[[-1.0, 2.0, 0.01]], [[3.0, 4.0, 0.5]]])
    assert ("colormap" in shown) == (model == "L")
    assert all(len(rows) == 2 and all(len(row) == 1 for row in rows) for rows in shown.values())


def test_boxes_are_as_many_a_row_as_the_map_has() -> None:
    sizes = [2, 0, 1]
    contents = [Boxes(np.full((n, 3), 2.0 + n, np.float32), np.full((n, 3), 0.5 + n, np.float32)) for n in sizes]
    shown = columns(archetypes.content_columns(contents))
    assert shown["centers"] == [[[4.0] * 3] * 2, [], [[3.0] * 3]]
    assert shown["half_sizes"] == [[[2.5] * 3] * 2, [], [[1.5] * 3]]


def test_lines_of_equal_or_different_lengths_lie_at_their_height() -> None:
    different = [np.array([[0, 1], [2, 3]], np.float32), np.array([[4, 5], [6, 7], [8, 9]], np.float32)]
    equal = np.array([[[1, 1], [2, 2]]], np.float32)
    shown = columns(archetypes.content_columns([Lines(different, 0.25), Lines([], 0.25), Lines(equal, 0.25)]))["strips"]
    assert shown == [
        [[[0, 1, 0.25], [2, 3, 0.25]], [[4, 5, 0.25], [6, 7, 0.25], [8, 9, 0.25]]],
        [],
        [[[1, 1, 0.25], [2, 2, 0.25]]],
    ]


def test_encoded_images_keep_their_bytes() -> None:
    contents = [Jpeg(np.array(values, np.uint8)) for values in ([255, 216], [1, 2, 3])]
    shown = columns(archetypes.content_columns(contents))
    assert shown == {"blob": [[[255, 216]], [[1, 2, 3]]], "media_type": [["image/jpeg"], ["image/jpeg"]]}
