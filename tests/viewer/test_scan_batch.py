from copy import deepcopy
from dataclasses import fields, replace

import numpy as np
import pytest

from pfslam_viz.viewer.scan_batch import Ragged, ScanBatch, ScanCopy, stride


@pytest.fixture
def two_scans(corridor):
    steps = corridor.steps()
    return [next(steps), next(steps)]


def test_end_points_are_thinned_with_their_hits(two_scans):
    step = two_scans[1]
    kept = ScanCopy.of(step, 10)  # 91 beams, every tenth
    np.testing.assert_array_equal(kept.end_points, step.end_points[::10].astype(np.float32))
    np.testing.assert_array_equal(kept.hits, step.hits[::10])
    assert kept.curves["correlation"] == pytest.approx(step.hits.mean())  # of all of them
    assert [stride(total, 10) for total in (0, 1, 10, 11, 91)] == [1, 1, 1, 2, 10]


def test_an_excerpt_keeps_copies(two_scans):
    step = deepcopy(two_scans[1])  # the truth in it is the recording's own
    kept = ScanCopy.of(step, 500)
    before = {
        f.name: np.array(value) for f in fields(ScanCopy) if isinstance(value := getattr(kept, f.name), np.ndarray)
    }
    estimate = step.estimate
    for array in (
        *(estimate.particles, estimate.weights, estimate.best, estimate.mean, estimate.covariance),
        *(step.end_points, step.hits, step.dead_reckoning_end_points, step.dead_reckoning, step.truth),
        *(estimate.match.correction, estimate.match.degenerate),
    ):
        array[...] = 1
    assert len(before) == 12
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(kept, name), value, err_msg=name)


def test_a_block_holds_a_row_for_every_scan(two_scans):
    block = ScanBatch.of([ScanCopy.of(step, 500) for step in two_scans])
    assert list(block.index) == [0, 1] and len(block) == 2
    np.testing.assert_array_equal(block.best, [step.estimate.best for step in two_scans])
    np.testing.assert_allclose(block.particles.rows()[1], two_scans[1].estimate.particles, atol=1e-6)
    assert block.truth.shape == (2, 3) and block.correction.shape == (2, 3)
    assert block.degenerate[0] is None and list(block.degenerate[1]) == [1.0, 0.0]


def test_what_one_scan_lacks_the_block_leaves_out(two_scans):
    whole, bare = ScanCopy.of(two_scans[0], 500), ScanCopy.of(two_scans[1], 500)
    block = ScanBatch.of([whole, replace(bare, truth=None, correction=None, curves={"n_eff": 3.0})])
    assert block.truth is None and block.correction is None
    assert set(block.curves) == {"n_eff"} and block.curves["n_eff"][1] == 3.0


def test_ragged_rows_are_cut_by_a_mask():
    ragged = Ragged.of([np.arange(3), np.zeros(0, int), np.arange(3, 5)])
    assert [list(row) for row in ragged.rows()] == [[0, 1, 2], [], [3, 4]]
    kept = ragged.where(np.array([True, False, True, False, True]))
    assert [list(row) for row in kept.rows()] == [[0, 2], [], [4]]
    assert list(kept.lengths) == [2, 0, 1]
