"""When a trajectory is looked at anew on the way, on key scans cast round a block with known truth."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph import revision
from pfslam_viz.slam.graph.evidence import Verdict
from pfslam_viz.slam.graph.odometry_errors import OdometryErrors
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.revision import Reviser
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import (
    GraphConfig,
    LoopClosingConfig,
    RevisionConfig,
    ScanMatchingConfig,
    SmoothingConfig,
)
from pfslam_viz.slam.graph.smoothing import Smoother

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 181)
BLIND = range(85, 100)


def settings(*, loops: bool = False, radius: float = 2.0, **revision: Any) -> GraphConfig:
    return GraphConfig(
        smoothing=SmoothingConfig(radius=radius),
        loop_closing=LoopClosingConfig(enabled=loops, least_reach=3.0),
        revision=RevisionConfig.model_validate(revision),
    )


@pytest.fixture(scope="module")
def truth() -> Array:
    """Once round the block, and 6 m of it again: a key scan every 0.2 m, or 9 degrees; from 160 on near the start."""
    increments = [(0.0, 0.0, 0.0)]
    for side in (8.0, 6.0, 8.0, 6.0, 6.0):
        increments += [(0.2, 0.0, 0.0)] * round(side / 0.2) + [(0.0, 0.0, math.pi / 20)] * 10
    return geometry.accumulate(increments[:-10])


@pytest.fixture(scope="module")
def scans(truth: Array, block: Array) -> ScanStore:
    return cast(block, truth)


def cast(walls: Array, poses: Array, blind: range = range(0)) -> ScanStore:
    """Scans with noise of 1 cm; those that are ``blind`` see nothing."""
    rng = np.random.default_rng(0)
    store = ScanStore(np.zeros(2), ScanMatchingConfig())
    for k, ranges in enumerate(true_ranges(walls, poses, ANGLES)[0]):
        noisy = ranges + 0.01 * rng.standard_normal(len(ranges))
        points = np.stack([noisy * np.cos(ANGLES), noisy * np.sin(ANGLES)], axis=-1)
        store.add(points[: 0 if k in blind else None])
    return store


def steps_of(poses: Array) -> Array:
    """Increments (k, 3) that lead to each pose; zero for the first."""
    return np.vstack([np.zeros(3), geometry.between(poses[:-1], poses[1:])])


def drifted(truth: Array, by: tuple[float, float, float], during: range) -> Array:
    """The same way, with so much added to every step of some."""
    steps = steps_of(truth)
    steps[during.start : during.stop] += by
    return geometry.accumulate(steps)


def off_by(poses: Array, truth: Array) -> float:
    """m, the farthest pose."""
    return float(np.hypot(*(poses - truth[: len(poses)])[:, :2].T).max())


def part(scans: ScanStore, count: int) -> ScanStore:
    """The first of them: what is in so far."""
    out = ScanStore(np.zeros(2), ScanMatchingConfig())
    for k in range(count):
        out.add(scans.points_of(k))
    return out


def smoother_of(scans: ScanStore, poses: Array, reviser: Reviser) -> Smoother:
    """A graph of as many scans as there are poses, where the filter and the odometry say what the poses do."""
    steps = steps_of(poses)
    return Smoother(part(scans, len(poses)), steps, steps[1:], reviser.config)


class Scripted(Smoother):
    """Matches scans as ever, but knows the answer, and keeps a list of what it was asked to do."""

    def __init__(self, scans: ScanStore, answer: Array, reviser: Reviser) -> None:
        steps = steps_of(answer)
        super().__init__(part(scans, len(answer)), steps, steps[1:], reviser.config)
        self.answer, self.asked, self.choice = answer, list[str](), True

    def learn_errors(self, poses: Array) -> OdometryErrors:
        """Nothing to learn."""
        return self.errors

    def relax(self, poses: Array, gates: Array) -> tuple[Array, float]:
        self.asked.append("held" if self.held else "free")
        return self.answer, 1.0

    def choose_held(self, poses: Array, sure: float) -> tuple[Array, float]:
        self.asked.append(f"chosen by {sure}")
        self.held = self.choice
        return self.answer, 1.0

    def close_best(self, poses: Array, support: float, loops: list[Constraints]) -> tuple[Array, float, Indices]:
        return poses, support, np.zeros((0, 2), np.int64)


def asked(reviser: Reviser, scans: ScanStore, poses: Array, counts: range, choice: bool = True) -> dict[int, str]:
    """What the smoother has to do as key scans come in; it never finds anything better."""
    found = {}
    for count in counts:
        smoother = Scripted(scans, poses[:count], reviser)
        smoother.choice = choice
        assert reviser.revise(smoother, poses[:count]) is None
        if smoother.asked:
            found[count] = ", ".join(smoother.asked)
    return found


# When to look, and when to do something about it


def test_it_is_due_after_so_many_key_scans(scans: ScanStore, truth: Array) -> None:
    reviser = Reviser(settings(every=5))
    assert [n for n in range(12) if reviser.is_due(n)] == [5, 6, 7, 8, 9, 10, 11]
    asked(reviser, scans, truth, range(12, 13))
    assert [n for n in range(30) if reviser.is_due(n)] == list(range(17, 30))
    assert [n for n in range(6) if Reviser(settings(every=1)).is_due(n)] == [3, 4, 5]  # two cannot be wrong


def test_it_is_never_due_where_it_is_switched_off() -> None:
    assert not Reviser(settings(enabled=False)).is_due(1000)
    never = GraphConfig(smoothing=SmoothingConfig(enabled=False))
    assert not Reviser(never).is_due(1000)


def test_the_mere_number_of_key_scans_is_a_reason_now_and_then(scans: ScanStore, truth: Array) -> None:
    """Nothing is off. 20 at first; then 30 % more, but no fewer than 20: 20, 40, 60, 80, 104, 136, 177, every fifth."""
    reviser = Reviser(settings(pause=20, regular_share=0.3))
    assert list(asked(reviser, scans, truth, range(5, 212, 5))) == [20, 40, 60, 80, 105, 140, 185]
    early = Reviser(settings(pause=20, regular_share=0.3, early=105))
    assert list(asked(early, scans, truth, range(5, 212, 5))) == [20, 40, 60, 80, 105]


def test_where_nothing_is_off_nothing_is_revised(scans: ScanStore, truth: Array) -> None:
    """The filter is right to 2 mm, at the start and where it comes back: the real smoother is asked, and agrees."""
    poses = truth + np.random.default_rng(1).normal(0.0, [0.002, 0.002, 0.0005], truth.shape)
    reviser = Reviser(settings(loops=True, regular_share=0.01))
    for count in (100, 170, 190, 210):
        assert reviser.revise(smoother_of(scans, poses[:count], reviser), poses[:count]) is None
    assert len(reviser.closed) == 0


@pytest.mark.parametrize(("asked_of", "taken"), [(-2.0, True), (-1.0, False)])
def test_a_revision_starts_from_straightened_poses_and_is_judged_as_such(
    asked_of: float, taken: bool, scans: ScanStore, truth: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The scans are against it by 1.5 standard errors. That matches were wrong is remembered, taken or not."""
    reviser = Reviser(settings(pause=20))
    smoother = Scripted(scans, truth[:20], reviser)
    straight: Array = truth[:20] + np.array([0.0, 0.1, 0.0])
    began: list[Array] = []

    def straighten(poses: Array) -> Array:
        smoother.misled = True
        return straight

    def relax(poses: Array, gates: Array) -> tuple[Array, float]:
        began.append(poses)
        return straight, 1.0

    monkeypatch.setattr(smoother, "straighten", straighten)
    monkeypatch.setattr(smoother, "relax", relax)
    monkeypatch.setattr(smoother, "asked_of", lambda *_: asked_of)
    monkeypatch.setattr(revision, "compare", lambda *_: Verdict(0.0, -1.5, 9))
    revised = reviser.revise(smoother, truth[:20])
    assert began[0] is straight
    assert (revised is not None) == taken
    assert reviser.misled


