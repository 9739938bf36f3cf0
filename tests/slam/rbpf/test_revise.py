"""A loop closed while the robot drives: what becomes of the particles, their maps and their histories."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import load_config
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.evidence import Verdict
from pfslam_viz.slam.graph.smoothing import Smoothed, Smoother
from pfslam_viz.slam.protocol import Estimate, Revision, Scan
from pfslam_viz.slam.rbpf import rao_blackwellized
from pfslam_viz.slam.rbpf.rao_blackwellized import RaoBlackwellizedFilter
from pfslam_viz.slam.rbpf.tile_maps import TileMaps, TileSettings

Array = NDArray[np.float64]

ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 181)
LIDAR = np.zeros(2)
BLIND = range(160, 200)  # scans on the far side of the block: the lidar sees nothing, and the wheels slip by 1.3 m
SETTINGS = ["particles=5", "loop_closing.least_reach=3.0", "revision.regular_share=10.0"]  # looks back for loops alone


@dataclass
class State:
    """Copies of what a filter holds."""

    particles: Array
    estimate: Estimate
    key_poses: Array
    found: Array
    grid: Array
    maps: list[Array]
    trajectory: Array

    @classmethod
    def of(cls, slam: RaoBlackwellizedFilter) -> "State":
        return cls(
            slam._particles.copy(),
            slam.estimate(),
            slam._history.key_poses(slam._leader),
            slam._history.increments(slam._leader),
            known(slam.grid.log_odds, slam.grid.origin),
            [known(*slam._maps.log_odds_of(p)) for p in range(5)],
            slam.trajectory(),
        )


@dataclass
class Drive:
    """The filter at the end of it, and as it was right before and after its first closed loop at so many scans."""

    slam: RaoBlackwellizedFilter
    truth: Array
    before: State
    after: State
    revision: Revision
    scans: int
    leader: int
    again: Revision | None
    estimates: list[Estimate]
    maps: list[Array]  # before the end, when all is settled


def known(log_odds: NDArray[np.float32], origin: NDArray[np.int64] | tuple[int, int]) -> Array:
    """(c, 3): row and column, counted from the world's origin, and log-odds of the cells where that is not 0."""
    at = np.argwhere(log_odds)
    return np.column_stack([at - np.asarray(origin), log_odds[at[:, 0], at[:, 1]]])


@pytest.fixture(scope="module")
def drive(block: Array) -> Drive:
    """Round the block, 10 cm or 9 degrees a scan, and 7 m of it again."""
    increments = [(0.0, 0.0, 0.0)]
    for side in (8.0, 6.0, 8.0, 6.0, 7.0):
        increments += [(0.1, 0.0, 0.0)] * round(side / 0.1) + [(0.0, 0.0, np.pi / 20)] * 10
    truth = geometry.accumulate(increments[:-10])
    odometry = np.array(increments[:-10])
    odometry[BLIND.start : BLIND.stop] += [0.03, 0.01, 0.0]
    rng = np.random.default_rng(0)
    slam = RaoBlackwellizedFilter(load_config("default", SETTINGS))
    states: tuple[State, State, Revision, int, int, Revision | None] | None = None
    estimates = []
    for k, ranges in enumerate(true_ranges(block, truth, ANGLES)[0]):
        noisy = ranges + 0.01 * rng.standard_normal(len(ranges))
        points = np.stack([noisy * np.cos(ANGLES), noisy * np.sin(ANGLES)], axis=-1)
        scan = Scan(k, 0.05 * k, points[: 0 if k in BLIND else None], LIDAR)
        if k:
            slam.predict(odometry[k], 0.05)
        slam.update(scan)
        slam.update_map(scan)
        slam.resample()
        looking = states is None and k > 280 and slam._keyed
        before = State.of(slam) if looking else None
        revision = slam.revise()
        if before is not None and revision is not None and revision.closures:
            states = before, State.of(slam), revision, k + 1, slam._leader, slam.revise()
        estimates.append(slam.estimate())
    assert states is not None
    maps = [known(*slam._maps.log_odds_of(p)) for p in range(5)]
    slam.finish()
    return Drive(slam, truth, *states, estimates, maps)


