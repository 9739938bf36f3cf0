"""The filter's settings: every number of it, validated, read from TOML.

An unknown key, a wrong type or a value out of range is an :class:`InputError` that names file, key and what is allowed.
"""

import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pfslam_viz.errors import InputError
from pfslam_viz.robot import Robot

Model = TypeVar("Model", bound=BaseModel)

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class MotionConfig(_Section):
    """Noise of the motion model, (18) and (19).

    The scaled model's variances grow with what was driven, turned and waited, so that they do not depend on how many
    scans a drive is cut into.
    """

    model: Literal["additive", "scaled"] = Field("additive", description="additive: the paper's; scaled: with motion")
    variance: tuple[NonNegative, NonNegative, NonNegative] = Field(
        (0.001, 0.001, 0.001),
        strict=False,
        description="additive: variance of x, y (m²) and heading (rad²) per scan, (39)",
    )
    distance_by_distance: NonNegative = Field(0.03, description="scaled: std of the position, m, after 1 m")
    distance_by_turn: NonNegative = Field(0.02, description="scaled: ..., m, after 1 rad")
    turn_by_turn: NonNegative = Field(0.05, description="scaled: std of the heading, rad, after 1 rad")
    turn_by_distance: NonNegative = Field(0.02, description="scaled: ..., rad, after 1 m")
    turn_by_time: NonNegative = Field(0.002, description="scaled: ..., rad, after 1 s: the gyro's own")


class ObservationConfig(_Section):
    """How a scan is compared with the map."""

    model: Literal["correlation", "scan_matching"] = Field(
        "correlation", description="correlation: the paper's; scan_matching: point to line, see [matching]"
    )
    perturbation: bool = Field(False, description="correlation: best of the offsets below, IV-E-1")
    perturbation_cells: int = Field(1, ge=0, le=5)
    perturbation_angle: float = Field(0.02, ge=0, le=0.5, description="rad")
    max_range: Positive | None = Field(None, description="m; beams longer than this are not used")
    max_beams: int | None = Field(None, ge=1, description="thin a scan to at most this many beams")


class MapConfig(_Section):
    """The occupancy grid, (20) to (29)."""

    cell: float = Field(0.07, ge=0.005, le=1.0, description="m")
    log_odds_hit: Positive = 1.3862943611198906
    log_odds_miss: Positive = 1.3862943611198906
    log_odds_bound: Positive = 100.0
    threshold: NonNegative = Field(0.0, description="(29): above it a cell is occupied")


class ResamplingConfig(_Section):
    """When and how particles are drawn anew, (30) to (32)."""

    policy: Literal["always", "n_eff"] = "always"
    threshold: float = Field(0.5, gt=0, le=1, description="n_eff: resample when N_eff < threshold x N")
    scheme: Literal["multinomial", "systematic", "stratified", "residual"] = "systematic"


class MatchingConfig(_Section):
    """Matching a scan with the map, point to line."""

    update_distance: NonNegative = Field(0.03, description="m; a scan is matched and drawn after so much motion ...")
    update_angle: NonNegative = Field(0.015, description="rad; ... or so much turning, or when the robot has stopped")
    wall_reach: Positive = Field(0.3, description="m; a wall's direction is taken from end points this near")
    search: int = Field(4, ge=1, le=20, description="cells; an end point looks so far for its wall")
    sigma: Positive = Field(0.03, description="m; spread of end points about a wall")
    temper: Positive = Field(0.1, description="exponent of the scan's likelihood: beams are not independent")
    least_distance: Positive = Field(0.004, description="m; the prediction is never trusted to better")
    least_angle: Positive = Field(0.002, description="rad; the prediction is never trusted to better")
    degenerate: NonNegative = Field(
        0.01, description="a direction with less than this share of the scan's information is left to the odometry"
    )
    lost: float = Field(0.6, ge=0, le=1, description="a match that agrees less than this is tried again from around")
    lost_distance: Positive = Field(0.2, description="m; how far around")
    lost_angle: Positive = Field(0.2, description="rad; how far around")
    memory: int = Field(1000, ge=1, description="a wall's place is the mean over so many end points")