def test_going_against_proven_odometry_is_a_reason(scans: ScanStore, truth: Array) -> None:
    """The filter turns by 0.1 rad too far at 175; at 190 that is a reason, and at 210 it was one before."""
    poses = drifted(truth, (0.0, 0.0, 0.1), range(175, 176))
    found: dict[float, list[int]] = {}
    for proven in (1.0, 0.1):
        reviser = Reviser(settings(pause=20, pause_share=0.0, shift=9.0, turn=9.0, regular_share=10.0))
        found[proven] = []
        for count in (170, 190, 210):
            reviser.errors.proven = 1.0, proven
            smoother = Scripted(scans, poses[:count], reviser)
            smoother._odometry[1:] = geometry.between(truth[: count - 1], truth[1:count])
            reviser.revise(smoother, poses[:count])
            found[proven] += [count] if smoother.asked else []
    assert found == {1.0: [170], 0.1: [170, 190]}


def test_a_revision_has_to_wait_for_the_pause(scans: ScanStore, truth: Array) -> None:
    """Any visit is off by more than a nanometre. 20 key scans, or a fifth of all: 42 of 210 are more than 40."""
    always: dict[str, Any] = {"shift": 1e-9, "regular_share": 10.0}
    counts = range(170, 212, 5)
    soon = Reviser(settings(pause=20, pause_share=0.0, **always))
    assert list(asked(soon, scans, truth, counts)) == [170, 190, 210]
    late = Reviser(settings(pause=20, pause_share=0.2, **always))
    assert list(asked(late, scans, truth, counts)) == [170]
    shorter = Reviser(settings(pause=20, pause_share=0.19, **always))
    assert list(asked(shorter, scans, truth, counts)) == [170, 210]
    never = Reviser(settings(pause=20, pause_share=0.0, shift=1.0, turn=1.0, regular_share=10.0))
    assert list(asked(never, scans, truth, counts)) == [170]


