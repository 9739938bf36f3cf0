"""What a viewer is told when the trajectory so far turns out to be another: trail, maps, closed loops, events."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.replay import Result
from pfslam_viz.slam.occupancy_grid import OccupancyGrid
from pfslam_viz.slam.protocol import Estimate, LoopClosure, Revision
from pfslam_viz.step import Step
from pfslam_viz.viewer import entities
from pfslam_viz.viewer.collector import Collector, StreamOptions
from pfslam_viz.viewer.contents import Boxes, Cells, Lines, Spots, grid_map
from pfslam_viz.viewer.events import Chronicle
from pfslam_viz.viewer.trail import Strips, Trail

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor

Array = NDArray[np.float64]
Points = NDArray[np.float32]

SCANS = 20


# The trail


def shown(done: Strips, between: Strips, strips: Sequence[Points], row: int) -> list[list[float]]:
    """The points on the screen at a row: of each of the three the newest, which begin where the one before ends."""
    whole: list[list[float]] = [strip for at, strip in done if at <= row][-1].tolist()
    for stretch in ([strip for at, strip in between if at <= row][-1], strips[row]):
        assert stretch[0].tolist() == whole[-1]
        whole += stretch[1:].tolist()
    return whole


def along(count: int, y: float = 0.0) -> Points:
    return np.column_stack([np.arange(count), np.full(count, y)]).astype(np.float32)


def test_all_that_came_before_jumps_where_it_is_revised() -> None:
    """A done strip every 9 of 16 scans. After the sixth all so far lies 1 m to the left, the newest pose included."""
    poses = np.column_stack([along(16), np.zeros(16)]).astype(np.float64)
    poses[6:, 1] = 1.0
    revised: list[Points | None] = [None] * 16
    revised[5] = along(6, 1.0)
    done, between, strips = Trail(16).extend(poses, revised)
    assert [row for row, _ in done] == [0, 5, 9]
    for row in range(16):
        assert shown(done, between, strips, row) == along(row + 1, 0.0 if row < 5 else 1.0).tolist()


def test_a_revision_reaches_back_over_batches() -> None:
    """Points of earlier calls are changed too; a second revision changes those of the first. The input stays."""
    trail = Trail(16)
    trail.extend(np.column_stack([along(6), np.zeros(6)]).astype(np.float64))
    anew = along(9, 2.0)
    poses = np.zeros((5, 3))
    poses[:, 0] = np.arange(6, 11)
    done, between, strips = trail.extend(poses, [None, None, anew, None, along(11, 3.0)])
    assert [row for row, _ in done] == [2, 3, 4]  # the tenth scan is the one that was due
    assert done[0][1].tolist() == along(9, 2.0).tolist()
    assert shown(done, between, strips, 3) == [*along(9, 2.0).tolist(), [9.0, 0.0]]
    assert shown(done, between, strips, 4) == along(11, 3.0).tolist()
    np.testing.assert_array_equal(anew, along(9, 2.0))


def test_a_trail_without_revisions_is_as_ever() -> None:
    poses = np.column_stack([along(10), np.zeros(10)]).astype(np.float64)
    one, other = Trail(10).extend(poses), Trail(10).extend(poses, [None] * 10)
    assert [row for row, _ in one[0]] == [row for row, _ in other[0]] == [0, 4, 8]
    for a, b in zip(one[2], other[2], strict=True):
        np.testing.assert_array_equal(a, b)


# The collector and the list of events


def revision(count: int, moved: float, *pairs: tuple[int, int]) -> Revision:
    """All so far moved by 0.5 m to the left; a loop for every pair of scans."""
    trajectory = np.column_stack([0.1 * np.arange(count), np.full(count, 0.5), np.zeros(count)])
    closures = tuple(LoopClosure(a, b, trajectory[a, :2].copy(), trajectory[b, :2].copy()) for a, b in pairs)
    return Revision(trajectory, closures, moved)


def steps_of(corridor: "Corridor", revisions: dict[int, Revision]) -> list[Step]:
    """Two particles that drive along x; the map is another one after each revision, with so many walls."""
    stamps = corridor.recording.stamps
    grids = [OccupancyGrid(corridor.config.map) for _ in range(len(revisions) + 1)]
    for k, grid in enumerate(grids):
        grid.add(np.zeros(3), np.array([[1.0 + 0.5 * j, 0.7] for j in range(k + 1)]), np.zeros(2))
    reckoned = OccupancyGrid(corridor.config.map)
    out = []
    for k in range(SCANS):
        pose = np.array([0.1 * k, 0.0, 0.0])
        particles = np.stack([pose, pose + np.array([0.0, 0.1, 0.0])])
        estimate = Estimate(
            particles=particles,
            weights=np.array([0.6, 0.4]),
            best=pose,
            mean=pose,
            covariance=np.eye(3) * 0.01,
            n_eff=1.92,
            resampled=False,
            informative=True,
            parents=np.arange(2),
        )
        since = sum(at <= k for at in revisions)
        points = np.array([[1.0, 0.7]])
        out.append(
            Step(
                index=k,
                stamp=float(stamps[k]),
                time=float(stamps[k] - stamps[0]),
                estimate=estimate,
                dead_reckoning=pose,
                end_points=points,
                hits=np.array([True]),
                dead_reckoning_end_points=points,
                grid=grids[since],
                dead_reckoning_grid=reckoned,
                revision=revisions.get(k),
                texture=None,
                color_frame=None,
                disparity_frame=None,
                truth=None,
                seconds={"update": 0.001},
            )
        )
    return out


def result_of(corridor: "Corridor", steps: list[Step], closures: tuple[LoopClosure, ...]) -> Result:
    online = np.array([s.estimate.best for s in steps])
    return Result(
        recording=corridor.recording,
        config=corridor.config,
        stamps=corridor.recording.stamps[: len(steps)],
        estimate=online,
        online=online,
        dead_reckoning=online,
        truth=None,
        grid=steps[-1].grid,
        dead_reckoning_grid=steps[-1].dead_reckoning_grid,
        seconds={},
        resamplings=0,
        uninformative=0,
        interrupted=False,
        closures=closures,
        texture=None,
        skipped_frames=None,
    )


def test_what_is_revised_is_an_event(plain_corridor: "Corridor") -> None:
    """A loop is told whatever it moves; without one, 10 cm and less are a detail."""
    revisions = {
        4: revision(5, 0.04),
        8: revision(9, 0.1),
        9: revision(10, 0.114),
        15: revision(16, 0.024, (2, 14), (3, 15)),
        19: revision(20, 1.5, (0, 19)),
    }
    chronicle = Chronicle(plain_corridor.recording, plain_corridor.config)
    told = [e for step in steps_of(plain_corridor, revisions) for e in chronicle.add(step)]
    assert [(e.step, e.level, e.line) for e in told] == [
        (4, "DEBUG", "4: revised, moved by 0.04 m"),
        (8, "DEBUG", "8: revised, moved by 0.10 m"),
        (9, "INFO", "9: revised, moved by 0.11 m"),
        (15, "INFO", "15: loop closed with scan 2, revised, moved by 0.02 m"),
        (19, "INFO", "19: loop closed with scan 0, revised, moved by 1.50 m"),
    ]
    assert told[3].seconds == pytest.approx(15 * 0.25)


def test_loops_that_were_told_on_the_way_are_not_told_again(plain_corridor: "Corridor") -> None:
    """Scan 15's was; scan 2's is new."""
    revisions = {15: revision(16, 0.5, (2, 14), (3, 15))}
    steps = steps_of(plain_corridor, revisions)
    chronicle = Chronicle(plain_corridor.recording, plain_corridor.config)
    for step in steps:
        list(chronicle.add(step))
    ends = (*revisions[15].closures, *revision(20, 0.0, (0, 2)).closures)
    found = list(chronicle.finish(result_of(plain_corridor, steps, ends), painted_anew=False))
    assert [(e.step, e.text) for e in found] == [(2, "loop closed with scan 0")]


@pytest.fixture
def collected(plain_corridor: "Corridor") -> tuple[Collector, list[Step]]:
    """Maps every 100 scans otherwise; revised after scan 7, and after scan 13 with two loops, after 17 with one."""
    revisions = {7: revision(8, 0.2), 13: revision(14, 0.5, (0, 12), (1, 13)), 17: revision(18, 0.3, (4, 16))}
    steps = steps_of(plain_corridor, revisions)
    collector = Collector(plain_corridor.recording, plain_corridor.config, StreamOptions(map_every=100))
    for step in steps:
        collector.add(step)
    return collector, steps


def test_the_map_is_drawn_anew_with_a_revision(collected: tuple[Collector, list[Step]]) -> None:
    """At the scan itself, though none is due; with the walls of the new one: 1, 2, 3 and 4 of them."""
    collector, steps = collected
    _, taken = collector.take()
    maps = [c for c in taken if c.path == entities.MAP.path(entities.ONLY_RUN)]
    assert [c.step for c in maps] == [0, 7, 13, 17]
    drawn = [c.content.values for c in maps if isinstance(c.content, Cells)]
    for step, values in zip((0, 7, 13, 17), drawn, strict=True):
        np.testing.assert_array_equal(values, grid_map(steps[step].grid).values)
    assert len({values.tobytes() for values in drawn}) == 4
    walls = {c.step: c.content for c in taken if c.path == entities.WALLS.path(entities.ONLY_RUN)}
    boxes = [walls[step] for step in (0, 7, 13, 17)]
    assert [len(content.centers) for content in boxes if isinstance(content, Boxes)] == [1, 2, 3, 4]


def test_the_trajectory_so_far_comes_with_the_scan(collected: tuple[Collector, list[Step]]) -> None:
    collector, steps = collected
    batch, _ = collector.take()
    assert batch is not None
    assert [k for k, anew in enumerate(batch.revised) if anew is not None] == [7, 13, 17]
    for k in (7, 13, 17):
        step, anew = steps[k], batch.revised[k]
        assert anew is not None and step.revision is not None
        np.testing.assert_allclose(anew, step.revision.trajectory[:, :2], atol=1e-6)


def test_closed_loops_are_drawn_as_they_come(collected: tuple[Collector, list[Step]]) -> None:
    """Two of them after scan 13, a third after scan 17: those before stay."""
    collector, _ = collected
    _, taken = collector.take()
    found = [c for c in taken if c.path == entities.CLOSURES.path(entities.ONLY_RUN)]
    assert [c.step for c in found] == [13, 17]
    first, second = (c.content for c in found)
    assert isinstance(first, Lines) and isinstance(second, Lines)
    pairs = [[[0.0, 0.5], [1.2, 0.5]], [[0.1, 0.5], [1.3, 0.5]], [[0.4, 0.5], [1.6, 0.5]]]
    np.testing.assert_allclose(np.array(first.strips), pairs[:2], atol=1e-6)
    np.testing.assert_allclose(np.array(second.strips), pairs, atol=1e-6)


def test_a_closed_loop_is_marked_on_the_map(collected: tuple[Collector, list[Step]]) -> None:
    """Where the robot was after scans 13 and 17, as at the end of a run; the revision without a loop is not."""
    collector, _ = collected
    _, taken = collector.take()
    found = [c for c in taken if c.path == entities.CLOSED_AT.path(entities.ONLY_RUN)]
    assert [c.step for c in found] == [13, 17]
    last = found[-1].content
    assert isinstance(last, Spots)
    np.testing.assert_allclose(last.points, [[1.3, 0.0], [1.7, 0.0]], atol=1e-6)


def test_events_are_collected_with_their_scans(collected: tuple[Collector, list[Step]]) -> None:
    collector, _ = collected
    _, taken = collector.take()
    notes = [c for c in taken if c.path == entities.EVENTS.path(entities.ONLY_RUN)]
    assert [c.step for c in notes] == [7, 13, 17]
