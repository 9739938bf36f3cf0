import numpy as np

from pfslam_viz.viewer.trail import Trail, level_pieces


def test_done_and_open_are_exactly_the_points_so_far() -> None:
    poses = np.arange(30.0).reshape(10, 3)
    trail = Trail(10)  # a done strip every 3 scans
    for block in (poses[:4], poses[4:5], poses[5:]):
        first = int(block[0, 0] / 3)
        finished, strips = trail.extend(block)
        for row, strip in enumerate(strips):
            k = first + row
            start = (k // 3) * 3
            np.testing.assert_array_equal(strip, poses[start : k + 1, :2])
        assert [first + row for row, _ in finished] == [k for k in range(first, first + len(block)) if k % 3 == 0]
        for row, strip in finished:
            np.testing.assert_array_equal(strip, poses[: first + row + 1, :2])


def test_pieces_of_one_level_meet() -> None:
    points = np.array([[0, 0, 9], [1, 0, 2], [2, 0, 2], [3, 0, 5], [4, 0, 2]], np.float32)
    pieces = [(strip[:, 0].tolist(), level) for strip, level in level_pieces(points)]
    assert pieces == [([0, 1, 2], 2), ([2, 3], 5), ([3, 4], 2)]  # the way to a point shows that point's level
    assert level_pieces(points[:1]) == [] and level_pieces(points[:0]) == []
    assert [(len(strip), level) for strip, level in level_pieces(points[:3])] == [(3, 2)]
