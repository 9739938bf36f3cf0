"""The colours of what a recording shows.

Those of things that appear together are told apart under protanopia, deuteranopia and tritanopia (a test simulates all
three), and are of middle lightness, so that they show on the white floor of a map, on its black walls, and on the
viewer's dark and light theme.
"""

from collections.abc import Sequence

from pfslam_viz.config import Config

Color = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

DEAD_RECKONING: Color = (213, 94, 0)
FILTER: Color = (0, 110, 220)
TRUTH: Color = (0, 158, 115)
HIT: Color = (86, 196, 245)
MISS: Color = (204, 40, 140)
HINDSIGHT: Color = (120, 70, 200)
LINEAGE: Color = (160, 130, 215)
WALL: Color = (70, 84, 92)
DOUBT: Color = (165, 15, 40)
INK: Color = (20, 20, 20)

RUNS: tuple[Color, ...] = (FILTER, (235, 172, 0), (150, 40, 150), (125, 125, 125))
"""A colour for each run that is compared; the first is the filter's where there is one."""

OWN_COLORS: dict[str, Color] = dict(zip(("default", "paper"), RUNS, strict=False))
"""The colours of the configurations that come with the tool, wherever they are shown."""


def run_colors(configs: Sequence[Config]) -> list[Color]:
    """A colour for each configuration, all different: its own if it has one, or the next that is free.

    A configuration that is shown alone and has none of its own gets the filter's.
    """
    own = [OWN_COLORS.get(config.name) for config in configs]
    wanted = [color if color not in own[:k] else None for k, color in enumerate(own)]
    free = iter([color for color in RUNS if color not in wanted])
    return [color or next(free) for color in wanted]


COLOR_NAMES: dict[Color, str] = {
    **{DEAD_RECKONING: "vermilion", TRUTH: "green", HIT: "light blue", MISS: "magenta", HINDSIGHT: "violet"},
    **{LINEAGE: "pale violet", WALL: "slate", DOUBT: "crimson", INK: "black"},
    **dict(zip(RUNS, ("blue", "amber", "purple", "grey"), strict=True)),
}
"""What the help page calls the colours."""

WEIGHT_RAMP: tuple[Color, ...] = (
    (253, 231, 37),
    (181, 222, 43),
    (110, 206, 88),
    (53, 183, 121),
    (31, 158, 137),
    (38, 130, 142),
    (49, 104, 142),
    (62, 73, 137),
    (72, 40, 120),
    (68, 1, 84),
)
"""Viridis in ten levels, from no weight (yellow) over an average one (green) to many times that (dark violet)."""

ERROR_LIMITS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # m
ERROR_RAMP: tuple[Color, ...] = (
    (80, 190, 240),
    (60, 150, 225),
    (100, 116, 215),
    (150, 64, 178),
    (170, 15, 98),
    (132, 3, 42),
    (66, 0, 12),
)
"""Errors up to each of ERROR_LIMITS, and beyond the last: from light blue over violet to a dark red, ever darker. The
limits are the same for all recordings, so that their pictures compare."""
