"""Steps by conjugate gradients with old factors lead where factoring anew at every step does."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.slam.graph import pose_graph
from pfslam_viz.slam.graph.pose_graph import Constraints, optimize

Array = NDArray[np.float64]


@pytest.fixture
def factored(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The sizes of the matrices that are factored."""
    sizes: list[int] = []
    splu = scipy.sparse.linalg.splu

    def counted(matrix: Any, **options: Any) -> Any:
        sizes.append(matrix.shape[0])
        return splu(matrix, **options)

    monkeypatch.setattr(scipy.sparse.linalg, "splu", counted)
    return sizes


def anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Conjugate gradients never get there."""
    useless: Callable[..., tuple[Array, int]] = lambda matrix, right, **_: (np.full_like(right, np.nan), 1)  # noqa: E731
    monkeypatch.setattr(scipy.sparse.linalg, "cg", useless)


def rounds(seed: int, robust: bool) -> tuple[Array, Constraints]:
    """Three times round a square of 4 m with every pose measured from the one a round before, and a false closure.

    The start has drifted by metres; measured is the truth, with noise.
    """
    rng = np.random.default_rng(seed)
    steps = np.tile([0.4, 0.0, 0.0], (120, 1))
    steps[9::10, 2] = math.pi / 2
    truth = np.vstack([np.zeros(3), geometry.accumulate(steps)])
    drifted = np.vstack([np.zeros(3), geometry.accumulate(steps + rng.normal(0.0, [0.01, 0.01, 0.01], (120, 3)))])
    start = np.concatenate([np.arange(120), np.arange(81), [3]])
    end = np.concatenate([np.arange(1, 121), np.arange(40, 121), [20]])
    measured = geometry.between(truth[start], truth[end]) + rng.normal(0.0, [0.005, 0.005, 0.002], (202, 3))
    measured[-1] += [3.0, 0.0, 0.0]
    information = np.tile(np.diag([200.0**2, 50.0**2, 500.0**2]), (202, 1, 1))
    flags = np.full(202, robust)
    flags[-1] = True
    return drifted, Constraints(start, end, measured, information, flags)


def relax(poses: Array, constraints: Constraints, iterations: int = 30, settled: float = 1e-7) -> Array:
    return optimize(
        poses, constraints, iterations=iterations, scale=5.0, settled_distance=settled, settled_angle=settled
    )


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_poses_whether_factored_once_or_at_every_step(
    seed: int, robust: bool, factored: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    poses, constraints = rounds(seed, robust)
    found = relax(poses, constraints)
    few = len(factored)
    factored.clear()
    anew(monkeypatch)
    exact = relax(poses, constraints)
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-4)
    assert np.abs(found - poses)[:, :2].max() > 0.1  # there was something to do
    assert len(factored) > 2 and few < len(factored) and set(factored) == {360}


def test_a_second_step_costs_no_factors_where_weights_stay(factored: list[int]) -> None:
    """Nothing is robust, and the poses hardly turn: the matrix is nearly the one of the step before."""
    poses, constraints = rounds(2, False)
    nearly = relax(poses, constraints.firm().pick(np.arange(201)))
    factored.clear()
    moved = nearly + np.random.default_rng(3).normal(0, 1e-3, nearly.shape) * (np.arange(121) > 0)[:, None]
    found = relax(moved, constraints.firm().pick(np.arange(201)))
    assert len(factored) == 1
    np.testing.assert_allclose(found, nearly, rtol=0.0, atol=1e-5)


def test_too_few_gradients_are_not_taken_for_a_solution(factored: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    """One is not enough from far: every step is factored, and the result is the same."""
    poses, constraints = rounds(0, False)
    expected = relax(poses, constraints)
    factored.clear()
    monkeypatch.setattr(pose_graph, "MOST_GRADIENTS", 1)
    monkeypatch.setattr(pose_graph, "CLOSE", 1e-14)
    found = relax(poses, constraints, iterations=4, settled=1e-12)
    assert len(factored) == 4
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-4)
