import math
from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
import pytest

from pfslam_viz.recordings.ros_transforms import Edge, Transforms, matrices, pick


def add(
    tree: Transforms,
    parent: str,
    child: str,
    place: Sequence[float],
    heading: float = 0.0,
    stamp: int = 0,
    received: float = 0.0,
) -> None:
    x, y, z = place
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))
    one = SimpleNamespace(
        header=SimpleNamespace(frame_id=parent, stamp=SimpleNamespace(sec=stamp, nanosec=0)),
        child_frame_id=child,
        transform=SimpleNamespace(translation=SimpleNamespace(x=x, y=y, z=z), rotation=turn),
    )
    tree.add(SimpleNamespace(transforms=[one]), received)
    tree.flush()


def test_rotation_matrices() -> None:
    """Quarter turns about x, y and z take y to z, z to x and x to y; a zero quaternion does not turn."""
    half = math.sqrt(0.5)
    zero = [0.0, 0.0, 0.0]
    about = matrices(
        np.array([[*zero, half, 0, 0, half], [*zero, 0, half, 0, half], [*zero, 0, 0, 3, 3], [1, 2, 3, 0, 0, 0, 0]])
    )
    x, y, z = np.eye(3)
    np.testing.assert_allclose(about[0, :3, :3] @ y, z, atol=1e-12)
    np.testing.assert_allclose(about[1, :3, :3] @ z, x, atol=1e-12)
    np.testing.assert_allclose(about[2, :3, :3] @ x, y, atol=1e-12)
    np.testing.assert_allclose(about[3], [[1, 0, 0, 1], [0, 1, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])


def test_a_chain_up_and_down() -> None:
    """From the camera up to the base, whose left it looks to, and down to the laser a metre ahead of the base."""
    tree = Transforms()
    add(tree, "base", "mast", (0, 0, 1))
    add(tree, "/mast", "/camera", (0, 2, 0), math.pi / 2)
    add(tree, "base", "laser", (1, 0, 0))
    found = tree.fixed("camera", "laser")
    assert found is not None
    # In the base's frame the laser is at (1, -2, -1) from the camera, whose x is the base's y and y the base's -x.
    np.testing.assert_allclose(found[0][:3, 3], [-2, -1, -1], atol=1e-12)
    assert found[1] == []
    assert tree.fixed("camera", "wheel") is None
    assert tree.frames == {"base", "mast", "camera", "laser"}


def test_a_chain_that_rests_is_preferred_to_one_that_moves() -> None:
    tree = Transforms()
    add(tree, "base", "head", (0, 0, 0))
    add(tree, "base", "head", (0, 0, 0), 1.0, stamp=1)
    add(tree, "head", "laser", (9, 0, 0))
    found = tree.fixed("base", "laser")
    assert found is not None and found[0][0, 3] == 9 and found[1] == ["base -> head"]
    add(tree, "base", "plate", (1, 0, 0))
    add(tree, "plate", "bracket", (1, 0, 0))
    add(tree, "bracket", "laser", (1, 0, 0))
    found = tree.fixed("base", "laser")
    assert found is not None and found[0][0, 3] == 3 and found[1] == []


def test_motion_through_two_links_with_stamps_of_their_own() -> None:
    """odom -> footprint goes ahead by 1 m/s from 0 to 4 s; footprint -> base sways to the left between 1 and 3 s."""
    tree = Transforms()
    for stamp in (0, 4):
        add(tree, "odom", "footprint", (stamp, 0, 0), stamp=stamp, received=stamp + 100)
    for stamp, sway in ((1, 0.0), (3, 1.0)):
        add(tree, "footprint", "base", (0, sway, 0), stamp=stamp, received=stamp + 100)
    motion = tree.motion("odom", "base", received=False)
    assert motion is not None
    assert motion[0].tolist() == [1, 3]
    np.testing.assert_allclose(motion[1], [[1, 0, 0], [3, 1, 0]])
    later = tree.motion("odom", "base", received=True)
    assert later is not None and later[0].tolist() == [101, 103]
    # Back through the links: from the base, odom moves the other way.
    back = tree.motion("base", "odom", received=False)
    assert back is not None
    np.testing.assert_allclose(back[1], [[-1, 0, 0], [-3, -1, 0]])


def test_a_turn_is_interpolated_the_short_way_through_the_sign_of_quaternions() -> None:
    """q and -q are one rotation: headings of 0.2, 0.4 and 0.6 rad, the second written with the other sign."""
    edge = Edge()
    for stamp, heading, sign in ((0.0, 0.2, 1), (1.0, 0.4, -1), (2.0, 0.6, 1)):
        edge.add(stamp, 0.0, (0, 0, 0, 0, 0, sign * math.sin(heading / 2), sign * math.cos(heading / 2)))
    places = edge.at(np.array([0.5, 1.5]), received=False)
    np.testing.assert_allclose(np.arctan2(places[:, 1, 0], places[:, 0, 0]), [0.3, 0.5], atol=1e-9)


def test_what_rests_is_no_motion_and_takes_no_memory() -> None:
    tree = Transforms()
    for stamp in range(1000):
        add(tree, "odom", "base", (1, 0, 0), stamp=stamp)
    assert tree.motion("odom", "base", received=False) is None
    assert tree.motion("odom", "laser", received=False) is None


def test_a_stretch_at_rest_is_not_smeared() -> None:
    """At 0 m up to 9 s, and at 1 m at 10 s: at 8 s it has not set out."""
    tree = Transforms()
    for stamp in range(11):
        one = SimpleNamespace(
            header=SimpleNamespace(frame_id="odom", stamp=SimpleNamespace(sec=stamp, nanosec=0)),
            child_frame_id="base",
            transform=SimpleNamespace(
                translation=SimpleNamespace(x=float(stamp == 10), y=0.0, z=0.0),
                rotation=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0),
            ),
        )
        tree.add(SimpleNamespace(transforms=[one]), 0.0)
    tree.flush()
    edge = tree.edges["odom", "base"]
    assert len(edge.stamps) == 3
    assert edge.at(np.array([8.0, 9.5, 12.0]), received=False)[:, 0, 3].tolist() == pytest.approx([0, 0.5, 1])


def test_transforms_that_are_no_numbers_are_left_out() -> None:
    tree = Transforms()
    add(tree, "base", "laser", (math.nan, 0, 0))
    assert tree.fixed("base", "laser") is None


def test_stamps_of_zero() -> None:
    tree = Transforms()
    add(tree, "odom", "base", (0, 0, 0))
    assert not tree.without_stamps()
    add(tree, "odom", "base", (1, 0, 0))
    assert tree.without_stamps()
    add(tree, "odom", "base", (2, 0, 0), stamp=1)
    assert not tree.without_stamps()


def test_frames_by_name() -> None:
    frames = {"odom", "robot1/base_link", "base_footprint", "my_base_link"}
    assert pick(frames, ("base_link", "base_footprint")) == ["robot1/base_link", "base_footprint"]
