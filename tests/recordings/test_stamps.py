import numpy as np

from pfslam_viz.recordings.stamps import order, spread_repeats


def test_order_sorts_and_says_how_often_stamps_ran_backwards() -> None:
    notes: list[str] = []
    kept = order(np.array([3.0, 1.0, np.nan, 2.0, 1.0]), "lidar", notes)
    assert kept.tolist() == [1, 4, 3, 0]
    assert "1 samples without" in notes[0]
    assert "backwards 2 times" in notes[1]


def test_samples_of_equal_stamp_keep_their_order() -> None:
    stamps = np.concatenate([np.ones(500), np.zeros(500)])
    expected = [*range(500, 1000), *range(500)]
    assert order(stamps, "lidar", []).tolist() == expected


def test_order_leaves_what_is_in_order_alone() -> None:
    notes: list[str] = []
    assert order(np.array([1.0, 1.0, 2.0]), "lidar", notes).tolist() == [0, 1, 2]
    assert notes == []


def test_repeats_are_spread_up_to_the_next_stamp() -> None:
    spread = spread_repeats(np.array([0.0, 1.0, 1.0, 1.0, 4.0, 5.0, 5.0]))
    # 1, 1, 1 before 4 stand 1 s apart; after the last stamp the median gap (1 s) is shared by two.
    np.testing.assert_allclose(spread, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 5.5])


def test_all_stamps_equal() -> None:
    np.testing.assert_allclose(spread_repeats(np.full(3, 7.0), spacing=0.1), [7.0, 7.1, 7.2])


def test_distinct_stamps_stay() -> None:
    stamps = np.array([0.0, 0.5, 3.0])
    assert spread_repeats(stamps).tolist() == [0.0, 0.5, 3.0]
