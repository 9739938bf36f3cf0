"""The settings of the paper's filter."""

from typing import Annotated, Literal

from pydantic import Field

from pfslam_viz.settings import Config, ScanConfig, Section, setting

Variance = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class MotionConfig(Section):
    """Noise of the motion model, (18) and (19).

    The scaled model's variances grow with what was driven, turned and waited, so that they do not depend on how many
    scans a drive is cut into.
    """

    model: Literal["additive", "scaled"] = setting("additive", "additive: the paper's; scaled: noise grows with motion")
    variance: tuple[Variance, Variance, Variance] = setting(
        (0.001, 0.001, 0.001), "additive: variance of x, y and heading per scan, (39)", "m², m², rad²"
    )
    distance_by_distance: float = setting(0.03, "scaled: standard deviation of the position after 1 m", "m", ge=0)
    distance_by_turn: float = setting(0.02, "scaled: standard deviation of the position after 1 rad", "m", ge=0)
    turn_by_turn: float = setting(0.05, "scaled: standard deviation of the heading after 1 rad", "rad", ge=0)
    turn_by_distance: float = setting(0.02, "scaled: standard deviation of the heading after 1 m", "rad", ge=0)
    turn_by_time: float = setting(0.002, "scaled: standard deviation of the heading after 1 s, the gyro's", "rad", ge=0)


class ObservationConfig(ScanConfig):
    """How a scan is compared with the map."""

    model: Literal["correlation", "likelihood_field"] = setting(
        "correlation", "correlation: the paper's, (26); likelihood_field: Thrun, Burgard & Fox 2005, table 6.3"
    )
    perturbation: bool = setting(False, "correlation: best of the offsets below, IV-E-1")
    perturbation_cells: int = setting(1, "so many cells to every side are tried", "cells", ge=0, le=5)
    perturbation_angle: float = setting(0.02, "this turn to either side is tried", "rad", ge=0, le=0.5)
    sigma: float = setting(0.1, "likelihood_field: spread of end points about a wall", "m", gt=0)
    outliers: float = setting(0.1, "likelihood_field: share of end points that no wall explains", gt=0, lt=1)
    temper: float = setting(0.02, "likelihood_field: exponent, since beams are not independent", gt=0, le=1)


class PaperConfig(Config):
    """The paper's filter."""

    backend: Literal["single_map"] = setting("single_map", "N particles that share one map")
    motion: MotionConfig = MotionConfig()
    observation: ObservationConfig = ObservationConfig()