class RaoBlackwellizedConfig(_Section):
    """The filter with a map per particle (Grisetti, Stachniss & Burgard 2007)."""

    update_distance: Positive = Field(0.15, description="m; a scan is used after so much motion ...")
    update_angle: Positive = Field(0.15, description="rad; ... or so much turning")
    sigma: Positive = Field(0.05, description="m; spread of end points about a wall")
    floor: float = Field(0.1, gt=0, lt=1, description="share of end points that no wall explains")
    temper: Positive = Field(0.1, description="exponent of the scan's likelihood: beams are not independent")
    scan_temper: Positive = Field(0.05, description="exponent of the scan-to-scan match's likelihood")
    scan_overlap: float = Field(0.25, ge=0, le=1, description="share of matched end points below which odometry rules")
    max_range: Positive = Field(20.0, description="m; beams longer than this are neither matched nor drawn")
    free_beams: int = Field(100, ge=10, description="beams that clear free space at most; all of them mark walls")
    match_beams: int = Field(180, ge=10, description="end points that are matched, spread evenly along the walls")
    match_spacing: NonNegative = Field(0.05, description="m between end points that are matched")
    search_distance: Positive = Field(0.04, description="m; first step of the search")
    search_angle: Positive = Field(0.02, description="rad; first step of the search")
    search_halvings: int = Field(4, ge=0, le=10)
    samples: int = Field(30, ge=1, description="poses drawn round the optimum")
    sample_distance: Positive = Field(0.01, description="m; their spread")
    sample_angle: Positive = Field(0.005, description="rad; their spread")
    noise_distance: Positive = Field(0.05, description="odometry: m of error per m driven")
    noise_angle: Positive = Field(0.1, description="odometry: rad of error per rad turned")
    noise_drift: Positive = Field(0.03, description="odometry: rad of error per m driven")
    noise_open: Positive = Field(0.03, description="the same where the scans leave a direction open")
    least_distance: Positive = Field(0.005, description="odometry: m of error at least")
    least_angle: Positive = Field(0.002, description="odometry: rad of error at least")


class SmoothingConfig(_Section):
    """The pose graph over the key scans, which settles the whole trajectory in hindsight."""

    enabled: bool = True
    rounds: int = Field(2, ge=2, le=20, description="matching all neighbouring key scans and relaxing the graph")
    radius: Positive = Field(2.0, description="m; key scans this near are neighbours")
    neighbours: int = Field(3, ge=0, description="earlier visits that a key scan is matched with")
    apart: int = Field(30, ge=1, description="key scans between two visits")
    overlap: float = Field(0.3, ge=0, le=1, description="share of matched end points below which a match is refused")
    distance: Positive = Field(0.05, description="m; mean distance from the walls above which a match is refused")
    temper: Positive = Field(0.1, description="exponent of a match's likelihood")
    noise_distance: Positive = Field(0.1, description="odometry: m of error per m driven")
    noise_angle: Positive = Field(0.2, description="odometry: rad of error per rad turned")
    noise_drift: Positive = Field(0.05, description="odometry: rad of error per m driven")
    least: Positive = Field(0.01, description="odometry: m and rad of error at least")
    scale: Positive = Field(5.0, description="sigmas beyond which a match loses its say")


class LoopClosingConfig(_Section):
    """When the key scans are believed to show a place that the trajectory has drifted away from."""

    enabled: bool = True
    least_loop: Positive = Field(10.0, description="m driven since a place before it is looked for")
    least_reach: Positive = Field(1.0, description="m searched round about at least ...")
    drift: NonNegative = Field(0.03, description="... and so many m more per m driven since ...")
    most_reach: Positive = Field(5.0, description="... but no more than this")
    most_turn: Positive = Field(0.18, description="rad searched to either side")
    score: float = Field(0.55, gt=0, le=1, description="mean agreement below which a fit is refused")
    rival: float = Field(0.85, gt=0, le=1, description="share of the best fit's score that no other place may reach")
    rival_distance: Positive = Field(0.7, description="m from the best fit where another place begins")
    overlap: float = Field(0.4, ge=0, le=1, description="share of matched end points below which a fit is refused")
    distance: Positive = Field(0.03, description="m; mean distance from the walls above which a fit is refused")
    temper: Positive = Field(0.1, description="exponent of a closure's likelihood")
    gain: NonNegative = Field(5.0, description="matches by which the graph must agree better with a loop closed")


