"""Walls that several scans saw: against a plain twin, walls of known direction, and drives whose end it improves."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import GraphConfig, ScanMatchingConfig
from pfslam_viz.slam.graph.smoothing import Smoother

Array = NDArray[np.float64]

ANGLES = np.radians(np.linspace(-90, 90, 91))
LIDAR = np.array([0.2, 0.0])
WALLS = np.array(
    [(-3.0, -1.5, 20.0, -1.5), (-3.0, 1.5, 20.0, 1.5), (20.0, -1.5, 20.0, 1.5), (4.0, 1.1, 4.6, 1.1), (4, 1.1, 4, 1.5)]
)


@dataclass(frozen=True)
class Drive:
    """Key scans in a store, and their true poses (k, 3)."""

    store: ScanStore
    poses: Array


def drive(noise: float = 0.01, seed: int = 0, **settings: Any) -> Drive:
    """Twelve metres along a corridor, weaving a little, a scan of up to 8 m every 0.25 m."""
    rng = np.random.default_rng(seed)
    x = np.arange(0.0, 12.0, 0.25)
    poses = np.stack([x, 0.2 * np.sin(x), 0.2 * np.cos(x)], axis=-1)
    lidars = geometry.compose(poses, np.array([*LIDAR, 0.0]))
    store = ScanStore(LIDAR, ScanMatchingConfig.model_validate(settings))
    for ranges in true_ranges(WALLS, lidars, ANGLES)[0]:
        seen = ranges < 8.0
        noisy = (ranges + noise * rng.standard_normal(len(ranges)))[seen]
        store.add(LIDAR + np.stack([noisy * np.cos(ANGLES[seen]), noisy * np.sin(ANGLES[seen])], axis=-1))
    return Drive(store, poses)


def plain(given: Drive, scan: int) -> Array:
    """The normals (m, 2) that scan ``scan`` shares with others: by distances between all end points."""
    store, c = given.store, given.store.config
    near = range(max(scan - c.shared_scans, 0), min(scan + c.shared_scans + 1, len(store)))
    points, own = [], []
    for other in near:
        pose = geometry.between(given.poses[scan], given.poses[other])
        points.append(geometry.transform(pose, store.points_of(other)))
        rows = slice(store.first[other], store.first[other + 1])
        own.append(geometry.transform(np.array([0.0, 0.0, pose[2]]), store.own_normals[rows].astype(float)))
    everyone, facing = np.concatenate(points), np.concatenate(own)
    mine = store.points_of(scan)
    out = store.own_normals[store.first[scan] : store.first[scan + 1]].astype(np.float64)
    for b, point in enumerate(mine):
        alike = facing @ store.own_normals[store.first[scan] + b].astype(np.float64) >= 0
        together = everyone[(np.hypot(*(everyone - point).T) <= c.shared_reach) & alike]
        if len(together) < c.fewest_shared:
            continue
        values, vectors = np.linalg.eigh(np.cov(together.T))
        if values[0] <= c.wall_flatness * values[1]:
            normal = vectors[:, 0]
            out[b] = normal if normal @ (LIDAR - point) > 0 else -normal
    return out


def normals_of(store: ScanStore, scan: int) -> Array:
    return store.normals[store.first[scan] : store.first[scan + 1]].astype(np.float64)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"shared_scans": 3},
        {"shared_reach": 0.4},
        {"shared_reach": 1.3},  # nearly as far as the walls are: end points far apart by bearing are within reach
        {"fewest_shared": 30},
        {"wall_flatness": 0.02},
    ],
)
def test_normals_equal_their_plain_twin(settings: dict[str, Any]) -> None:
    given = drive(**settings)
    given.store.share_walls(given.poses)
    for scan in (0, 5, 20, len(given.store) - 1):
        np.testing.assert_allclose(normals_of(given.store, scan), plain(given, scan), atol=1e-4)


def test_end_points_that_are_alone_in_their_scan_lie_on_walls_together() -> None:
    """Half of those without a normal get one, and it is that of a wall: all stand along the axes of the map."""
    given = drive()
    alone, none_before, none_after = [], 0, 0
    given.store.share_walls(given.poses)
    for scan, pose in enumerate(given.poses):
        own = given.store.own_normals[given.store.first[scan] : given.store.first[scan + 1]]
        together = normals_of(given.store, scan)
        new = together.any(axis=1) & ~own.any(axis=1)
        heading = np.arctan2(together[new, 1], together[new, 0]) + pose[2]
        alone.append(np.abs((heading + np.pi / 4) % (np.pi / 2) - np.pi / 4))
        none_before += int((~own.any(axis=1)).sum())
        none_after += int((~together.any(axis=1)).sum())
    assert none_after < 0.6 * none_before
    assert np.median(np.concatenate(alone)) < 0.03


def test_what_other_scans_do_not_see_as_a_wall_stays_as_it_was() -> None:
    """Poses that are half a metre off put no line together; nor do scans with no other near them."""
    given = drive()
    rng = np.random.default_rng(1)
    before = given.store.normals.copy()
    given.store.share_walls(given.poses + rng.normal(0.0, [0.5, 0.5, 0.5], given.poses.shape))
    changed = (given.store.normals != before).any(axis=1)
    np.testing.assert_array_equal(given.store.normals[~changed], given.store.own_normals[~changed])
    assert changed.mean() < 0.5
    given.store.share_walls(given.poses * [100.0, 1.0, 1.0])
    np.testing.assert_array_equal(given.store.own_normals, before)
    assert (given.store.normals != before).any(axis=1).mean() < 0.1


def test_the_other_side_of_a_thin_wall_does_not_count() -> None:
    """Its sides are 3 cm apart and not parallel, by 0.2 rad; one scan sees it from below, the other from above."""
    x = np.linspace(-0.3, 0.3, 61)
    below = np.stack([x, np.zeros(61)], axis=-1)
    above = np.stack([x, 0.03 + 0.2 * x], axis=-1)
    poses = np.array([[0.0, -1.5, 0.5 * np.pi], [0.0, 1.5, -0.5 * np.pi]])
    store = ScanStore(np.zeros(2), ScanMatchingConfig())
    for pose, wall in zip(poses, (below[::-1], above), strict=True):
        store.add(geometry.transform(geometry.between(pose, np.zeros(3)), wall))
    store.share_walls(poses)
    np.testing.assert_allclose(normals_of(store, 0), np.tile([-1.0, 0.0], (61, 1)), atol=1e-3)  # to the lidar


def test_sharing_again_begins_with_each_scans_own() -> None:
    """So that it does not matter what was shared before, nor whether all is done at once or part after part."""
    one, other = drive(), drive()
    one.store.share_walls(one.poses)
    other.store.share_walls(other.poses + np.array([0.3, 0.2, 0.1]) * np.arange(len(other.poses))[:, None])
    for since in range(0, len(other.poses), 7):
        other.store.share_walls(other.poses[: since + 7], since)
    np.testing.assert_array_equal(one.store.normals, other.store.normals)


def test_none_are_shared_if_it_is_switched_off() -> None:
    given = drive(shared_scans=0)
    given.store.share_walls(given.poses)
    np.testing.assert_array_equal(given.store.normals, given.store.own_normals)


def test_a_trajectory_is_settled_better_with_shared_walls() -> None:
    """Matches from the true poses: their mean heading error is less, over eight drives."""
    errors = {}
    for shared in (0, 12):
        missed = []
        for seed in range(8):
            given = drive(seed=seed, shared_scans=shared)
            steps = geometry.between(given.poses[:-1], given.poses[1:])
            odometry = np.vstack([np.zeros(3), steps])
            settled = Smoother(given.store, odometry, steps, GraphConfig()).smooth(given.poses).poses
            missed.append(geometry.wrap(settled[1:, 2] - given.poses[1:, 2]))
        errors[shared] = np.sqrt(np.square(np.concatenate(missed)).mean())
    assert errors[0] > 0.0015
    assert errors[12] < 0.75 * errors[0]


def test_matches_go_by_the_shared_walls_from_then_on() -> None:
    """Also those of poses that were matched just before, which are kept otherwise."""
    given = drive()
    steps = geometry.between(given.poses[:-1], given.poses[1:])
    smoother = Smoother(given.store, np.vstack([np.zeros(3), steps]), steps, GraphConfig())
    gates = np.array([0.2, 0.1])
    alone = smoother.relax(given.poses, gates)[0]
    np.testing.assert_array_equal(smoother.relax(given.poses, gates)[0], alone)
    smoother.share_walls(given.poses)
    assert not np.array_equal(smoother.relax(given.poses, gates)[0], alone)