def off_by(poses: Array, truth: Array) -> float:
    """m, the farthest."""
    return float(np.hypot(*(poses - truth)[..., :2].T).max())


def test_the_loop_is_closed_where_the_filter_was_off(drive: Drive) -> None:
    """By more than a metre before, by centimetres after, now and all along the way since it came back."""
    assert off_by(drive.before.estimate.best, drive.truth[drive.scans - 1]) > 1.0
    assert off_by(drive.after.estimate.best, drive.truth[drive.scans - 1]) < 0.1
    assert off_by(drive.after.trajectory[290:], drive.truth[290 : drive.scans]) < 0.1
    assert drive.again is None  # nothing new has been seen


def test_all_particles_stand_where_the_trajectory_ends(drive: Drive) -> None:
    """The likeliest one at its last pose, the others as far from that one as they were."""
    before, after = drive.before.particles, drive.after.particles
    np.testing.assert_allclose(after[drive.leader], drive.revision.trajectory[-1], atol=1e-9)
    for p in range(5):
        kept = geometry.between(before[drive.leader], before[p])
        np.testing.assert_allclose(geometry.between(after[drive.leader], after[p]), kept, atol=1e-9)
    assert np.hypot(*(after - before)[:, :2].T).min() > 1.0


def test_the_estimate_moves_along(drive: Drive) -> None:
    """The same weights, the particles that they belong to, the best of them and the mean moved like all others."""
    before, after = drive.before.estimate, drive.after.estimate
    np.testing.assert_allclose(after.best, drive.revision.trajectory[-1], atol=1e-9)
    np.testing.assert_array_equal(after.weights, before.weights)
    np.testing.assert_array_equal(after.parents, before.parents)
    np.testing.assert_allclose(after.best, after.particles[np.argmax(after.weights)], atol=1e-9)
    relative = geometry.between(before.best, before.particles)
    np.testing.assert_allclose(geometry.between(after.best, after.particles), relative, atol=1e-9)
    np.testing.assert_allclose(
        geometry.between(after.best, after.mean), geometry.between(before.best, before.mean), atol=1e-9
    )
    np.testing.assert_allclose(drive.estimates[drive.scans - 1].best, after.best, atol=0)


def test_the_trajectory_is_the_revisions(drive: Drive) -> None:
    trajectory = drive.revision.trajectory
    assert trajectory.shape == (drive.scans, 3)
    np.testing.assert_array_equal(drive.after.trajectory, trajectory)
    keys = [key for key in drive.slam._history.keys if key < drive.scans]
    np.testing.assert_allclose(trajectory[keys], drive.after.key_poses, atol=1e-9)
    np.testing.assert_array_equal(trajectory[0], [0.0, 0.0, 0.0])
    moved = np.hypot(*(drive.after.key_poses - drive.before.key_poses)[:, :2].T)
    assert drive.revision.moved == pytest.approx(moved.max()) and moved.max() > 1.0


def test_what_the_filter_found_itself_is_kept(drive: Drive) -> None:
    np.testing.assert_allclose(drive.after.found, drive.before.found, atol=1e-9)
    steps = geometry.between(drive.after.key_poses[:-1], drive.after.key_poses[1:])
    assert np.abs(steps - drive.after.found).max() > 0.02  # which is not what is believed now


def test_every_map_is_drawn_from_the_revised_key_poses(drive: Drive) -> None:
    slam = drive.slam
    drawn = TileMaps(1, TileSettings.of(slam.config))
    for k, pose in enumerate(drive.after.key_poses):
        drawn.write(pose[None], slam._scans.points_of(k), LIDAR)
    expected = known(*drawn.log_odds_of(0))
    assert len(expected) > 1000 and not np.array_equal(drive.before.grid, expected)
    for cells in (drive.after.grid, *drive.after.maps):
        np.testing.assert_array_equal(cells, expected)


