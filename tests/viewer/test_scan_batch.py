from copy import deepcopy
from dataclasses import fields, replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from pfslam_viz.step import Step
from pfslam_viz.viewer.scan_batch import Ragged, ScanBatch, ScanCopy, stride

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor


@pytest.fixture
def two_scans(corridor: "Corridor") -> list[Step]:
    steps = corridor.steps()
    return [next(steps), next(steps)]


def test_end_points_are_thinned_with_their_hits(two_scans: list[Step]) -> None:
    step = two_scans[1]
    kept = ScanCopy.of(step, 10)  # 91 beams, every tenth
    np.testing.assert_array_equal(kept.end_points, step.end_points[::10].astype(np.float32))
    np.testing.assert_array_equal(kept.hits, step.hits[::10])
    assert kept.curves["correlation"] == pytest.approx(step.hits.mean())  # of all of them
    assert [stride(total, 10) for total in (0, 1, 10, 11, 91)] == [1, 1, 1, 2, 10]


def test_a_scan_is_copied(two_scans: list[Step]) -> None:
    step = deepcopy(two_scans[1])  # the truth in it is the recording's own
    kept = ScanCopy.of(step, 500)
    before = {
        f.name: np.array(value) for f in fields(ScanCopy) if isinstance(value := getattr(kept, f.name), np.ndarray)
    }
    estimate, match, truth = step.estimate, step.estimate.match, step.truth
    assert match is not None and match.degenerate is not None and truth is not None
    for array in (
        *(estimate.particles, estimate.weights, estimate.best, estimate.mean, estimate.covariance),
        *(step.end_points, step.hits, step.dead_reckoning_end_points, step.dead_reckoning, truth),
        *(match.correction, match.degenerate),
    ):
        array[...] = 1
    assert len(before) == 12
    for name, value in before.items():
        np.testing.assert_array_equal(getattr(kept, name), value, err_msg=name)


def test_a_batch_holds_a_row_for_every_scan(two_scans: list[Step]) -> None:
    batch = ScanBatch.of([ScanCopy.of(step, 500) for step in two_scans])
    assert list(batch.index) == [0, 1] and len(batch) == 2
    np.testing.assert_array_equal(batch.best, [step.estimate.best for step in two_scans])
    np.testing.assert_allclose(batch.particles.rows()[1], two_scans[1].estimate.particles, atol=1e-6)
    assert batch.truth is not None and batch.truth.shape == (2, 3)
    assert batch.correction is not None and batch.correction.shape == (2, 3)
    assert batch.degenerate[0] is None and np.array_equal(np.asarray(batch.degenerate[1]), [1.0, 0.0])


def test_what_one_scan_lacks_the_batch_leaves_out(two_scans: list[Step]) -> None:
    whole, bare = ScanCopy.of(two_scans[0], 500), ScanCopy.of(two_scans[1], 500)
    batch = ScanBatch.of([whole, replace(bare, truth=None, correction=None, curves={"n_eff": 3.0})])
    assert batch.truth is None and batch.correction is None
    assert set(batch.curves) == {"n_eff"} and batch.curves["n_eff"][1] == 3.0


def test_ragged_rows_are_cut_by_a_mask() -> None:
    ragged = Ragged.of([np.arange(3), np.zeros(0, int), np.arange(3, 5)])
    assert [list(row) for row in ragged.rows()] == [[0, 1, 2], [], [3, 4]]
    kept = ragged.where(np.array([True, False, True, False, True]))
    assert [list(row) for row in kept.rows()] == [[0, 2], [], [4]]
    assert list(kept.lengths) == [2, 0, 1]
