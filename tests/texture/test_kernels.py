"""The merging of a frame into the texture, against plain NumPy and numbers worked out by hand."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.texture.kernels import blend, match, merge


def test_merge_matches_the_plain_twin() -> None:
    """Sums, numbers of pixels and mean colours where the frame has pixels; everything else stays as it was."""
    rng = np.random.default_rng(3)
    shape = (11, 17)
    count = rng.integers(0, 4, shape).astype(np.float32)
    colors = rng.integers(0, 256, (*shape, 3))
    patch = np.concatenate([colors * count[..., None], count[..., None]], axis=-1).astype(np.float32)
    before = rng.integers(0, 5, shape).astype(np.float32)
    total = (rng.integers(0, 256, (*shape, 3)) * before[..., None]).astype(np.float32)
    weight, color = before.copy(), rng.integers(0, 256, (*shape, 3), dtype=np.uint8)
    sums, old = total + patch[..., :3], color.copy()
    touched = count > 0
    expected = np.where(touched[..., None], np.rint(sums / np.maximum(before + count, 1.0)[..., None]), old)
    assert merge(patch, total, weight, color) == touched.sum()
    np.testing.assert_array_equal(total, sums)
    np.testing.assert_array_equal(weight, before + count)
    np.testing.assert_array_equal(color, expected)


def seen_and_painted(
    gain: tuple[float, float, float], cells: tuple[int, int] = (40, 60)
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """A frame of 20 pixels a cell, and what is painted there: its colours times ``gain``, of 50 pixels a cell."""
    colors = np.random.default_rng(5).uniform(60, 150, (*cells, 3))
    patch = np.concatenate([20 * colors, np.full((*cells, 1), 20.0)], axis=-1).astype(np.float32)
    return patch, (50 * colors * gain).astype(np.float32), np.full(cells, 50, np.float32)


def test_match_finds_each_channels_gain() -> None:
    """A quarter of the 2,400 cells is compared: 600 / 605 of the logarithm of the gain; nothing is new."""
    patch, total, weight = seen_and_painted((1.25, 0.8, 1.0))
    found = np.log(match(patch, total, weight))
    np.testing.assert_allclose(found, np.log([1.25, 0.8, 1.0]) * 600 / 605, atol=0.5 / 92)  # half a bin


def test_match_does_not_mind_a_third_of_other_things() -> None:
    patch, total, weight = seen_and_painted((1.25, 1.25, 1.25))
    total[:13] *= 0.3  # other things are painted there
    np.testing.assert_allclose(match(patch, total, weight), 1.25, rtol=0.02)


def test_match_leaves_a_tenth_out_over_new_floor() -> None:
    """60 % of the cells are new, 240 of 600 compared: 1 - 0.06 of the logarithm is left, and 240 / 245 of that."""
    patch, total, weight = seen_and_painted((2.0, 2.0, 2.0))
    weight[:, 24:] = 0.0
    expected = np.log(2.0) * 0.94 * 240 / 245
    np.testing.assert_allclose(np.log(match(patch, total, weight)), expected, atol=0.5 / 92)


def test_match_believes_few_cells_less() -> None:
    """5 cells compared: half of the logarithm. And none: no gain."""
    patch, total, weight = seen_and_painted((2.0, 2.0, 2.0), (2, 10))
    np.testing.assert_allclose(np.log(match(patch, total, weight)), 0.5 * np.log(2.0), atol=0.5 / 92)
    np.testing.assert_array_equal(match(patch, total, np.zeros_like(weight)), 1.0)


def test_match_leaves_out_what_is_dark_or_cut_off() -> None:
    """Where blue is dark it has the other channels' mean; where all is overexposed nothing can be told."""
    patch, total, weight = seen_and_painted((1.21, 1.21, 1.0))
    patch[..., 2], total[..., 2] = 20 * 3.0, 50 * 9.0
    np.testing.assert_allclose(match(patch, total, weight), 1.21, rtol=0.012)
    patch[..., :3] = 20 * 255.0
    np.testing.assert_array_equal(match(patch, total, weight), 1.0)


def test_blend_by_hand() -> None:
    """Cells with a finest view of 10 pixels, 30 of colour 30 in all, and views of colour 60 and gain 1.5."""
    views = [0, 4, 8, 10, 20, 21]
    patch = np.array([[(60 * n, 60 * n, 60 * n, n) for n in views]], np.float32)
    weight, finest = np.full((1, 6), 30, np.float32), np.full((1, 6), 10, np.float32)
    total = np.full((1, 6, 3), 30 * 30, np.float32)
    color = np.full((1, 6, 3), 30, np.uint8)
    assert blend(patch, np.array([1.5, 1.0, 0.5]), total, weight, finest, color) == 5
    # 4 of 10 are too coarse; 8 weigh 8 * 0.8; 10 weigh 10; 20 weigh 20, what was before as one view of 10, halved; to
    # 21 that is too coarse.
    np.testing.assert_allclose(weight, [[30, 30, 36.4, 40, 25, 21]], rtol=1e-6)
    np.testing.assert_array_equal(finest, [[10, 10, 10, 10, 20, 21]])
    # red, as 90: (900 + 6.4 * 90) / 36.4 = 40.5; (900 + 10 * 90) / 40 = 45; (5 * 30 + 20 * 90) / 25 = 78; 90
    assert color[0, :, 0].tolist() == [30, 30, 41, 45, 78, 90]
    # green, as 60: (900 + 384) / 36.4 = 35.3; 37.5; (150 + 1200) / 25 = 54; 60. Blue is as painted, 30.
    assert color[0, :, 1].tolist() == [30, 30, 35, 38, 54, 60]
    assert color[0, :, 2].tolist() == [30] * 6


def test_blend_cuts_at_white() -> None:
    patch = np.array([[(4 * 250.0, 4 * 100.0, 0.0, 4.0)]], np.float32)
    arrays = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32), np.zeros((1, 1), np.float32)
    color = np.zeros((1, 1, 3), np.uint8)
    blend(patch, np.full(3, 1.5), *arrays, color)
    assert color.tolist() == [[[255, 150, 0]]]


@pytest.mark.parametrize("first", [20, 50])
def test_many_coarse_views_do_not_overrule_a_fine_one(first: int) -> None:
    """A view of 100 pixels and thousands of 49, in either order."""
    total, weight, finest = np.zeros((1, 1, 3), np.float32), np.zeros((1, 1), np.float32), np.zeros((1, 1), np.float32)
    color, none = np.zeros((1, 1, 3), np.uint8), np.ones(3)
    for k in range(3000):
        n, value = (100, 200.0) if k == first else (49, 50.0)
        blend(np.array([[(n * value, n * value, n * value, n)]], np.float32), none, total, weight, finest, color)
    assert color.tolist() == [[[200, 200, 200]]]
