"""What the recording's entities are called, and how they are coloured.

The colours of things that appear together are told apart under protanopia, deuteranopia and tritanopia (a test
simulates all three), and are of middle lightness, so that they show on the white floor of a map, on its black walls,
and on the viewer's dark and light theme.
"""

from dataclasses import dataclass

Color = tuple[int, int, int]

DEAD_RECKONING: Color = (213, 94, 0)  # vermilion
FILTER: Color = (0, 110, 220)  # blue
TRUTH: Color = (0, 158, 115)  # green
HIT: Color = (86, 196, 245)  # light blue
MISS: Color = (204, 40, 140)  # magenta
HINDSIGHT: Color = (120, 70, 200)  # violet
LINEAGE: Color = (160, 130, 215)  # pale violet
WALL: Color = (70, 84, 92)  # slate


@dataclass(frozen=True, slots=True)
class RunColor:
    """The colour of a run, and what the pages call it."""

    name: str
    rgb: Color


RUNS: tuple[RunColor, ...] = (
    RunColor("blue", FILTER),
    RunColor("amber", (235, 172, 0)),
    RunColor("purple", (150, 40, 150)),
    RunColor("grey", (125, 125, 125)),
)
"""A colour for each run that is compared; the first is the filter's where there is one."""

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
"""Viridis in ten levels, from no weight (yellow) to the heaviest particle (dark violet)."""

MAP_Z, TEXTURE_Z, LIDAR_Z, PARTICLE_Z, TRAIL_Z, TRUTH_Z, POSE_Z = 0.0, 0.01, 0.03, 0.04, 0.06, 0.07, 0.09
"""Heights (m) that keep the layers of a flat scene from hiding each other."""

OVERVIEW = "world/overview"
"""The pinhole that looks down on the whole map."""

HELP, ABOUT = "help", "about"
"""The pages: what each entity is; recording, configuration and versions."""


@dataclass(frozen=True, slots=True)
class Entities:
    """Entity paths of one run: ``run`` is ``filter``, or the run's name where several share a recording."""

    run: str = "filter"

    def filter(self, name: str) -> str:
        """Something that the filter knows, such as ``particles``."""
        return f"world/{self.run}/{name}"

    def plot(self, name: str) -> str:
        """The run's curve in the plot ``name``."""
        return f"plots/{name}/{self.run}"

    @property
    def disparity_image(self) -> str:
        """The depth camera's image, coloured."""
        return f"camera/{self.run}/disparity"


def dead_reckoning(name: str) -> str:
    """Path of something that odometry alone gives."""
    return f"world/dead_reckoning/{name}"


def truth(name: str) -> str:
    """Path of something that only a simulation or a reference system knows."""
    return f"world/truth/{name}"


def shared_plot(name: str, curve: str) -> str:
    """Path of a curve that belongs to no run."""
    return f"plots/{name}/{curve}"
