"""Resampling is unbiased, whatever the weights: as many copies as N w on average, by a chi-squared test."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2

from pfslam_viz.settings import ResamplingConfig
from pfslam_viz.slam.resampling import SCHEMES, effective_number, is_due

Array = NDArray[np.float64]

RUNS = 300
UNLIKELY = 1e-9  # what chance alone would exceed once in so many tries

WEIGHTS = st.lists(
    st.floats(0.0, 1.0) | st.sampled_from([0.0, 1e-300, 1e-17, 1.0]), min_size=1, max_size=40
).filter(lambda w: sum(w) > 1e-6).map(lambda w: np.array(w) / sum(w))  # fmt: skip


@pytest.mark.parametrize("scheme", sorted(SCHEMES))
@given(weights=WEIGHTS, seed=st.integers(0, 2**32 - 1))
def test_copies_are_as_many_and_as_ordered_as_they_should(scheme: str, weights: Array, seed: int) -> None:
    n = len(weights)
    drawn = SCHEMES[scheme](weights, np.random.default_rng(seed))
    assert drawn.shape == (n,) and drawn.min() >= 0 and drawn.max() < n
    assert (weights[drawn] > 0).all() and (np.diff(drawn) >= 0).all()
    copies = np.bincount(drawn, minlength=n)
    if scheme in ("residual", "systematic"):  # no particle loses a whole copy that is due to it
        assert (copies >= np.floor(n * weights - 1e-9)).all()
    if scheme == "systematic":
        assert (copies <= np.ceil(n * weights + 1e-9)).all()


@pytest.mark.parametrize("scheme", sorted(SCHEMES))
@given(weights=WEIGHTS, seed=st.integers(0, 2**32 - 1))
@settings(max_examples=8)
def test_resampling_is_unbiased(scheme: str, weights: Array, seed: int) -> None:
    """Pearson's statistic of all copies against N w; no scheme varies more than multinomial draws do.

    Weights too small to be expected five times in all are counted as one.
    """
    rng, n = np.random.default_rng(seed), len(weights)
    copies = np.zeros(n)
    for _ in range(RUNS):
        copies += np.bincount(SCHEMES[scheme](weights, rng), minlength=n)
    expected = RUNS * n * weights
    rare = expected < 5.0
    observed = np.append(copies[~rare], copies[rare].sum())
    due = np.append(expected[~rare], expected[rare].sum())
    observed, due = observed[due > 0], due[due > 0]
    assert observed.sum() == RUNS * n
    if due[-1] < 5.0:  # too rare even together
        assert observed[-1] <= 40
        observed, due = observed[:-1], due[:-1]
    statistic = float(((observed - due) ** 2 / due).sum())
    assert statistic <= chi2.isf(UNLIKELY, max(len(due) - 1, 1)) + 1e-6


@given(weights=WEIGHTS)
def test_the_effective_number_lies_between_one_and_all(weights: Array) -> None:
    n = len(weights)
    number = effective_number(weights)
    assert 1.0 - 1e-9 <= number <= n * (1 + 1e-9)
    assert effective_number(np.repeat(weights, 3) / 3) == pytest.approx(3 * number)  # three of each are worth thrice
    assert is_due(weights, ResamplingConfig(policy="n_eff", threshold=0.5)) == (number < 0.5 * n)