class TextureConfig(_Section):
    """The floor texture map, section K."""

    enabled: bool = True
    floor_tolerance: Positive = Field(0.05, description="m; a point within this height of z = 0 is floor")
    max_range: Positive = Field(4.0, description="m ahead of the camera")


class Config(_Section):
    """Everything the filter needs to know besides the recording."""

    name: str = "default"
    backend: Literal["single_map", "rao_blackwellized"] = "single_map"
    particles: int = Field(500, ge=1, le=100_000)
    seed: int = Field(0, ge=0)
    motion: MotionConfig = MotionConfig()
    observation: ObservationConfig = ObservationConfig()
    matching: MatchingConfig = MatchingConfig()
    map: MapConfig = MapConfig()
    resampling: ResamplingConfig = ResamplingConfig()
    rao_blackwellized: RaoBlackwellizedConfig = RaoBlackwellizedConfig()
    smoothing: SmoothingConfig = SmoothingConfig()
    loop_closing: LoopClosingConfig = LoopClosingConfig()
    texture: TextureConfig = TextureConfig()


def configs_dir() -> Path:
    """The folder of shipped TOML files: inside an installed wheel, or the checkout's ``configs/``."""
    package = Path(__file__).resolve().parent
    shipped = package / "_configs"
    return shipped if shipped.is_dir() else package.parent / "configs"


def find_config(name_or_path: str | Path, kind: str = "configuration", folder: Path | None = None) -> Path:
    """The file that a shipped name (``paper``) or a path stands for."""
    folder = folder or configs_dir()
    path = Path(name_or_path)
    if path.suffix == ".toml" or len(path.parts) > 1:
        if path.is_file():
            return path
        raise InputError(f"{path}: no such {kind} file")
    shipped = folder / f"{path}.toml"
    if shipped.is_file():
        return shipped
    known = ", ".join(sorted(p.stem for p in folder.glob("*.toml")))
    raise InputError(f"no {kind} is called '{path}'; there are {known}, or give the path of a .toml file")


def load_config(name_or_path: str | Path = "default", settings: Iterable[str] = ()) -> Config:
    """Read a configuration and apply ``section.key=value`` settings (values in TOML; bare words are strings)."""
    path = find_config(name_or_path)
    values = _read_toml(path)
    values.setdefault("name", path.stem)
    for setting in settings:
        _apply(values, setting)
    return _validate(Config, values, path)


def load_robot(name_or_path: str | Path = "ece276a") -> Robot:
    """Read a robot file: a shipped name from ``configs/robots`` or a path."""
    path = find_config(name_or_path, "robot", configs_dir() / "robots")
    return _validate(Robot, _read_toml(path), path)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def _apply(values: dict[str, Any], setting: str) -> None:
    key, equals, text = setting.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts):
        raise InputError(f"--set {setting}: write it as section.key=value, such as map.cell=0.05")
    try:
        value = tomllib.loads(f"v = {text.strip()}")["v"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    table = values
    for part in parts[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise InputError(f"--set {setting}: {part} is not a section")
    table[parts[-1]] = value


def _validate(model: type[Model], values: dict[str, Any], path: Path) -> Model:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise InputError(f"{path}: " + "; ".join(_explain(model, e) for e in error.errors())) from None


def _explain(model: type[BaseModel], error: Any) -> str:
    key = ".".join(str(part) for part in error["loc"])
    if error["type"] == "missing":
        return f"'{key}' is missing"
    if error["type"] == "model_type":
        return f"'{key}' = {error['input']!r}: it is a section, [{key}]"
    if error["type"] == "extra_forbidden":
        section: Any = model
        for part in error["loc"][:-1]:
            annotation = section.model_fields[part].annotation
            section = next(kind for kind in (annotation, *get_args(annotation)) if hasattr(kind, "model_fields"))
        return f"unknown key '{key}'; allowed here: {', '.join(section.model_fields)}"
    return f"'{key}' = {error['input']!r}: {error['msg'][0].lower()}{error['msg'][1:]}"
