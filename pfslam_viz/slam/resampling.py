"""When particles are resampled, and how: equations (30) to (32)."""

from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from pfslam_viz.settings import ResamplingConfig

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


def effective_number(weights: Array) -> float:
    """Effective sample size N_eff, (30), of weights (N,) that sum to 1: N when all are equal, 1 when one has all."""
    return float(1.0 / np.sum(weights**2))


def is_due(weights: Array, config: ResamplingConfig) -> bool:
    """Whether the configured policy resamples now."""
    return config.policy == "always" or effective_number(weights) < config.threshold * len(weights)


def multinomial(weights: Array, rng: Generator) -> Indices:
    """N independent draws, (31)."""
    return _pick(weights, np.sort(rng.random(len(weights))))


def systematic(weights: Array, rng: Generator) -> Indices:
    """One draw, N equal strides: the low-variance sampler (Thrun, Burgard & Fox 2005, table 4.4)."""
    n = len(weights)
    return _pick(weights, (np.arange(n) + rng.random()) / n)


def stratified(weights: Array, rng: Generator) -> Indices:
    """One draw in each of N equal strata (Kitagawa 1996)."""
    n = len(weights)
    return _pick(weights, (np.arange(n) + rng.random(n)) / n)


def residual(weights: Array, rng: Generator) -> Indices:
    """floor(N w) copies of each, the rest drawn from what is left (Liu & Chen 1998)."""
    n = len(weights)
    copies = np.floor(n * weights).astype(np.intp)
    sure = np.repeat(np.arange(n), copies)
    rest = n * weights - copies
    missing = n - len(sure)
    if missing == 0:
        return sure
    drawn = _pick(rest / rest.sum(), np.sort(rng.random(missing)))
    return np.sort(np.concatenate([sure, drawn]))


SCHEMES: dict[str, Callable[[Array, Generator], Indices]] = {
    "multinomial": multinomial,
    "systematic": systematic,
    "stratified": stratified,
    "residual": residual,
}


def _pick(weights: Array, positions: Array) -> Indices:
    """The particles (k,) into whose share of [0, 1) the ascending positions (k,) fall; never one without weight."""
    from pfslam_viz.slam import kernels

    return kernels.pick(weights, positions)
