"""The merging of a frame into the texture, against plain NumPy."""

import numpy as np

from pfslam_viz.texture.kernels import merge


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
