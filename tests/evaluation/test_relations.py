"""Kümmerle's metric, worked by hand and against the published numbers of raw odometry."""

import bz2
import math
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.evaluation.relations import errors_of, nearest, relation_errors
from pfslam_viz.recordings.recording import Relations


def relations(*rows: tuple[float, float, float, float, float]) -> Relations:
    table = np.array(rows)
    return Relations(table[:, 0], table[:, 1], table[:, 2:])


def test_numbers_by_hand() -> None:
    stamps = np.array([0.0, 1.0, 2.0])
    poses = np.array([[1, 1, math.pi / 2], [1, 2, math.pi / 2], [0, 2, math.pi]])
    # From pose 0 to 1 the robot went 1 m straight on, to 2 it then went 1 m to the left and turned 90 deg.
    known = relations((0, 1, 0.7, 0.4, 0.0), (1, 2, 0, 1, math.radians(93)))
    errors = relation_errors(known, stamps, poses)
    assert errors is not None
    assert errors.matched == 2 and errors.unmatched == 0
    assert errors.translation.mean == pytest.approx(0.25) and errors.translation.std == pytest.approx(0.25)
    assert errors.rotation.mean == pytest.approx(1.5) and errors.rotation.std == pytest.approx(1.5)
    assert errors.translation_squared.mean == pytest.approx(0.125)
    assert errors.translation_squared.std == pytest.approx(0.125)
    assert errors.rotation_squared.mean == pytest.approx(4.5) and errors.rotation_squared.std == pytest.approx(4.5)


def test_error_is_gt_inverse_times_est() -> None:
    """Against homogeneous matrices."""

    def matrix(pose: np.ndarray) -> np.ndarray:
        c, s = math.cos(pose[2]), math.sin(pose[2])
        return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])

    rng = np.random.default_rng(4)
    poses, known = rng.normal(size=(40, 3)) * [5, 5, 2], rng.normal(size=(20, 3))
    poses[:, 2], known[:, 2] = geometry.wrap(poses[:, 2]), geometry.wrap(known[:, 2])
    i, j = rng.integers(0, 40, 20), rng.integers(0, 40, 20)
    translation, rotation, matched = errors_of(
        Relations(i.astype(np.float64), j.astype(np.float64), known), np.arange(40.0), poses
    )
    assert matched.all()
    for k in range(20):
        est = np.linalg.inv(matrix(poses[i[k]])) @ matrix(poses[j[k]])
        error = np.linalg.inv(matrix(known[k])) @ est
        assert translation[k] == pytest.approx(np.hypot(*error[:2, 2]))
        assert rotation[k] == pytest.approx(abs(np.degrees(np.arctan2(error[1, 0], error[0, 0]))))


def test_does_not_depend_on_the_frame() -> None:
    rng = np.random.default_rng(2)
    poses = geometry.accumulate(rng.normal([0.1, 0, 0], [0.02, 0.02, 0.1], (50, 3)))
    known = relations((0, 30, 1, 0, 0), (20, 5, 0, 1, 1))
    here = errors_of(known, np.arange(50.0), poses)
    there = errors_of(known, np.arange(50.0), geometry.compose([9.0, -4.0, 1.0], poses))
    np.testing.assert_allclose(here[0], there[0])
    np.testing.assert_allclose(here[1], there[1], atol=1e-9)


def test_counts_relations_without_a_scan() -> None:
    known = relations((0, 1, 0, 0, 0), (0, 1.5, 0, 0, 0), (7, 1, 0, 0, 0), (0.004, 1, 0, 0, 0))
    errors = relation_errors(known, [0.0, 1.0], np.zeros((2, 3)))
    assert errors is not None
    assert (errors.matched, errors.unmatched) == (2, 2)
    assert errors.translation.mean == 0.0
    assert relation_errors(relations((8, 9, 0, 0, 0)), [0.0, 1.0], np.zeros((2, 3))) is None


def test_nearest() -> None:
    assert nearest([0.0, 1.0, 3.0], [-5, 0.4, 0.6, 1.9, 2.1, 9]).tolist() == [0, 0, 1, 1, 2, 2]
    assert nearest([4.0], [1, 9]).tolist() == [0, 0]


@pytest.mark.parametrize(("log", "mean", "std"), [("intel", 7.370, 14.349), ("fr079", 6.504, 13.664)])
def test_raw_odometry_scores_as_published(shared_data: Path, log: str, mean: float, std: float) -> None:
    """The wheels' own poses, read here without the loader, give the benchmark's column to the millimetre."""
    stamps, poses = [], []
    with bz2.open(shared_data / "carmen" / f"{log}.clf.bz2", "rt") as lines:
        for line in lines:
            if line.startswith("FLASER"):
                words = line.split()
                tail = words[2 + int(words[1]) :]
                poses.append([float(word) for word in tail[3:6]])
                stamps.append(float(tail[6]))
    order = np.argsort(stamps, kind="stable")
    table = np.loadtxt(shared_data / "carmen" / f"{log}.relations")
    known = Relations(table[:, 0], table[:, 1], table[:, [2, 3, 7]])
    errors = relation_errors(known, np.array(stamps)[order], np.array(poses)[order])
    assert errors is not None
    assert errors.matched == len(table) and errors.unmatched == 0
    assert errors.translation.mean == pytest.approx(mean, abs=5e-4)
    assert errors.translation.std == pytest.approx(std, abs=5e-4)