@pytest.mark.parametrize(("limits", "reason"), [((1e-9, 9.0), True), ((9.0, 1e-9), True), ((9.0, 9.0), False)])
def test_visits_are_off_by_position_or_by_heading(
    limits: tuple[float, float], reason: bool, scans: ScanStore, truth: Array
) -> None:
    shift, turn = limits
    reviser = Reviser(settings(shift=shift, turn=turn, pause=20, pause_share=0.0, regular_share=10.0))
    assert list(asked(reviser, scans, truth, range(170, 191, 20))) == ([170, 190] if reason else [170])


@pytest.mark.parametrize(("limits", "reason"), [((1e-9, 9.0), True), ((9.0, 1e-9), True), ((9.0, 9.0), False)])
def test_once_there_is_more_of_a_map_visits_have_limits_of_their_own(
    limits: tuple[float, float], reason: bool, scans: ScanStore, truth: Array
) -> None:
    """At 170 key scans the mere number is a reason; at 190, past the early ones, only the visits can be."""
    late: dict[str, Any] = {"late_shift": limits[0], "late_turn": limits[1], "pause": 20, "pause_share": 0.0}
    for at in (1e-9, 9.0):
        reviser = Reviser(settings(shift=at, turn=at, regular_share=10.0, early=189, **late))
        assert list(asked(reviser, scans, truth, range(170, 191, 20))) == ([170, 190] if reason else [170])


def test_too_few_visits_are_no_reason(scans: ScanStore, truth: Array) -> None:
    """Key scans 0 to 149 are no visits to anywhere; 170 on are."""
    always: dict[str, Any] = {"shift": 1e-9, "regular_share": 10.0, "pause": 20, "pause_share": 0.0}
    assert list(asked(Reviser(settings(**always)), scans, truth, range(100, 151, 5))) == [100]
    picky = Reviser(settings(fewest_visits=1000, **always))
    assert list(asked(picky, scans, truth, range(170, 212, 5))) == [170]


# What comes of it


@pytest.mark.parametrize("off", [True, False])
def test_visits_that_do_not_match_are_laid_on_each_other(off: bool, scans: ScanStore, truth: Array) -> None:
    """The filter has drifted by 27 cm on the far side; 40 key scans since the last time are too few otherwise."""
    poses = drifted(truth, (0.01, 0.006, 0.002), range(100, 115)) if off else truth
    reviser = Reviser(settings(regular_share=0.3, pause_share=0.2))
    assert list(asked(reviser, scans, poses, range(150, 151))) == [150]
    revised = reviser.revise(smoother_of(scans, poses[:190], reviser), poses[:190])
    if not off:
        assert revised is None
        return
    assert off_by(poses[:190], truth) > 0.25
    assert revised is not None and revised.poses.shape == (190, 3) and len(revised.closed) == 0
    assert off_by(revised.poses, truth) < 0.03
    np.testing.assert_array_equal(revised.poses[0], truth[0])


