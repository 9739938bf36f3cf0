from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.viewer.framing import Framing, aspect_of, eye_on, out_of_view, overhead_camera, overhead_size

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor


def test_a_box_gets_a_margin_and_the_aspect() -> None:
    framing = Framing.of_box(np.array([0.0, 0.0]), np.array([4.0, 8.0]), aspect=1.5)
    assert framing.center == (2.0, 4.0)
    assert framing.height == pytest.approx(10.0)  # 8 m and a metre on either side
    assert framing.width == pytest.approx(15.0)
    assert framing.aspect == pytest.approx(1.5)


def test_the_recording_is_framed_before_the_run(corridor: "Corridor") -> None:
    framing = Framing.of_recording(corridor.recording)
    x, y = framing.center
    # dead reckoning errs by less than half a metre here: the corridor is 8 m by 3 m from (-1, -1.5)
    assert x == pytest.approx(3.0, abs=0.6)
    assert y == pytest.approx(0.0, abs=0.6)
    assert 9.0 < framing.width < 11.5


def test_results_are_framed_by_the_filter_and_dead_reckoning_may_widen_it_a_little(corridor: "Corridor") -> None:
    result = corridor.result(list(corridor.steps()))
    framing = Framing.of_results([result])
    far = np.array([[0.0, 0.0, 0.0], [500.0, 0.0, 0.0]])
    widened = Framing.of_results([replace(result, dead_reckoning=far)])
    assert framing.width + 0.5 < widened.width < 1.3 * framing.width
    assert widened.aspect == pytest.approx(framing.aspect)


@pytest.mark.parametrize("aspect", [1.0, 1.4])
def test_the_overhead_camera_sees_the_floor_as_a_map(aspect: float) -> None:
    def value(batch: Any) -> NDArray[np.float64]:
        return np.array(batch.as_arrow_array().to_pylist()[0])

    transform, pinhole = overhead_camera((3.0, -2.0), 10.0, aspect)
    rotation = value(transform.mat3x3).reshape(3, 3).T  # stored by columns
    position = value(transform.translation)
    k = value(pinhole.image_from_camera).reshape(3, 3).T
    width, height = overhead_size(aspect)

    def pixel(x: float, y: float) -> tuple[float, float]:
        u, v, w = k @ rotation.T @ (np.array([x, y, 0.0]) - position)
        assert w > 0
        return u / w, v / w

    assert pixel(3.0, -2.0) == pytest.approx((width / 2, height / 2))
    assert pixel(3.0, 3.0) == pytest.approx((width / 2, 0.0), abs=1e-3)  # the top edge is 5 m up
    assert pixel(3.0 + 5.0 * aspect, -2.0) == pytest.approx((width, height / 2))  # x to the right


def test_more_panels_are_narrower() -> None:
    assert aspect_of(2) == 1.4
    assert aspect_of(4) == pytest.approx(0.7)


@pytest.mark.parametrize("content", [(30.0, 30.0), (60.0, 12.0), (9.0, 40.0), (6.0, 5.0)])
@pytest.mark.parametrize("aspect", [1.6, 2.2])
def test_the_eye_sees_the_whole_building_and_is_near(content: tuple[float, float], aspect: float) -> None:
    """The corners of the building's box, projected by hand: an upright eye whose view is 55 degrees high."""
    half = np.array(content) / 2
    outline = np.array([[4 + i * half[0], -3 + j * half[1]] for i in (-1, 1) for j in (-1, 1)])
    framing = Framing((0.0, 0.0), 80.0, 80.0, outline)  # which is about the other views
    eye, target = eye_on(framing)
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    corners = np.array([[4 + i * half[0], -3 + j * half[1], z] for i in (-1, 1) for j in (-1, 1) for z in (0, 0.6)])
    seen = corners - eye
    focal = 1.0 / np.tan(np.radians(27.5))
    x, y = focal * seen @ right / (seen @ forward) / aspect, focal * seen @ up / (seen @ forward)
    assert np.all(np.abs(x) < 1.0) and np.all(np.abs(y) < 1.0)
    if aspect == 1.6:
        assert max(np.ptp(x), np.ptp(y)) > 1.7  # of 2: it fills the view one way
    assert y.max() == pytest.approx(-y.min(), abs=0.05) and x.max() == pytest.approx(-x.min(), abs=0.05)


def test_pointers_lie_inside_and_keep_off_the_scale_bar() -> None:
    """20 m by 10 m: half a metre inside of the edge, which they point over, and as far beyond it as the poses are."""
    framing = Framing((5.0, 0.0), 20.0, 10.0, np.zeros((4, 2)))
    poses = np.array([[0.0, 0.0, 0.0], [45.0, 0.5, 0.0], [45.0, 0.5, 0.0], [5.0, 35.0, 1.0], [-30.0, -4.5, 0.0]])
    poses = np.concatenate([poses, [[15.2, 0.0, 0.0], [-14.5, 14.5, 0.0]]])
    rows, pointers = out_of_view(framing, poses)
    assert rows.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert pointers.beyond == pytest.approx([0.0, 30.0, 30.0, 30.0, 25.0, 0.2, np.hypot(10.0, 10.0) - 0.5], abs=0.21)
    tips = pointers.origins + pointers.vectors
    assert tips[1] == pytest.approx([14.5, 0.5]) and tips[3] == pytest.approx([5.0, 4.5])
    assert tips[4] == pytest.approx([-4.5, -2.7])  # not in the corner
    np.testing.assert_allclose(np.hypot(*pointers.vectors[[1, 3, 4]].T), 0.8)
    assert tips[6] == pytest.approx([-4.5, 4.5]) and pointers.vectors[6] == pytest.approx(
        [-(0.8**0.5) * 0.632, 0.566], abs=0.01
    )
