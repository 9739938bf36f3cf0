"""The settings of the Rao-Blackwellized filter."""

from typing import Annotated, Literal

from pydantic import Field

from pfslam_viz.settings import Section, setting
from pfslam_viz.slam.graph.settings import GraphConfig

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class RaoBlackwellizedConfig(Section):
    """The filter with a map per particle (Grisetti, Stachniss & Burgard 2007)."""

    update_distance: float = setting(0.15, "a scan is used after so much motion ...", "m", gt=0)
    update_angle: float = setting(0.15, "... or so much turning", "rad", gt=0)
    still: float = setting(1e-4, "a robot that moves less in a scan, in m and in rad, stands", "m and rad", ge=0)
    sigma: float = setting(0.05, "standard deviation of an end point off its wall", "m", gt=0)
    floor: float = setting(0.1, "share of end points that no wall explains", gt=0, lt=1)
    field_reach: int = setting(3, "how far from a wall the likelihood field reaches", "cells", ge=1, le=15)
    temper: float = setting(0.1, "exponent of the scan's likelihood: end points are not independent", gt=0, le=1)
    scan_temper: float = setting(0.05, "exponent of the scan-to-scan match's likelihood", gt=0, le=1)
    scan_overlap: float = setting(
        0.25, "share of matched end points below which a scan-to-scan match is left out and odometry rules", ge=0, le=1
    )
    scan_points: int = setting(200, "end points that are matched with the last key scan, about", ge=10)
    scan_gates: tuple[Positive, ...] = setting(
        (0.5, 0.3, 0.2, 0.1), "greatest distance of matched end points, iteration after iteration", "m", min_length=1
    )
    scan_iterations: int = setting(15, "of a match with the last key scan, at most", ge=1, le=100)
    scan_prior: float = setting(
        4.0, "how much wider than its noise the odometry's prior is in such a match: wheels also slip", gt=0
    )
    scan_good: float = setting(
        0.5, "share of matched end points from which such a match is good, and tells the odometry's errors", ge=0, le=1
    )
    scan_unseen: float = setting(
        1.3, "times the motion between key scans, from which such a match alone makes one", gt=0
    )
    scan_loosest: float = setting(0.1, "such a match is held to the odometry at least so firmly", "m and rad", gt=0)
    scan_turns: tuple[float, ...] = setting(
        (-0.45, -0.3, -0.15, 0.15, 0.3, 0.45), "turned by this, a match that found little starts again", "rad"
    )
    scan_better: float = setting(0.1, "share of end points that must match besides, from there", ge=0, le=1)
    scan_noise_distance: float = setting(0.01, "error of such a match", "m", gt=0)
    scan_noise_angle: float = setting(0.005, "error of such a match", "rad", gt=0)
    scan_near: float = setting(3.0, "standard deviations from the odometry within which a match is believed", ge=0)
    scan_freedom: float = setting(
        2.0, "degrees of freedom of Student's t, which the odometry's errors follow beyond them", gt=0
    )
    max_range: float = setting(20.0, "longer beams are neither matched nor written into the map", "m", gt=0)
    free_beams: int = setting(100, "beams that clear free space at most; all of them mark walls", ge=10)
    match_beams: int = setting(180, "end points that are matched with the map, evenly along the walls", ge=10)
    match_spacing: float = setting(0.05, "between end points that are matched with the map", "m", ge=0)
    start_window: float = setting(
        2.0, "standard deviations of the motion within which a match with the map starts from a grid of poses", ge=0
    )
    start_distance: float = setting(0.1, "between them", "m", gt=0)
    start_angle: float = setting(0.03, "between them", "rad", gt=0)
    most_starts: int = setting(12, "of them to either side in x, y and heading, at most", ge=0, le=50)
    search_distance: float = setting(0.04, "first step of the search for the optimum", "m", gt=0)
    search_angle: float = setting(0.02, "first step of the search for the optimum", "rad", gt=0)
    search_halvings: int = setting(4, "times that the steps are halved", ge=0, le=10)
    search_moves: int = setting(120, "moves that are tried with one step, at most", ge=6)
    samples: int = setting(30, "poses sampled round the optimum", ge=1, le=10_000)
    sample_distance: float = setting(0.01, "their spread", "m", gt=0)
    sample_angle: float = setting(0.005, "their spread", "rad", gt=0)
    noise_distance: float = setting(0.05, "odometry: m of error per m driven", gt=0)
    noise_angle: float = setting(0.1, "odometry: rad of error per rad turned", gt=0)
    noise_drift: float = setting(0.03, "odometry: rad of error per m driven", "rad/m", gt=0)
    noise_open: float = setting(0.03, "odometry: m of error per m driven where the scans leave a direction open", gt=0)
    unknown_speed: float = setting(0.5, "odometry unknown: m of error per s", "m/s", gt=0)
    unknown_turn: float = setting(1.5, "odometry unknown: rad of error per s", "rad/s", gt=0)
    least_distance: float = setting(0.005, "odometry: error at least", "m", gt=0)
    least_angle: float = setting(0.002, "odometry: error at least", "rad", gt=0)


class UncertaintyConfig(Section):
    """How far the pose may have drifted from the start, besides the spread of the particles."""

    scan_weight: float = setting(
        1000.0,
        "times the information of one scan match that a motion is known by, with the map and all its scans",
        gt=0,
    )
    scale: float = setting(0.05, "standard deviation of the odometry's scale at the start", gt=0)
    slip: float = setting(0.05, "... and later, by slip", gt=0)
    slip_length: float = setting(1.0, "driven until the wheels slip otherwise", "m", gt=0)
    agree: float = setting(
        0.1, "a pose no farther off than this from where it matches an earlier visit is as sure as that", "m", gt=0
    )
    known_share: float = setting(
        0.2, "a direction of which such a match knows less than this share of the other is not known by it", ge=0, le=1
    )
    visit_distance: float = setting(0.005, "standard deviation of such a match at least ...", "m", gt=0)
    visit_angle: float = setting(0.002, "... and", "rad", gt=0)
    least_distance: float = setting(0.003, "standard deviation of the first pose", "m", gt=0)
    least_angle: float = setting(0.001, "standard deviation of the first pose", "rad", gt=0)


class RbpfConfig(GraphConfig):
    """The filter with a map per particle, and what settles its trajectory in hindsight."""

    backend: Literal["rao_blackwellized"] = setting("rao_blackwellized", "N trajectories, each with a map of its own")
    particles: int = setting(500, "N, the number of particles, each with a map of its own", ge=1, le=1_000)
    rao_blackwellized: RaoBlackwellizedConfig = RaoBlackwellizedConfig()
    uncertainty: UncertaintyConfig = UncertaintyConfig()
