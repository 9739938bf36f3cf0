"""Readings that are written twice."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pfslam_viz as pf
from pfslam_viz.recordings.checking.check import check
from pfslam_viz.recordings.checking.draft import Draft
from pfslam_viz.recordings.checking.repeated import check_repeated
from pfslam_viz.recordings.recording import Recording


def recording(ranges: NDArray[Any], first: float = -1.5, step: float = 0.03) -> Recording:
    scans, beams = ranges.shape
    odometry = np.stack([np.full(scans, 0.05), np.zeros(scans), np.zeros(scans)], axis=-1)
    angles = first + step * np.arange(beams)
    return pf.Recording.from_arrays(0.1 * np.arange(scans), ranges, angles, odometry, range_max=10.0)


def readings(beams: int, none: float = 0.0, scans: int = 40) -> NDArray[Any]:
    """In cm, a tenth of them no return; different from one to the next as walls are."""
    rng = np.random.default_rng(0)
    ranges = np.round(3.0 + 2.0 * np.sin(0.3 * np.arange(beams)) + 0.05 * rng.standard_normal((scans, beams)), 2)
    ranges[:, : beams // 10] = none
    return np.asarray(ranges)


@pytest.mark.parametrize("none", [0.0, 8.0])
def test_of_each_two_the_first_is_used(none: float) -> None:
    """91 readings in 181 beams from -1.5 rad on: at -1.5, -1.44, ... rad."""
    single = readings(91, none)
    found = check(recording(np.repeat(single, 2, axis=1)[:, :181]))
    np.testing.assert_array_equal(found.ranges, single.astype(np.float32))
    np.testing.assert_allclose(found.lidar.angles, -1.5 + 0.06 * np.arange(91))
    (finding,) = [f for f in found.findings if f.what == "beams_repeated"]
    assert finding.severity == "note" and "of 181 beams 91," in finding.message


def test_with_an_even_number_it_is_not_known_which_angle_is_right() -> None:
    found = check(recording(np.repeat(readings(90), 2, axis=1), step=np.radians(0.5)))
    assert found.ranges.shape == (40, 90)
    (finding,) = [f for f in found.findings if f.what == "beams_repeated"]
    assert finding.severity == "doubtful" and "turned by 0.5 degrees" in finding.advice


@pytest.mark.parametrize("of", ["single", "smooth", "stretches", "shifted", "some"])
def test_other_lidars_are_left_alone(of: str) -> None:
    """Single readings; walls so smooth that neighbours are often or mostly alike; a first one alone."""
    single = readings(181)
    twice = np.repeat(readings(91), 2, axis=1)[:, :181]
    ranges = {
        "single": single,
        "smooth": np.round(single, 0),
        "stretches": np.repeat(readings(5), 40, axis=1)[:, :181],
        "shifted": np.concatenate([single[:, :1], twice[:, :-1]], axis=1),
        "some": np.concatenate([twice[:, :100], single[:, 100:]], axis=1),
    }[of]
    given = recording(ranges)
    found = check(given)
    assert found.ranges.shape == (40, 181)
    assert all(f.what != "beams_repeated" for f in found.findings)


def test_beams_keep_their_times() -> None:
    given = recording(np.repeat(readings(91), 2, axis=1)[:, :181])
    times = np.linspace(-0.1, 0.0, 181)
    draft = Draft(replace(given, beam_times=times))
    check_repeated(draft)
    np.testing.assert_array_equal(draft.recording.beam_times, times[::2])
