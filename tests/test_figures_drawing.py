"""The figures' axes: what is drawn at a place in the world is at that place's pixel."""

import numpy as np
import pytest

from pfslam_viz.figures_drawing import LEFT, TOP, Picture, draw_map, nice_step
from pfslam_viz.figures_layers import FREE, Array, Color, Image, Layer, Limits, Path2D

RED, BLUE, GREEN = (220, 20, 20), (20, 20, 220), (20, 160, 20)


def pixel(picture: Picture, image: Image, x: float, y: float) -> list[int]:
    """The colour at a world position, by the definition of the axes."""
    column = LEFT + (x - picture.limits.left) * picture.scale
    row = TOP + (picture.limits.top - y) * picture.scale
    color: list[int] = image[int(row), int(column)].tolist()
    return color


def path(points: list[list[float]], color: Color) -> Path2D:
    return Path2D(np.array(points), color, "a path")


@pytest.mark.parametrize("cell", [0.5, 0.01])  # larger and smaller than a pixel's share
def test_cells_lie_where_they_are(cell: float) -> None:
    plot = Picture(Limits(-10, 30, -5, 15), FREE, 0)
    image = np.zeros((round(4 / cell), round(6 / cell), 3), np.uint8)
    image[:] = GREEN
    half = round(2 / cell)
    image[:half, :half] = RED  # 2 x 2 m in the upper left corner
    alpha = np.full(image.shape[:2], 255, np.uint8)
    alpha[-half:, -half:] = 0  # and a hole in the lower right one
    plot.cells(Layer(image, alpha, np.zeros((0, 2)), cell, (3.0, 10.0)))
    picture = plot.finish("cells", "")
    edge = 0.08  # m, a pixel and a half or more
    for x, y, color in [
        (3 + edge, 10 - edge, RED),
        (5 - edge, 8 + edge, RED),
        (5 + edge, 8 - edge, GREEN),
        (3 + edge, 6 + edge, GREEN),
        (9 - edge, 10 - edge, GREEN),
        (7 + edge, 8 - edge, (255, 255, 255)),
        (7 - edge, 6 + edge, GREEN),
    ]:
        assert pixel(plot, picture, x, y) == pytest.approx(list(color), abs=2), (x, y)
    for x, y in [(3 - edge, 9), (9 + edge, 9), (6, 10 + edge), (6, 6 - edge)]:
        assert pixel(plot, picture, x, y) == [255, 255, 255], (x, y)


def test_lines_dots_and_the_robot_lie_where_they_are() -> None:
    plot = Picture(Limits(0, 20, 0, 20), FREE, 0)
    plot.path(path([[2.2, 3.3, 0], [15.2, 3.3, 0], [15.2, 12.2, 0]], BLUE), 4)
    plot.dots(np.array([[7.3, 7.3]]), RED, "dots", 8)
    plot.ends(path([[4.3, 12.3, 0], [12.3, 17.3, np.pi / 2]], GREEN), 60)
    plot.path(path([[1.0, 1.0, 0]], BLUE), 4)  # one pose is no line, and no error
    picture = plot.finish("lines", "")
    assert pixel(plot, picture, 8.7, 3.3) == pytest.approx(list(BLUE), abs=2)
    assert pixel(plot, picture, 15.2, 8.8) == pytest.approx(list(BLUE), abs=2)
    assert pixel(plot, picture, 7.3, 7.3) == pytest.approx(list(RED), abs=2)
    ahead = 15 / plot.scale  # it looks up: green ahead of its centre, notched behind
    assert pixel(plot, picture, 12.3, 17.3 + ahead) == pytest.approx(list(GREEN), abs=2)
    assert pixel(plot, picture, 12.3, 17.3 - ahead) != pytest.approx(list(GREEN), abs=60)
    assert pixel(plot, picture, 4.3, 12.3) == [255, 255, 255]  # the ring where it began, and its edge
    assert pixel(plot, picture, 4.3, 12.3 + 5 / plot.scale) == pytest.approx(list(GREEN), abs=90)


def test_limits() -> None:
    around = Limits.around(np.array([[1.0, 2.0], [3.0, -4.0]]), np.array([[-2.0, 0.0]]), pad=0.5)
    assert (around.left, around.right, around.bottom, around.top) == (-2.5, 3.5, -4.5, 2.5)
    assert Limits.around(np.zeros((0, 2))).width == 2.0
    corridor = Limits(0, 100, 0, 1).shaped()
    assert corridor.height == pytest.approx(45) and (corridor.bottom + corridor.top) / 2 == pytest.approx(0.5)
    assert corridor.width == 100


def drawn(title: str, trajectory: Array, limits: Limits) -> Image:
    """A map of nothing with one trajectory and its particles."""
    nothing = Layer(np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1), np.uint8), np.zeros((0, 2)), 0.1, (0.0, 0.0))
    paths = [Path2D(trajectory, BLUE, "particle filter"), Path2D(trajectory, GREEN, "truth")]
    return draw_map(limits, nothing, paths, title, "", trajectory[-1:, :2])


def test_pictures_of_the_same_limits_have_the_same_size() -> None:
    sizes = set()
    for title in ("one", "another, with a longer title"):
        sizes.add(drawn(title, np.random.default_rng(0).random((len(title), 3)), Limits(0, 7, 0, 13)).shape)
    assert len(sizes) == 1


@pytest.mark.parametrize("limits", [Limits(0, 7, 0, 13), Limits(0, 30, 0, 9)])
def test_the_legend_is_whole_and_below_the_axis(limits: Limits) -> None:
    """What is around the axes is ink on white: none of it touches the picture's edge or runs into each other."""
    image, picture = drawn("a title", np.zeros((2, 3)), limits), Picture(limits, FREE, 0)
    ink = image.min(axis=2) < 200
    assert not ink[:, :4].any() and not ink[:, -4:].any() and not ink[:4].any() and not ink[-2:].any()
    floor = TOP + round(picture.limits.height * picture.scale) + 20  # below the numbers
    begins = np.flatnonzero(np.diff(ink[floor:].any(axis=1).astype(int)) == 1)  # where a line of text begins
    assert len(begins) == 1 + -(-8 // picture.legend_columns)  # "x (m)" and the legend's rows


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "other"), [("Gebaude", "Gebäude"), (r"a $\nothing$", "a"), ("廊下", "")])
def test_any_name_is_written_as_it_is(name: str, other: str) -> None:
    limits = Limits(0, 7, 0, 13)
    assert (drawn(name, np.zeros((2, 3)), limits) != drawn(other, np.zeros((2, 3)), limits)).any()


def test_nice_step() -> None:
    assert [nice_step(v) for v in (0.11, 0.2, 0.9, 1.0, 2.1, 7.0, 30.0)] == pytest.approx([0.2, 0.2, 1, 1, 5, 10, 50])
