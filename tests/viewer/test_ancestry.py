import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.viewer.ancestry import Ancestry


def poses(*x: float) -> NDArray[np.float64]:
    return np.array([[value, 0.0, 0.0] for value in x])


def test_counts_the_founders_that_still_have_descendants() -> None:
    ancestry = Ancestry()
    everyone = np.arange(4)
    assert ancestry.add(poses(0, 1, 2, 3), everyone) == 4
    assert ancestry.add(poses(0, 1, 2, 3), np.array([0, 0, 1, 2])) == 3  # founder 3 died out
    assert ancestry.add(poses(0, 1, 2, 3), np.array([0, 0, 1, 1])) == 1  # all descend from founder 0 now
    assert ancestry.add(poses(0, 1, 2, 3), np.array([0, 1, 2, 2])) == 3  # counted anew from the scan before


def test_segments_lead_from_ancestors_to_descendants() -> None:
    ancestry = Ancestry()
    ancestry.add(poses(0, 10), np.arange(2))
    ancestry.add(poses(1, 11), np.arange(2))
    ancestry.add(poses(2, 3), np.array([0, 0]))  # both from the first particle
    segments = ancestry.segments()[:, :, 0]
    assert sorted(map(tuple, segments.tolist())) == [(0.0, 1.0), (1.0, 2.0), (1.0, 3.0)]


def test_another_number_of_particles_and_unknown_parents_begin_anew() -> None:
    ancestry = Ancestry()
    ancestry.add(poses(0, 1, 2), np.arange(3))
    assert ancestry.add(poses(0, 1), np.array([2, 0])) == 2
    assert ancestry.add(poses(0, 1), np.array([1, 1])) == 1
    assert ancestry.add(poses(0, 1), np.array([5, 1])) == 2  # there is no particle 5
    assert len(ancestry.segments()) == 0
    assert len(Ancestry().segments()) == 0


@pytest.mark.parametrize("scans", [3, 30, 31, 75])  # less than the window, the whole of it, round it once and more
def test_segments_of_random_lineages(scans: int) -> None:
    """Against following each particle back by hand, one scan after the other."""
    rng, n = np.random.default_rng(scans), 7
    ancestry, positions, parents = Ancestry(window=30), [], []
    for _ in range(scans):
        positions.append(np.round(rng.normal(size=(n, 3)), 3).astype(np.float32))
        parents.append(rng.integers(0, n, n))
        ancestry.add(positions[-1].astype(float), parents[-1])
    pieces = set()
    for particle in range(n):
        for newer in range(scans - 1, max(scans - 30, 0), -1):
            older = parents[newer][particle]
            pieces.add((tuple(positions[newer - 1][older, :2]), tuple(positions[newer][particle, :2])))
            particle = older
    drawn = [tuple(map(tuple, piece)) for piece in ancestry.segments()]
    assert set(drawn) == pieces and len(drawn) == len(pieces)  # each once
