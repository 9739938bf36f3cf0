"""What settings are made of, and those that every back end reads.

A setting is a field with a default, a unit, a range and a line of meaning; :mod:`pfslam_viz.config` reads them from
TOML, and ``pfslam-viz config`` prints them.
"""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

MOST = 1_000_000  # of anything that is counted: more would fill the memory, not change the result


class Section(BaseModel):
    """A table of settings. Unknown keys and other types are refused, and nothing can be changed."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


def setting(default: Any, meaning: str, unit: str = "", **limits: Any) -> Any:
    """A field: its ``default``, what it means, its unit, and pydantic's limits (``gt``, ``ge``, ``lt``, ``le``).

    Numbers must be finite, and counts no larger than :data:`MOST` unless ``le`` is given (None: no limit). Tuples,
    which TOML has as arrays, are taken from lists.
    """
    extra: dict[str, JsonValue] = {"unit": unit}
    if isinstance(default, int) and not isinstance(default, bool):
        limits = {"le": MOST, **limits}
    if isinstance(default, float):
        limits.setdefault("allow_inf_nan", False)
    if isinstance(default, tuple):
        limits["strict"] = False
    return Field(default, description=meaning, json_schema_extra=extra, **limits)


class ScanConfig(Section):
    """Which beams of a scan are used."""

    max_range: float | None = setting(None, "longer beams are not used; none: the lidar's own limit", "m", gt=0)
    max_beams: int | None = setting(
        None, "a scan is thinned to at most so many beams; none: all of them", ge=1, le=MOST
    )
    deskew: bool = setting(True, "correct end points by the odometry's motion during the scan, where beams have a time")


class MapConfig(Section):
    """The occupancy grid, (20) to (29)."""

    cell: float = setting(0.07, "edge of a cell", "m", ge=0.005, le=1.0)
    log_odds_hit: float = setting(1.3862943611198906, "(28): what an end point adds to its cell", gt=0)
    log_odds_miss: float = setting(1.3862943611198906, "(28): what a beam takes from a cell that it crosses", gt=0)
    log_odds_bound: float = setting(100.0, "log-odds stay within plus and minus this", gt=0)
    threshold: float = setting(0.0, "(29): log-odds above which a cell is occupied", ge=0)


class ResamplingConfig(Section):
    """When and how particles are resampled, (30) to (32)."""

    policy: Literal["always", "n_eff"] = setting("always", "after every update, or when N_eff falls too low")
    threshold: float = setting(0.5, "n_eff: resample when N_eff < threshold x N", gt=0, le=1)
    scheme: Literal["multinomial", "systematic", "stratified", "residual"] = setting(
        "systematic", "how ancestors are picked, (31)"
    )


class TextureConfig(Section):
    """The floor texture map, section K."""

    enabled: bool = setting(True, "paint the floor, if the recording has images of it")
    camera: Literal["fitted", "filed"] = setting(
        "fitted", "pitch, roll and height by the floor in the images, or as the robot file has them"
    )
    floor_tolerance: float = setting(
        0.05, "a point within this height of z = 0 is floor; half of it if the camera is fitted", "m", gt=0
    )
    max_range: float = setting(4.0, "floor is painted up to so far ahead of the camera", "m", gt=0)
    blend: Literal["finest", "mean"] = setting(
        "finest", "finest: exposures are evened out and close views overrule far ones; mean: of all pixels as they are"
    )


class Config(Section):
    """What every filter needs to know besides the recording; each back end adds its own sections."""

    name: str = setting("default", "what the configuration is called in tables and in the viewer")
    backend: str = setting("single_map", "which filter runs")
    particles: int = setting(500, "N, the number of particles", ge=1, le=100_000)
    seed: int = setting(0, "of the random numbers: the same seed gives the same result", ge=0, le=None)
    observation: ScanConfig = ScanConfig()
    map: MapConfig = MapConfig()
    resampling: ResamplingConfig = ResamplingConfig()
    texture: TextureConfig = TextureConfig()
