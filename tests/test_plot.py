"""The axes canvas: what is drawn at a place in the world is at that place's pixel."""

import numpy as np
import pytest

from pfslam_viz.plot import LEFT, TOP, Key, Limits, Plot, nice_step

RED, BLUE, GREEN = (220, 20, 20), (20, 20, 220), (20, 160, 20)


def pixel(plot: Plot, image: np.ndarray, x: float, y: float) -> list[int]:
    """The colour at a world position, by the definition of the axes."""
    column = LEFT + (x - plot.limits.left) * plot.scale
    row = TOP + (plot.limits.top - y) * plot.scale
    return image[int(row), int(column)].tolist()


@pytest.mark.parametrize("cell", [0.5, 0.01])  # larger and smaller than a pixel's share
def test_cells_lie_where_they_are(cell: float) -> None:
    plot = Plot(Limits(-10, 30, -5, 15))
    image = np.zeros((round(4 / cell), round(6 / cell), 3), np.uint8)
    image[:] = GREEN
    half = round(2 / cell)
    image[:half, :half] = RED  # 2 x 2 m in the upper left corner
    alpha = np.full(image.shape[:2], 255, np.uint8)
    alpha[-half:, -half:] = 0  # and a hole in the lower right one
    plot.cells(image, cell, (3.0, 10.0), alpha)
    picture = plot.finish("cells")
    edge = 0.08  # m, a pixel and a half or more
    for x, y, color in [
        (3 + edge, 10 - edge, RED),
        (5 - edge, 8 + edge, RED),
        (5 + edge, 8 - edge, GREEN),
        (3 + edge, 6 + edge, GREEN),
        (9 - edge, 10 - edge, GREEN),
        (7 + edge, 8 - edge, [255, 255, 255]),
        (7 - edge, 6 + edge, GREEN),
    ]:
        assert pixel(plot, picture, x, y) == pytest.approx(list(color), abs=2), (x, y)
    for x, y in [(3 - edge, 9), (9 + edge, 9), (6, 10 + edge), (6, 6 - edge)]:
        assert pixel(plot, picture, x, y) == [255, 255, 255], (x, y)


def test_lines_dots_and_the_robot_lie_where_they_are() -> None:
    plot = Plot(Limits(0, 20, 0, 20))
    plot.line(np.array([[2.2, 3.3], [15.2, 3.3], [15.2, 12.2]]), BLUE, 4)
    plot.dots(np.array([[7.3, 7.3]]), RED, 4)
    plot.robot(np.array([12.3, 17.3, np.pi / 2]), GREEN, 20)
    plot.line(np.array([[1.0, 1.0]]), BLUE)  # one point is no line, and no error
    picture = plot.finish("lines")
    assert pixel(plot, picture, 8.7, 3.3) == pytest.approx(list(BLUE), abs=2)
    assert pixel(plot, picture, 15.2, 8.8) == pytest.approx(list(BLUE), abs=2)
    assert pixel(plot, picture, 7.3, 7.3) == pytest.approx(list(RED), abs=2)
    ahead = 15 / plot.scale  # it looks up: green ahead of its centre, notched behind
    assert pixel(plot, picture, 12.3, 17.3 + ahead) == pytest.approx(list(GREEN), abs=2)
    assert pixel(plot, picture, 12.3, 17.3 - ahead) != pytest.approx(list(GREEN), abs=60)


def test_limits() -> None:
    around = Limits.around(np.array([[1.0, 2.0], [3.0, -4.0]]), np.array([[-2.0, 0.0]]), pad=0.5)
    assert (around.left, around.right, around.bottom, around.top) == (-2.5, 3.5, -4.5, 2.5)
    assert Limits.around(np.zeros((0, 2))).width == 2.0
    corridor = Limits(0, 100, 0, 1).shaped()
    assert corridor.height == pytest.approx(45) and (corridor.bottom + corridor.top) / 2 == pytest.approx(0.5)
    assert corridor.width == 100


def test_pictures_of_the_same_limits_have_the_same_size() -> None:
    keys = [Key("line", BLUE, "a"), Key("patch", RED, "b"), Key("ring", RED, "c"), Key("dot", RED, "d")]
    sizes = set()
    for title in ("one", "another, with a longer title"):
        plot = Plot(Limits(0, 7, 0, 13))
        sizes.add(plot.finish(title, "", [*keys, Key("robot", RED, "e")]).shape)
    assert len(sizes) == 1


def test_nice_step() -> None:
    assert [nice_step(v) for v in (0.11, 0.2, 0.9, 1.0, 2.1, 7.0, 30.0)] == pytest.approx([0.2, 0.2, 1, 1, 5, 10, 50])