def test_a_loop_beyond_the_visits_is_recognised_and_told(truth: Array, block: Array) -> None:
    """The lidar was blind for 15 key scans, in which the odometry erred by 1.3 m: no visit is within 1 m.

    Looked at every 5 key scans: a loop that two of them confirm does not wait for the pause.
    """
    scans = cast(block, truth, BLIND)
    poses = drifted(truth, (0.08, 0.04, 0.0), BLIND)
    assert off_by(poses[170:], truth[170:]) > 1.2
    reviser = Reviser(settings(loops=True, radius=1.0, regular_share=10.0, pause=200))
    found = {}
    for count in range(165, 186, 5):
        found[count] = reviser.revise(smoother_of(scans, poses[:count], reviser), poses[:count])
        if found[count] is not None:
            break
    revised = found[count]
    assert revised is not None and len(revised.closed) > 0
    np.testing.assert_array_equal(reviser.closed, revised.closed)
    for earlier, later in revised.closed:
        assert later - earlier > 100 and np.hypot(*(truth[earlier] - truth[later])[:2]) < 3.5
    assert off_by(revised.poses[160:], truth[160:]) < 0.1
    blind = Reviser(settings(radius=1.0, regular_share=10.0, pause=200))
    assert blind.revise(smoother_of(scans, poses[:count], blind), poses[:count]) is None


def test_what_the_scans_do_not_prefer_is_dropped(scans: ScanStore, truth: Array) -> None:
    """The smoother claims to know better: it does where the poses have drifted, and not where they are the truth."""
    wrong = drifted(truth, (0.01, 0.006, 0.002), range(100, 115))
    for poses, answer in ((wrong, truth), (truth, wrong)):
        reviser = Reviser(settings())
        revised = reviser.revise(Scripted(scans, answer, reviser), poses)
        if poses is wrong:
            assert revised is not None
            np.testing.assert_array_equal(revised.poses, truth)
        else:
            assert revised is None
    hardly = Reviser(settings(sure=1e6))
    assert hardly.revise(Scripted(scans, truth, hardly), wrong) is None and hardly.moved == 0.0


def test_by_how_much_a_pose_was_moved_at_most_is_kept(scans: ScanStore, truth: Array) -> None:
    """3 cm, then 1.5 m, then 5 cm; 1 cm is not worth it, and moves nothing."""
    reviser = Reviser(settings(sure=-1e9, pause=1, regular_share=0.01))
    most = []
    for count, moved in ((190, 0.03), (200, 1.5), (205, 0.05), (210, 0.01)):
        answer = truth[:count].copy()
        answer[50:60, 1] -= moved
        reviser.revise(Scripted(scans, answer, reviser), truth[:count])
        most.append(reviser.moved)
    assert most == pytest.approx([0.03, 1.5, 1.5, 1.5])


@pytest.mark.parametrize(("moved", "taken"), [(0.019, False), (0.021, True)])
def test_a_revision_that_hardly_moves_anything_is_dropped(
    moved: float, taken: bool, scans: ScanStore, truth: Array
) -> None:
    answer = truth.copy()
    answer[50:60, 1] += moved
    reviser = Reviser(settings(sure=-1e9, least_move=0.02))
    assert (reviser.revise(Scripted(scans, answer, reviser), truth) is not None) == taken


# Whether the filter's headings are held


def test_headings_are_not_held_until_there_is_enough_to_choose(scans: ScanStore, truth: Array) -> None:
    """From 100 key scans on it is chosen (to hold them), and again once there are half as many more: not before 150."""
    reviser = Reviser(settings(pause=10, regular_share=0.05, first_choice=100, choice_share=0.5, choice_sure=0.7))
    assert not reviser.held
    found = asked(reviser, scans, truth, range(80, 151, 10))
    chosen = dict.fromkeys((100, 150), "chosen by 0.7")
    assert found == {80: "free", 90: "free"} | dict.fromkeys(range(110, 150, 10), "held") | chosen
    assert reviser.held


def test_a_choice_to_let_them_go_is_kept_too(scans: ScanStore, truth: Array) -> None:
    reviser = Reviser(settings(pause=10, regular_share=0.05, first_choice=100, choice_share=0.5, choice_sure=0.7))
    reviser.held = True
    found = asked(reviser, scans, truth, range(90, 121, 10), choice=False)
    assert found == {90: "held", 100: "chosen by 0.7", 110: "free", 120: "free"} and not reviser.held
