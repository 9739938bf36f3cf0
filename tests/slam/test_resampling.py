"""N_eff and the resampling schemes, (30) to (32)."""

import numpy as np
import pytest

from pfslam_viz.settings import ResamplingConfig
from pfslam_viz.slam.resampling import SCHEMES, effective_number, is_due

WEIGHTS = np.array([0.5, 0.24, 0.01, 0.0, 0.25])


class Fixed(np.random.Generator):
    """A generator whose every draw is the same number."""

    def __init__(self, value: float) -> None:
        super().__init__(np.random.PCG64(0))
        self.value = value

    def random(self, size=None):  # type: ignore[no-untyped-def,override]
        return self.value if size is None else np.full(size, self.value)


@pytest.mark.parametrize(
    ("weights", "n_eff"),
    [([0.25] * 4, 4.0), ([1.0, 0, 0, 0], 1.0), ([0.5, 0.5, 0, 0], 2.0), ([0.5, 0.25, 0.25], 1 / 0.375)],
)
def test_effective_number(weights: list[float], n_eff: float) -> None:
    assert effective_number(np.array(weights)) == pytest.approx(n_eff)


def test_always_is_due_always_and_n_eff_under_its_threshold() -> None:
    even, uneven = np.full(4, 0.25), np.array([0.8, 0.2, 0.0, 0.0])  # N_eff 4 and 1.47
    assert is_due(even, ResamplingConfig(policy="always"))
    half = ResamplingConfig(policy="n_eff", threshold=0.5)
    assert not is_due(even, half)
    assert is_due(uneven, half)
    assert not is_due(uneven, ResamplingConfig(policy="n_eff", threshold=0.3))


@pytest.mark.parametrize("scheme", sorted(SCHEMES))
def test_mean_number_of_copies_is_n_times_the_weight(scheme: str) -> None:
    rng, runs = np.random.default_rng(5), 4000
    copies = np.array([np.bincount(SCHEMES[scheme](WEIGHTS, rng), minlength=5) for _ in range(runs)])
    assert (copies.sum(axis=1) == 5).all()
    assert (copies[:, 3] == 0).all()
    sigma = np.sqrt(5 * WEIGHTS * (1 - WEIGHTS) / runs)  # multinomial's; the others vary less
    assert (np.abs(copies.mean(axis=0) - 5 * WEIGHTS) <= 4.5 * sigma + 1e-9).all()


@pytest.mark.parametrize(("scheme", "spread"), [("multinomial", 1.25), ("stratified", None), ("systematic", 0.25)])
def test_variance_of_copies(scheme: str, spread: float | None) -> None:
    """Particle 0 has 2.5 expected copies: N w (1 - w) = 1.25 multinomially; 2 or 3, so 0.25, systematically."""
    rng = np.random.default_rng(6)
    copies = np.array([np.sum(SCHEMES[scheme](WEIGHTS, rng) == 0) for _ in range(4000)])
    if spread is None:
        assert copies.var() < 1.0
    else:
        assert copies.var() == pytest.approx(spread, rel=0.1)


def test_residual_keeps_the_whole_copies() -> None:
    rng = np.random.default_rng(7)
    for _ in range(200):
        copies = np.bincount(SCHEMES["residual"](np.array([0.5, 0.3, 0.2]), rng), minlength=3)
        assert copies[0] >= 1 and copies[1] >= 0 and copies.sum() == 3
    exact = SCHEMES["residual"](np.array([0.5, 0.25, 0.25, 0.0]), rng)
    assert exact.tolist() == [0, 0, 1, 2]


def test_systematic_by_hand() -> None:
    """Cumulative 0.5, 0.74, 0.75, 0.75, 1; positions (k + 0.3) / 5 = 0.06, 0.26, 0.46, 0.66, 0.86."""
    assert SCHEMES["systematic"](WEIGHTS, Fixed(0.3)).tolist() == [0, 0, 0, 1, 4]


@pytest.mark.parametrize("scheme", sorted(SCHEMES))
@pytest.mark.parametrize("value", [0.0, np.nextafter(1.0, 0.0)])
def test_extreme_draws_pick_no_particle_without_weight(scheme: str, value: float) -> None:
    weights = np.concatenate([[0.0], np.full(499, 1 / 500), [0.002 - 1e-12, 0.0]])
    drawn = SCHEMES[scheme](weights, Fixed(value))
    assert drawn.min() >= 1 and drawn.max() <= 500
