"""The motion model and the correction of scans for motion, whatever the motion: against fine integration."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pfslam_viz import geometry
from pfslam_viz.recordings.motion import moved, twists
from pfslam_viz.slam.paper.motion import predict, scaled_variance
from pfslam_viz.slam.paper.settings import MotionConfig

Array = NDArray[np.float64]

SPEEDS = st.tuples(st.floats(-3.0, 3.0), st.floats(-1.0, 1.0), st.floats(-4.0, 4.0)).map(np.array)
SEEDS = st.integers(0, 2**32 - 1)


def driven(speed: Array, seconds: Array, pieces: int = 2000) -> Array:
    """Where a robot is (m, 3) that has gone at ``speed`` (3,) for each of the ``seconds`` (m,), in short steps."""
    middle = (np.arange(pieces) + 0.5) / pieces * seconds[:, None]
    c, s = np.cos(speed[2] * middle), np.sin(speed[2] * middle)
    x = (c * speed[0] - s * speed[1]).mean(axis=1) * seconds
    y = (s * speed[0] + c * speed[1]).mean(axis=1) * seconds
    return np.stack([x, y, speed[2] * seconds], axis=-1)


@given(before=SPEEDS, after=SPEEDS, seed=SEEDS)
@settings(max_examples=25)
def test_points_seen_on_the_way_are_where_they_are(before: Array, after: Array, seed: int) -> None:
    """Things that stand still, each seen from where the robot was then, are one picture as seen at time 0."""
    rng = np.random.default_rng(seed)
    things, times = rng.uniform(-9, 9, (20, 2)), rng.uniform(-0.3, 0.3, 20)
    poses = np.where(times[:, None] > 0, driven(after, times), driven(before, times))
    seen = np.array([geometry.transform(geometry.inverse(p), t[None])[0] for p, t in zip(poses, things, strict=True)])
    np.testing.assert_allclose(moved(seen, times, np.stack([before, after])), things, atol=1e-5)


@given(st.lists(SPEEDS, min_size=1, max_size=9).map(np.array), SEEDS)
def test_speeds_lead_through_the_scans_poses(speeds: Array, seed: int) -> None:
    """Speeds found from increments, driven in short steps, give the increments again; none turns by half a turn."""
    intervals = np.random.default_rng(seed).uniform(0.01, 0.7, len(speeds))
    stamps = np.cumsum(np.append(5.0, intervals))
    steps = np.array([driven(v, t[None])[0] for v, t in zip(speeds, intervals, strict=True)])
    found = twists(np.vstack([np.zeros(3), steps]), stamps)
    np.testing.assert_allclose(found[1:-1], speeds, atol=1e-4)
    np.testing.assert_array_equal(found[[0, -1]], found[[1, -2]])


@given(increment=SPEEDS, pose=SPEEDS, seed=SEEDS, model=st.sampled_from(["additive", "scaled"]))
@settings(max_examples=25)
def test_the_noise_is_as_wide_as_it_is_said_to_be(increment: Array, pose: Array, seed: int, model: str) -> None:
    """4,000 particles at one pose: their offsets from the motion without noise have mean 0 and the variance said."""
    config = MotionConfig.model_validate({"model": model, "variance": [0.01, 0.02, 0.0004]})
    particles = np.tile(pose, (4000, 1))
    out = predict(particles, increment, 0.1, config, np.random.default_rng(seed))
    there = geometry.compose(pose, increment)
    if model == "additive":  # in the world's frame
        off = np.column_stack([out[:, :2] - there[:2], geometry.wrap(out[:, 2] - there[2])])
        variance = np.array(config.variance)
    else:  # in the frame of the pose before
        off = geometry.between(pose, out) - increment
        off[:, 2] = geometry.wrap(off[:, 2])
        variance = scaled_variance(increment, 0.1, config)
    deviation = np.sqrt(variance) + 1e-12
    assert (np.abs(off.mean(axis=0)) < 6.5 * deviation / np.sqrt(4000)).all()
    spread = (off / deviation).std(axis=0)
    assert ((spread > 0.92) & (spread < 1.08))[variance > 1e-20].all()


@given(SPEEDS, st.floats(0.0, 2.0), st.integers(1, 20))
def test_the_noise_of_a_motion_does_not_depend_on_how_often_it_is_logged(step: Array, dt: float, parts: int) -> None:
    """Variance is linear in distance, turn and time: parts of a straight or turning motion add up to the whole's."""
    config = MotionConfig(model="scaled")
    whole = scaled_variance(step, dt, config)
    np.testing.assert_allclose(parts * scaled_variance(step / parts, dt / parts, config), whole, rtol=1e-9)
