import numpy as np
from numpy.typing import NDArray

from pfslam_viz.viewer.trail import Trail, level_pieces, level_strips


def test_the_three_are_exactly_the_points_so_far() -> None:
    """Of 30 scans, whose cube root is about 3: a strip of all every 9, one since then every 3, and the rest."""
    poses = np.arange(90.0).reshape(30, 3)
    trail = Trail(30)
    for block in (poses[:4], poses[4:5], poses[5:]):
        first = int(block[0, 0] / 3)
        done, between, strips = trail.extend(block)
        for row, strip in enumerate(strips):
            k = first + row
            np.testing.assert_array_equal(strip, poses[k // 3 * 3 : k + 1, :2])
        assert [first + row for row, _ in done] == [k for k in range(first, first + len(block)) if k % 9 == 0]
        assert [first + row for row, _ in between] == [k for k in range(first, first + len(block)) if k % 3 == 0]
        for row, strip in done:
            np.testing.assert_array_equal(strip, poses[: first + row + 1, :2])
        for row, strip in between:
            np.testing.assert_array_equal(strip, poses[(first + row) // 9 * 9 : first + row + 1, :2])


def test_a_long_trail_stays_small() -> None:
    """8 times the scans, 16 times the points, and not 23 as with a strip every square root of them."""
    sizes = []
    for scans in (1_000, 8_000):
        done, between, strips = Trail(scans).extend(np.zeros((scans, 3)))
        sizes.append(sum(len(strip) for _, strip in [*done, *between]) + sum(map(len, strips)))
    assert sizes[1] < 17 * sizes[0] and sizes[1] < 2 * 8_000 ** (4 / 3)


def test_pieces_of_one_level_meet() -> None:
    points = np.array([[0, 0, 9], [1, 0, 2], [2, 0, 2], [3, 0, 5], [4, 0, 2]], np.float32)
    pieces = [(strip[:, 0].tolist(), level) for strip, level in level_pieces(points)]
    assert pieces == [([0, 1, 2], 2), ([2, 3], 5), ([3, 4], 2)]  # the way to a point shows that point's level
    assert level_pieces(points[:1]) == [] and level_pieces(points[:0]) == []
    assert [(len(strip), level) for strip, level in level_pieces(points[:3])] == [(3, 2)]


def plain_pieces(points: NDArray[np.float32]) -> list[tuple[NDArray[np.float32], int]]:
    """One trail's pieces, cut where the level changes."""
    levels = points[1:, 2].astype(int)
    ends = [*(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)] if len(levels) else []
    starts = [0, *ends[:-1]]
    return [(points[a : b + 1, :2], int(levels[a])) for a, b in zip(starts, ends, strict=False)]


def test_pieces_of_many_trails_are_those_of_each() -> None:
    """Of none, one and two points too, where the next trail goes on with the same level."""
    rng = np.random.default_rng(3)
    trails = [
        np.column_stack([rng.normal(size=(m, 2)), rng.integers(0, 3, m)]).astype(np.float32)
        for m in (0, 5, 1, 0, 2, 2, 40, 1, 7, 0)
    ]
    trails[5][:, 2] = trails[4][:, 2]
    for some in (trails, trails[6:7], trails[:1], trails[2:4]):
        points, lengths, levels, counts = level_strips(some)
        pieces = [plain_pieces(trail) for trail in some]
        assert counts.tolist() == [len(own) for own in pieces]
        flat = [piece for own in pieces for piece in own]
        assert lengths.tolist() == [len(strip) for strip, _ in flat] and levels.tolist() == [level for _, level in flat]
        np.testing.assert_array_equal(points, np.concatenate([np.zeros((0, 2)), *(strip for strip, _ in flat)]))
