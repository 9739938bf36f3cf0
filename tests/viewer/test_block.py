import numpy as np
import pytest

from pfslam_viz.viewer import block
from pfslam_viz.viewer.entities import WEIGHT_RAMP


def columns(sent):
    """Rows by component name: lists of what each row holds."""
    return {c.component_descriptor().component.split(":")[-1]: c.as_arrow_array().to_pylist() for c in sent}


@pytest.fixture
def two_scans(corridor):
    steps = corridor.steps()
    return [next(steps), next(steps)]


def gathered(steps, particles=500, beams=500):
    out = block.Block()
    for step in steps:
        out.add(step, particles, beams, 1)
    return out


def test_particles_are_coloured_by_weight_and_the_heaviest_comes_last(two_scans):
    points, arrows = block.particle_columns(gathered(two_scans), 0.05)
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


def test_thinning_keeps_the_heaviest_and_counts(two_scans):
    thinned = gathered(two_scans, particles=7, beams=10)
    assert [len(p) for p in thinned.particles] == [7, 7]  # 40 particles, every sixth
    assert len(thinned.end_points[0]) == len(thinned.hits[0]) == 10
    np.testing.assert_allclose(thinned.particles[0][-1, :2], two_scans[0].estimate.best[:2], atol=1e-6)
    assert thinned.weights[0][-1] == 1.0


def test_the_block_keeps_copies(two_scans):
    step = two_scans[0]
    kept = gathered([step])
    expected = step.estimate.particles[0].copy(), step.end_points[0].copy()
    before = kept.particles[0].copy(), kept.end_points[0].copy()
    step.estimate.particles[:] = 99.0
    step.end_points[:] = 99.0
    np.testing.assert_array_equal(kept.particles[0], before[0])
    np.testing.assert_array_equal(kept.end_points[0], before[1])
    assert expected[0][0] != 99.0


def test_hits_and_misses_are_split():
    points = [np.array([[0.0, 0], [1, 1], [2, 2]], np.float32)]
    hits, misses = block.split(points, [np.array([True, False, True])])
    rows = columns(block.point_columns(hits, 0.03))["positions"]
    np.testing.assert_allclose(rows[0], [[0, 0, 0.03], [2, 2, 0.03]], atol=1e-6)
    assert len(misses[0]) == 1


def test_coordinates_are_rounded_to_a_centimetre():
    rows = columns(block.point_columns([np.array([[1.2345, -0.0051]], np.float32)], 0.0))["positions"]
    np.testing.assert_allclose(rows[0][0], [1.23, -0.01, 0.0], atol=1e-6)


def test_empty_scans_are_rows_too():
    empty = np.zeros((0, 2), np.float32)
    rows = columns(block.point_columns([empty, np.ones((1, 2), np.float32), empty], 0.0))["positions"]
    assert [len(row) for row in rows] == [0, 1, 0]
    rows = columns(block.strip_columns([empty, np.ones((2, 2), np.float32)], 0.5))["strips"]
    assert [len(row) for row in rows] == [0, 1]
    assert rows[1][0] == [[1.0, 1.0, 0.5], [1.0, 1.0, 0.5]]


def test_ellipse_axes_are_two_standard_deviations():
    angle = np.radians(30)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    covariance = turn @ np.diag([0.09, 0.01]) @ turn.T
    rows = columns(block.ellipse_columns([np.array([1.0, 2.0, 0.3])], [covariance], 0.0))
    matrix = np.array(rows["mat3x3"][0][0]).reshape(3, 3).T
    lengths = sorted(np.linalg.norm(matrix[:2, :2], axis=0))
    assert lengths == pytest.approx([0.2, 0.6])
    longest = matrix[:2, np.argmax(np.linalg.norm(matrix[:2, :2], axis=0))]
    assert abs(longest @ [np.cos(angle), np.sin(angle)]) == pytest.approx(0.6)
    assert rows["translation"][0][0] == pytest.approx([1.0, 2.0, 0.0])


def test_poses_turn_about_z():
    rows = columns(block.pose_columns([np.array([1.0, 2.0, np.pi / 2])], 0.0))
    assert rows["quaternion"][0][0] == pytest.approx([0, 0, np.sqrt(0.5), np.sqrt(0.5)])
