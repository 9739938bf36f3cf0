"""One cell's row: which numbers it has, under which names."""

from collections.abc import Mapping
from typing import Any

from pfslam_viz.evaluation.metrics import versions
from pfslam_viz.evaluation.report import Scores
from pfslam_viz.sweep.version import code_version

Value = str | float | int | None
Row = dict[str, Value]

NUMBERS: dict[str, tuple[str, str]] = {
    "position_rmse_m": ("truth", "position_rmse_m"),
    "position_max_m": ("truth", "position_max_m"),
    "position_final_m": ("truth", "position_final_m"),
    "heading_rmse_deg": ("truth", "heading_rmse_deg"),
    "heading_max_deg": ("truth", "heading_max_deg"),
    "relations_translation_mean_m": ("relations", "translation_mean_m"),
    "relations_translation_std_m": ("relations", "translation_std_m"),
    "relations_rotation_mean_deg": ("relations", "rotation_mean_deg"),
    "relations_rotation_std_deg": ("relations", "rotation_std_deg"),
    "end_to_start_gap_m": ("map", "end_to_start_gap_m"),
    "path_ratio": ("map", "path_ratio"),
    "occupied_area_m2": ("map", "occupied_area_m2"),
    "wall_thickness_m": ("map", "wall_thickness_m"),
    "scan_to_map_score": ("map", "scan_to_map_score"),
    "revisit_error_m": ("map", "revisit_error_m"),
    "revisit_rotation_deg": ("map", "revisit_rotation_deg"),
    "n_eff_mean": ("filter", "n_eff_mean"),
    "n_eff_min": ("filter", "n_eff_min"),
    "resamplings": ("map", "resamplings"),
    "uninformative": ("filter", "uninformative"),
    "time_s": ("speed", "total_s"),
    "time_per_scan_ms": ("speed", "ms_per_scan"),
    "times_real_time": ("speed", "times_real_time"),
}
"""Column: section and key of the scores."""

TIMES = ("time_s", "time_per_scan_ms", "times_real_time", "cell_s")
"""Columns that differ from run to run; ``cell_s`` is the whole cell, scoring included."""

LIBRARIES = ("python", "numpy", "scipy", "numba")
LAST = ("cell_s", "code", *LIBRARIES, "error", "cell")
HIGHER_IS_BETTER = ("scan_to_map_score", "n_eff_mean", "n_eff_min", "times_real_time")
JUDGES = ("position_rmse_m", "relations_translation_mean_m", "wall_thickness_m")
"""What cells are ranked by: the first of these that a recording's cells have."""


def columns(settings: tuple[str, ...]) -> list[str]:
    """All columns of results.csv, where these settings are swept."""
    return ["recording", "config", *settings, "seed", *NUMBERS, *LAST]


def numbers(scores: Scores) -> Row:
    """The scores of a run under their columns' names; None for what is not known."""
    return {column: scores.get(section, {}).get(key) for column, (section, key) in NUMBERS.items()}


def provenance() -> Row:
    """The code and the libraries of this process."""
    found: Mapping[str, Any] = versions()
    return {"code": code_version(), **{name: found.get(name) for name in LIBRARIES}}