def test_the_loops_are_told_by_scans_and_places(drive: Drive) -> None:
    assert len(drive.revision.closures) >= 2
    for closure in drive.revision.closures:
        assert {closure.earlier, closure.later} <= set(drive.slam._history.keys)
        assert closure.earlier < 60 and 270 < closure.later < drive.scans
        np.testing.assert_allclose(closure.earlier_position, drive.revision.trajectory[closure.earlier, :2], atol=1e-9)
        np.testing.assert_allclose(closure.later_position, drive.revision.trajectory[closure.later, :2], atol=1e-9)


def test_the_filter_goes_on_from_there(drive: Drive) -> None:
    """To the end of the drive, with maps that have parted; the loops are among those of the whole run."""
    later = np.array([e.best for e in drive.estimates[drive.scans :]])
    assert len(later) > 10 and off_by(later, drive.truth[drive.scans :]) < 0.12
    assert not all(np.array_equal(cells, drive.maps[0]) for cells in drive.maps[1:])
    pairs = {(c.earlier, c.later) for c in drive.slam.closures}
    assert {(c.earlier, c.later) for c in drive.revision.closures} <= pairs
    assert off_by(drive.slam.trajectory()[-10:], drive.truth[-10:]) < 0.1


def test_nothing_is_revised_between_key_scans_or_where_that_is_off(
    block: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three key scans and one without motion; three are enough to look, so once, if at all."""
    for off, looks in (([], [3]), (["revision.enabled=false"], []), (["smoothing.enabled=false"], [])):
        slam = RaoBlackwellizedFilter(load_config("default", ["particles=2", "revision.every=1", *off]))
        asked: list[int] = []

        def note(smoother: Smoother, poses: Array, asked: list[int] = asked) -> None:
            asked.append(len(poses))

        monkeypatch.setattr(slam._reviser, "revise", note)
        for k, ahead in enumerate((0.0, 0.3, 0.3, 0.0)):
            ranges = true_ranges(block, np.array([[0.3 * min(k, 2), 0.0, 0.0]]), ANGLES)[0][0]
            points = np.stack([ranges * np.cos(ANGLES), ranges * np.sin(ANGLES)], axis=-1)
            if k:
                slam.predict(np.array([ahead, 0.0, 0.0]), 0.05)
            scan = Scan(k, 0.05 * k, points, LIDAR)
            slam.update(scan)
            slam.update_map(scan)
            slam.resample()
            assert slam.revise() is None
        assert asked == looks


@pytest.mark.parametrize(("moved", "sigmas", "own"), [(0.4, -9.0, False), (0.6, 1.9, True), (0.6, 2.1, False)])
def test_what_a_doubtful_revision_led_to_is_kept_only_where_the_scans_are_sure(
    moved: float, sigmas: float, own: bool, block: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first settling starts from what the run told, the second from the filter's own increments."""
    slam = RaoBlackwellizedFilter(load_config("default", ["particles=2"]))
    truth = geometry.accumulate([(0.0, 0.0, 0.0)] + [(0.2, 0.0, 0.0)] * 5)
    for k, ranges in enumerate(true_ranges(block, truth, ANGLES)[0]):
        if k:
            slam.predict(np.array([0.2, 0.0, 0.0]), 0.05)
        scan = Scan(k, 0.05 * k, np.stack([ranges * np.cos(ANGLES), ranges * np.sin(ANGLES)], axis=-1), LIDAR)
        slam.update(scan)
        slam.update_map(scan)
        slam.resample()
    settled = iter((np.full((6, 3), 0.1), np.full((6, 3), 0.2)))
    verdicts = iter(([Verdict(0.01, sigmas, 9)] if moved > 0.5 else []) + [Verdict(0.01, 3.0, 9)])
    monkeypatch.setattr(Smoother, "smooth", lambda *_: Smoothed(next(settled), np.zeros((0, 2), np.int64)))
    monkeypatch.setattr(rao_blackwellized, "compare", lambda *_, **__: next(verdicts))
    slam._reviser.moved = moved
    slam.finish()
    np.testing.assert_array_equal(slam._key_poses(), np.full((6, 3), 0.2 if own else 0.1))
    assert next(verdicts, None) is None
