import numpy as np
import pytest
import rerun as rr

from pfslam_viz.viewer import archetypes
from pfslam_viz.viewer.block import Block, Excerpt, Ragged
from pfslam_viz.viewer.entities import WEIGHT_RAMP
from pfslam_viz.viewer.pictures import Boxes, Cells, Jpeg, Lines


def columns(sent):
    """Rows by component name: lists of what each row holds."""
    return {c.component_descriptor().component.split(":")[-1]: c.as_arrow_array().to_pylist() for c in sent}


@pytest.fixture
def two_scans(corridor):
    steps = corridor.steps()
    return [next(steps), next(steps)]


def block(steps, beams=500):
    return Block.of([Excerpt.of(step, beams) for step in steps])


def test_particles_are_coloured_by_weight_and_the_heaviest_comes_last(two_scans):
    points, arrows = archetypes.particle_columns(block(two_scans), 500, 0.05)
    points, arrows = columns(points), columns(arrows)
    for step, positions, colors in zip(two_scans, points["positions"], points["colors"], strict=True):
        estimate = step.estimate
        assert len(positions) == len(estimate.particles)
        np.testing.assert_allclose(positions[-1][:2], estimate.best[:2], atol=0.005)
        r, g, b = WEIGHT_RAMP[-1]
        assert colors[-1] == (r << 24) | (g << 16) | (b << 8) | 255
        lightest = np.argmin(estimate.weights)
        np.testing.assert_allclose(positions[0][:2], estimate.particles[lightest, :2], atol=0.005)
        assert positions[-1][2] > positions[0][2]  # and lies on top
    heading = two_scans[1].estimate.best[2]
    vector = arrows["vectors"][1][-1]
    assert np.arctan2(vector[1], vector[0]) == pytest.approx(heading, abs=0.01)


def test_thinning_keeps_the_heaviest(two_scans):
    points, _ = archetypes.particle_columns(block(two_scans), 7, 0.05)
    rows = columns(points)["positions"]
    assert [len(row) for row in rows] == [7, 7]  # 40 particles, every sixth
    np.testing.assert_allclose(rows[0][-1][:2], two_scans[0].estimate.best[:2], atol=0.005)


def test_coordinates_are_rounded_to_a_centimetre():
    rows = columns(archetypes.point_columns(Ragged.of([np.array([[1.2345, -0.0051]], np.float32)]), 0.0))["positions"]
    np.testing.assert_allclose(rows[0][0], [1.23, -0.01, 0.0], atol=1e-6)


def test_empty_scans_are_rows_too():
    empty = np.zeros((0, 2), np.float32)
    rows = columns(archetypes.point_columns(Ragged.of([empty, np.ones((1, 2), np.float32), empty]), 0.0))["positions"]
    assert [len(row) for row in rows] == [0, 1, 0]
    rows = columns(archetypes.strip_columns([empty, np.ones((2, 2), np.float32)], 0.5))["strips"]
    assert [len(row) for row in rows] == [0, 1]
    assert rows[1][0] == [[1.0, 1.0, 0.5], [1.0, 1.0, 0.5]]


def test_ellipse_axes_are_two_standard_deviations():
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


def test_poses_turn_about_z():
    rows = columns(archetypes.pose_columns(np.array([[1.0, 2.0, np.pi / 2]]), 0.0))
    assert rows["quaternion"][0][0] == pytest.approx([0, 0, np.sqrt(0.5), np.sqrt(0.5)])


def parts(archetype):
    """What an archetype holds, by component name."""
    return {
        c.component_descriptor().component.split(":")[-1]: c.as_arrow_array().to_pylist()
        for c in archetype.as_component_batches()
    }


@pytest.mark.parametrize(("shape", "model"), [((2, 3), "L"), ((2, 3, 4), "RGBA")])
def test_cells_become_a_grid_map_row_by_row_from_the_top(shape, model):
    values = np.arange(np.prod(shape), dtype=np.uint8).reshape(shape)
    shown = parts(archetypes.archetype(Cells(values, 0.5, (-1.0, 2.0, 0.01))))
    form = shown["format"][0]
    assert (form["height"], form["width"]) == (2, 3)
    assert form["color_model"] == rr.ColorModel[model].value
    assert shown["data"][0] == list(range(values.size))
    assert shown["cell_size"] == [0.5]
    assert shown["translation"][0] == pytest.approx([-1.0, 2.0, 0.01])
    assert ("colormap" in shown) == (model == "L")


def test_other_pictures_become_what_they_are():
    boxes = parts(archetypes.archetype(Boxes(np.full((1, 3), 2.0, np.float32), np.full((1, 3), 0.5, np.float32))))
    assert boxes["half_sizes"] == [[0.5, 0.5, 0.5]]
    lines = parts(archetypes.archetype(Lines([np.array([[0.0, 1.0], [2.0, 3.0]], np.float32)], 0.25)))
    assert lines["strips"] == [[[0.0, 1.0, 0.25], [2.0, 3.0, 0.25]]]
    image = parts(archetypes.archetype(Jpeg(np.array([255, 216], np.uint8))))
    assert image["blob"] == [[255, 216]] and image["media_type"] == ["image/jpeg"]
