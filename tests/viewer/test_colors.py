"""Colours are told apart by colour-blind people, and show on light and dark."""

from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz.config import Config
from pfslam_viz.viewer import colors
from pfslam_viz.viewer.colors import Color

# Machado, Oliveira and Fernandes (2009), severity 1.0, on linear RGB.
DEFICIENCIES = {
    "none": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(color: Color) -> NDArray[np.float64]:
    c = np.asarray(color) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(rgb: Any) -> NDArray[np.float64]:
    """CIE L*a*b* (D65) of linear RGB."""
    to_xyz = np.array(
        [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    )
    xyz = to_xyz @ np.clip(rgb, 0, 1) / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def apart(a: Color, b: Color, deficiency: str) -> float:
    matrix = np.asarray(DEFICIENCIES[deficiency])
    return float(np.linalg.norm(lab(matrix @ linear(a)) - lab(matrix @ linear(b))))


def contrast(a: Color, b: Color) -> float:
    """WCAG contrast ratio."""
    light = [0.05 + float(np.array([0.2126, 0.7152, 0.0722]) @ linear(c)) for c in (a, b)]
    return max(light) / min(light)


TOGETHER = {
    "trajectories": [colors.DEAD_RECKONING, colors.FILTER, colors.TRUTH],
    "end points": [colors.HIT, colors.MISS],
    "runs": [*colors.RUNS],
    "curves": [colors.DEAD_RECKONING, *colors.RUNS],
    "map": [(255, 255, 255), (0, 0, 0), (112, 137, 134)],
}


@pytest.mark.parametrize("deficiency", DEFICIENCIES)
@pytest.mark.parametrize("group", TOGETHER)
def test_colors_that_appear_together_differ_for_everyone(group: str, deficiency: str) -> None:
    for a, b in combinations(TOGETHER[group], 2):
        assert apart(a, b, deficiency) > 20, (group, a, b)  # 2.3 is a just noticeable difference


@pytest.mark.parametrize("color", TOGETHER["trajectories"])
@pytest.mark.parametrize("ground", [(255, 255, 255), (13, 16, 17)])
def test_trajectories_show_on_a_white_floor_and_on_the_dark_theme(color: Color, ground: Color) -> None:
    assert contrast(color, ground) > 3.0  # what WCAG asks of graphics


def test_heavier_particles_are_darker() -> None:
    lightness = [lab(linear(color))[0] for color in colors.WEIGHT_RAMP]
    assert np.all(np.diff(lightness) < -3)


def test_larger_errors_are_darker_and_told_apart() -> None:
    ramp = colors.ERROR_RAMP
    assert len(ramp) == len(colors.ERROR_LIMITS) + 1 and list(colors.ERROR_LIMITS) == sorted(colors.ERROR_LIMITS)
    assert np.all(np.diff([lab(linear(color))[0] for color in ramp]) < -4)
    for deficiency in DEFICIENCIES:
        assert all(apart(a, b, deficiency) > 9 for a, b in pairwise(ramp)), deficiency


def test_a_configuration_keeps_its_colour() -> None:
    default, paper, other = (Config(name=name) for name in ("default", "paper", "mine.toml"))
    blue, amber, third, _ = colors.RUNS
    assert colors.run_colors([paper]) == colors.run_colors([default, paper])[1:] == [amber]
    assert colors.run_colors([paper, default]) == [amber, blue]
    assert colors.run_colors([other]) == [blue]
    assert colors.run_colors([other, default, other, paper]) == [third, blue, colors.RUNS[3], amber]
    assert len(set(colors.run_colors([default, default, paper, paper]))) == 4
