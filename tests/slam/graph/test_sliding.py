"""Visits along a bare corridor whose walls leave their place open, and an alcove that tells it, with known truth."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.config import load_config
from pfslam_viz.evaluation.trajectory_error import trajectory_error
from pfslam_viz.recordings.catalog import load_recording
from pfslam_viz.replay import Replay
from pfslam_viz.simulation.recording import simulate
from pfslam_viz.simulation.sensors import true_ranges
from pfslam_viz.slam.graph.pose_graph import Constraints
from pfslam_viz.slam.graph.scan_store import ScanStore
from pfslam_viz.slam.graph.settings import EvidenceConfig, GraphConfig, ScanMatchingConfig, SlidingConfig
from pfslam_viz.slam.graph.sliding import hold_along, shifts_along
from pfslam_viz.slam.graph.smoothing import Smoother, match

Array = NDArray[np.float64]

ANGLES = np.linspace(-0.75 * np.pi, 0.75 * np.pi, 361)
PLAIN = np.array([(-30.0, -1.1, 30.0, -1.1), (-30.0, 1.1, 30.0, 1.1)])
ALCOVE = np.array(
    [
        (-30.0, -1.1, 30.0, -1.1),
        (-30.0, 1.1, 0.0, 1.1),
        (0.0, 1.1, 0.0, 2.6),
        (0.0, 2.6, 2.0, 2.6),
        (2.0, 2.6, 2.0, 1.1),
        (2.0, 1.1, 30.0, 1.1),
    ]
)
EVIDENCE = EvidenceConfig()
PAIR = np.array([[0, 1]])
TRUTH = np.array([[-1.5, 0.1, 0.0], [-0.6, -0.1, 0.5 * math.pi]])  # turned, so that the two frames' axes differ


def cast(walls: Array, poses: Array) -> ScanStore:
    """Scans of up to 8 m with noise of 1 cm."""
    rng = np.random.default_rng(0)
    store = ScanStore(np.zeros(2), ScanMatchingConfig())
    for ranges in true_ranges(walls, poses, ANGLES)[0]:
        seen = ranges < 8.0
        noisy = (ranges + 0.01 * rng.standard_normal(len(ranges)))[seen]
        store.add(np.stack([noisy * np.cos(ANGLES[seen]), noisy * np.sin(ANGLES[seen])], axis=-1))
    return store


def visit(off: float, *, firm: bool = False, known: float = 0.0) -> Constraints:
    """A match of the two scans of TRUTH that is ``off`` m along the corridor, x of the first.

    It leaves that open, but for a share ``known`` of its information across, or is as ``firm`` along as across.
    """
    increment = geometry.between(TRUTH[0], TRUTH[1] + np.array([off, 0.0, 0.0]))
    information = np.diag([1e4 * known, 1e4, 1e4])  # across the corridor and heading
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # to the axes of the second, a quarter turned
    information = turn @ information @ turn.T if not firm else 1e4 * np.eye(3)
    return Constraints(np.array([0]), np.array([1]), increment[None], information[None], np.ones(1, np.bool_))


EVERY = SlidingConfig(every=1, gain=0.05)  # one alcove is all there is


def test_a_visit_nearby_is_moved_to_where_free_space_puts_it_and_held() -> None:
    held, far = hold_along(cast(ALCOVE, TRUTH), visit(0.15), EVERY, EVIDENCE)
    np.testing.assert_allclose(held.measured[0], geometry.between(*TRUTH), atol=0.04)
    np.testing.assert_allclose(held.information[0], np.diag([1e4, EVERY.deviation**-2.0, 1e4]), atol=1e-6)
    assert len(far) == 0 and held.robust.all()


@pytest.mark.parametrize("off", [0.7, -0.7])
def test_one_that_is_further_off_is_a_loop_to_be_closed(off: float) -> None:
    given = visit(off)
    held, far = hold_along(cast(ALCOVE, TRUTH), given, EVERY, EVIDENCE)
    np.testing.assert_array_equal(held.measured, given.measured)
    np.testing.assert_array_equal(held.information, given.information)
    np.testing.assert_allclose(far.measured[0], geometry.between(*TRUTH), atol=0.04)
    assert (far.start[0], far.end[0], far.robust[0]) == (0, 1, False)


def test_where_nothing_tells_nothing_is_held() -> None:
    """Two bare walls fit everywhere; further than the reach, the alcove is not found; a match that knows is let be."""
    for scans, given in (
        (cast(PLAIN, TRUTH), visit(0.3)),
        (cast(ALCOVE, TRUTH), visit(EVERY.reach + 0.5)),
        (cast(ALCOVE, TRUTH), visit(0.3, firm=True)),
    ):
        held, far = hold_along(scans, given, EVERY, EVIDENCE)
        np.testing.assert_array_equal(held.measured, given.measured)
        np.testing.assert_array_equal(held.information, given.information)
        assert len(far) == 0


def test_what_a_match_hardly_knows_is_not_believed() -> None:
    """An end point or two caught on the wrong door frame fix a match; free space overrules it, but not a firm one."""
    scans = cast(ALCOVE, TRUTH)
    _, far = hold_along(scans, visit(0.7, known=0.9 * EVERY.weak), EVERY, EVIDENCE)
    np.testing.assert_allclose(far.measured[0], geometry.between(*TRUTH), atol=0.04)
    _, far = hold_along(scans, visit(0.7, known=1.1 * EVERY.weak), EVERY, EVIDENCE)
    assert len(far) == 0


@pytest.mark.parametrize(
    "changed",
    [
        {"every": 2},
        {"reach": 0.4},
        {"step": 0.07},
        {"gain": 0.9},
        {"apart": 0.06},
        {"near": 0.1},
        {"deviation": 0.1},
    ],
)
def test_every_setting_matters(changed: dict[str, float]) -> None:
    scans = cast(ALCOVE, TRUTH)
    off = 0.45 if "reach" in changed else 0.15
    results = []
    for config in (EVERY, SlidingConfig.model_validate({"every": 1, "gain": 0.05, **changed})):
        held, far = hold_along(scans, visit(off), config, EVIDENCE)
        results.append((held.measured.tobytes(), held.information.tobytes(), len(far)))
    assert results[0] != results[1]


def test_shifts_are_along_the_axis_in_metres() -> None:
    scans = cast(ALCOVE, TRUTH)
    for off in (-0.42, 0.0, 0.35):
        shift = shifts_along(scans, visit(off), np.array([[0.0, -1.0]]), EVERY, EVIDENCE)  # y of the second is -x
        assert shift[0] == pytest.approx(-off, abs=0.04)


def test_slip_out_of_sight_of_anything_is_found_on_the_way_back() -> None:
    """Down the corridor past an alcove and back. The wheels slip by 0.7 m where only bare walls are in view.

    Matching visits leaves them where the wheels say; what slides along the corridor, closed as a loop, and the graph
    relaxed without it, is where it was. Without the search there is nothing to close.
    """
    steps = [(0.2, 0.0, 0.0)] * 55 + [(0.0, 0.0, math.pi / 16)] * 16 + [(0.2, 0.0, 0.0)] * 55
    told = np.array([(0.0, 0.0, 0.0), *steps])
    start = np.array([-5.0, 0.0, 0.0])
    truth = geometry.accumulate(told)
    scans = cast(ALCOVE, geometry.compose(start, truth))
    told[36:56, 0] += 0.7 / 20.0  # from x = 2.2 m to the U-turn: the alcove is behind, where the lidar is blind
    graph = Smoother(scans, told, told[1:], GraphConfig(sliding=EVERY))
    gates = np.array(graph.config.gates)
    relaxed, _ = graph.relax(geometry.accumulate(told), gates)
    assert (relaxed - truth)[60:, 0] == pytest.approx(0.7, abs=0.1)
    (loop,) = graph.slid(relaxed)
    closed, _ = graph.close(relaxed, loop)
    assert np.abs(closed - truth)[:, :2].max() < 0.05
    assert graph.slid(closed) == []
    off = GraphConfig(sliding=SlidingConfig(enabled=False))
    assert Smoother(scans, told, told[1:], off).slid(relaxed) == []


@pytest.mark.slow
def test_a_ring_whose_first_corridor_was_driven_with_slipping_wheels(tmp_path: Path) -> None:
    """0.62 m before: half a metre was lost in the first corridor, and the way back through it fitted there as well."""
    recording = load_recording(
        str(simulate(tmp_path / "ring", frames=False, building="ring", seed=112, wheel_scale=1.026, slip=0.081))
    )
    assert recording.truth is not None
    errors = []
    for enabled in (True, False):
        replay = Replay(recording, load_config("default", [f"sliding.enabled={str(enabled).lower()}"]), texture=False)
        for _ in replay:
            pass
        result = replay.result()
        errors.append(trajectory_error(recording.truth.at(result.stamps), result.estimate).position_rmse)
    assert errors[0] < 0.15 and errors[1] > 0.4


def test_the_match_of_bare_walls_is_open_along_them() -> None:
    """What the tests above take for granted."""
    found = match(cast(PLAIN, TRUTH), TRUTH, PAIR, np.array([0.2, 0.1]), GraphConfig().smoothing)
    values = np.linalg.eigvalsh(found.information[0, :2, :2])
    assert values[0] < 1e-6 * values[1]
