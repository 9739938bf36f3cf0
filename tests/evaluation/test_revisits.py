"""Revisits in a simulated room: a robot drives its round twice, and the second round's estimate is moved."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pfslam_viz import geometry
from pfslam_viz.evaluation.revisits import match, revisit_error, revisits, shared_view
from pfslam_viz.recordings.recording import Lidar, Recording

ROOM = np.array(  # an L-shaped room of 6 x 5 m with a pillar, as segments x1 y1 x2 y2
    [
        [-3, -2, 3, -2],
        [3, -2, 3, 1],
        [3, 1, 1, 1],
        [1, 1, 1, 3],
        [1, 3, -3, 3],
        [-3, 3, -3, -2],
        [-1.9, 1, -1.6, 1],
        [-1.6, 1, -1.6, 1.3],
        [-1.6, 1.3, -1.9, 1.3],
        [-1.9, 1.3, -1.9, 1],
    ]
)
ANGLES = np.radians(np.linspace(-135, 135, 361))


def cast(pose: np.ndarray, segments: np.ndarray = ROOM) -> np.ndarray:
    """Ranges (361,) from ``pose`` by intersecting every beam with every wall."""
    direction = np.stack([np.cos(ANGLES + pose[2]), np.sin(ANGLES + pose[2])], axis=-1)[:, None]
    start, along = segments[:, :2], segments[:, 2:] - segments[:, :2]
    to = start - pose[:2]
    cross = direction[..., 0] * along[:, 1] - direction[..., 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / cross
        u = (to[:, 0] * direction[..., 1] - to[:, 1] * direction[..., 0]) / cross
    ranges: np.ndarray = np.where((t > 0) & (u >= 0) & (u <= 1), t, 99.0).min(axis=1)
    return ranges


@pytest.fixture(scope="module")
def drive() -> tuple[Recording, np.ndarray]:
    """Two rounds of 6.3 m in 80 s, and the true poses; 1 cm of noise on the ranges."""
    rng = np.random.default_rng(5)
    phase = np.linspace(0, 4 * np.pi, 160)
    truth = np.stack([np.cos(phase) - 0.2, np.sin(phase), geometry.wrap(phase + np.pi / 2)], axis=-1)
    ranges = np.array([cast(pose) for pose in truth])
    ranges += rng.normal(0, 0.01, ranges.shape)
    steps = np.zeros_like(truth)
    steps[1:] = geometry.between(truth[:-1], truth[1:])
    lidar = Lidar(ANGLES, 0.1, 30.0, np.zeros(3))
    recording = Recording("room", "test", Path("room"), np.arange(160.0) * 0.5, ranges.astype(np.float32), lidar, steps)
    return recording, truth


def test_pairs_are_apart_in_time_and_close_in_space(drive: tuple[Recording, np.ndarray]) -> None:
    recording, truth = drive
    pairs = revisits(recording, truth)
    assert len(pairs) >= 8
    i, j = pairs.T
    assert (recording.stamps[j] - recording.stamps[i] > 30).all()
    assert (np.hypot(*(truth[j] - truth[i])[:, :2].T) < 1).all()
    quick = replace(recording, stamps=recording.stamps / 2)
    i, j = revisits(quick, truth).T
    assert len(i) and (quick.stamps[j] - quick.stamps[i] > 30).all()
    assert len(revisits(recording, truth[:55])) == 0  # not yet round
    assert revisit_error(recording, truth[:55]) is None


def test_a_true_trajectory_agrees_with_itself(drive: tuple[Recording, np.ndarray]) -> None:
    recording, truth = drive
    error = revisit_error(recording, truth)
    assert error is not None and error.count >= 8
    assert error.translation < 0.01
    assert error.rotation < 0.3


@pytest.mark.parametrize("moved", [[0.25, 0.0, 0.0], [0.3, -0.4, 0.1]])
def test_finds_how_far_the_second_round_is_off(drive: tuple[Recording, np.ndarray], moved: list[float]) -> None:
    recording, truth = drive
    estimate = truth.copy()
    estimate[80:] = estimate[80:] + moved
    error = revisit_error(recording, estimate)
    assert error is not None and error.count >= 5
    assert error.translation == pytest.approx(np.hypot(moved[0], moved[1]), abs=0.02)
    assert error.rotation == pytest.approx(np.degrees(moved[2]), abs=0.3)


def test_match_is_exact_where_the_scans_are() -> None:
    target = cast(np.zeros(3))[:, None] * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)
    pose = np.array([0.133, -0.217, 0.047])
    source = geometry.transform(geometry.inverse(pose), target)
    start = np.array([-0.1, 0.05, -0.03])
    move = match(target, source, start)
    assert move is not None
    assert move == pytest.approx(pose - start, abs=1e-4)


def test_movement_along_a_bare_corridor_counts_as_none() -> None:
    x = np.linspace(-6, 6, 240)
    walls = np.concatenate([np.stack([x, np.full_like(x, y)], axis=-1) for y in (-1.0, 1.0)])
    move = match(walls, walls, np.array([0.4, 0.2, 0.0]))
    assert move is not None
    assert move[0] == pytest.approx(0.0, abs=0.01)
    assert move[1] == pytest.approx(-0.2, abs=0.01)


def test_scans_of_different_places_do_not_match() -> None:
    rng = np.random.default_rng(0)
    assert match(rng.uniform(-3, 0, (200, 2)), rng.uniform(5, 9, (200, 2)), np.zeros(3)) is None


def test_shared_view() -> None:
    """A 270 degree scanner that comes back the other way still sees 90 degrees on either side again."""
    steps = np.zeros((1, 3))
    lidar = Lidar(ANGLES, 0.1, 30.0, np.zeros(3))
    wide = Recording("w", "test", Path("w"), np.zeros(1), np.zeros((1, 361), np.float32), lidar, steps)
    seen = np.degrees(shared_view(wide, np.radians([0.0, 30.0, 120.0, 180.0])))
    assert seen == pytest.approx([270, 240, 180, 180])
