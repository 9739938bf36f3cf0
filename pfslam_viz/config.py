"""Configurations and robot files: TOML, read and validated.

An unknown key, a key that the chosen filter does not read, a wrong type or a value out of range is an
:class:`InputError` that names the file or the ``--set``, the key and what is allowed.
"""

import tomllib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, overload

from pydantic import BaseModel, ValidationError

from pfslam_viz.errors import InputError
from pfslam_viz.files import read_small
from pfslam_viz.robot import Robot
from pfslam_viz.settings import Config
from pfslam_viz.slam.backends import BACKENDS
from pfslam_viz.slam.paper.settings import PaperConfig
from pfslam_viz.slam.rbpf.settings import RbpfConfig

__all__ = ["Config", "configs_dir", "find_config", "load_config", "load_robot"]

Model = TypeVar("Model", bound=BaseModel)
Source = Callable[[str], str]
Blame = Callable[[tuple[str | int, ...]], str]

ALSO_CALLED = {"carmen": "default"}
"""Older names of shipped configurations."""


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
    shipped = folder / f"{ALSO_CALLED.get(str(path), path)}.toml"
    if shipped.is_file():
        return shipped
    known = ", ".join(sorted(p.stem for p in folder.glob("*.toml")))
    raise InputError(f"no {kind} is called '{path}'; there are {known}, or give the path of a .toml file")


@overload
def load_config(name_or_path: Literal["paper"], settings: Iterable[str] = (), source: Source = ...) -> PaperConfig: ...
@overload
def load_config(
    name_or_path: Literal["default"] = "default", settings: Iterable[str] = (), source: Source = ...
) -> RbpfConfig: ...
@overload
def load_config(name_or_path: str | Path, settings: Iterable[str] = (), source: Source = ...) -> Config: ...
def load_config(
    name_or_path: str | Path = "default", settings: Iterable[str] = (), source: Source = "--set {}".format
) -> Config:
    """Read a configuration and apply ``section.key=value`` settings (values in TOML; bare words are strings).

    ``source`` says how the user wrote a setting, for messages. Returns the settings type of the back end that the
    configuration names.
    """
    path = find_config(name_or_path)
    values = _read_toml(path)
    values.setdefault("name", path.stem)
    written: dict[tuple[str, ...], str] = {}
    for setting in settings:
        written[_apply(values, setting, source(setting))] = source(setting)

    def blame(location: tuple[str | int, ...]) -> str:
        for key, text in reversed(written.items()):
            if key == location[: len(key)] or location == key[: len(location)]:
                return text
        return str(path)

    backend = values.get("backend", "single_map")
    if backend not in BACKENDS:
        raise InputError(f"{blame(('backend',))}: 'backend' = {backend!r}: there are {' and '.join(BACKENDS)}")
    return _validate(BACKENDS[backend].settings, values, blame)


def load_robot(name_or_path: str | Path = "ece276a") -> Robot:
    """Read a robot file: a shipped name from ``configs/robots`` or a path."""
    path = find_config(name_or_path, "robot", configs_dir() / "robots")
    return _validate(Robot, _read_toml(path), lambda _: str(path))


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_small(path).decode("utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except RecursionError:
        raise InputError(f"{path}: not valid TOML: nested too deeply") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None


def _apply(values: dict[str, Any], setting: str, source: str) -> tuple[str, ...]:
    """Put one setting into ``values``; its key."""
    key, equals, text = setting.partition("=")
    parts = key.strip().split(".")
    if not equals or not all(parts):
        raise InputError(f"{source}: write it as section.key=value, such as map.cell=0.05")
    try:
        value = tomllib.loads(f"v = {text.strip()}")["v"]
    except (tomllib.TOMLDecodeError, RecursionError):
        value = text.strip()
    table = values
    for part in parts[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise InputError(f"{source}: {part} is not a section")
    table[parts[-1]] = value
    return tuple(parts)


def _validate(model: type[Model], values: Mapping[str, Any], blame: Blame) -> Model:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        mistakes: dict[str, list[str]] = {}
        for mistake in error.errors():
            mistakes.setdefault(blame(mistake["loc"]), []).append(_explain(model, mistake))
        raise InputError("; ".join(f"{who}: {'; '.join(what)}" for who, what in mistakes.items())) from None


def _explain(model: type[BaseModel], error: Any) -> str:
    key = ".".join(str(part) for part in error["loc"])
    if error["type"] == "missing":
        return f"'{key}' is missing"
    if error["type"] == "model_type":
        return f"'{key}' = {error['input']!r}: it is a section, [{key}]"
    if error["type"] == "extra_forbidden":
        section: Any = model
        for part in error["loc"][:-1]:
            section = _section(section, part)
        return f"{_unread(model, error['loc'])}; allowed here: {', '.join(section.model_fields)}"
    return f"'{key}' = {error['input']!r}: {error['msg'][0].lower()}{error['msg'][1:]}"


def _section(model: Any, key: str | int) -> Any:
    annotation = model.model_fields[key].annotation
    return next(kind for kind in (annotation, *get_args(annotation)) if hasattr(kind, "model_fields"))


def _unread(model: type[BaseModel], key: tuple[str | int, ...]) -> str:
    """That nobody knows a key, or that only another filter does."""
    name = ".".join(str(part) for part in key)
    own = next((backend for backend, row in BACKENDS.items() if row.settings is model), None)
    others = [backend for backend, row in BACKENDS.items() if row.settings is not model and _has(row.settings, key)]
    if own is None:
        return f"unknown key '{name}'"
    return f"unknown key '{name}': the filter {own} does not read it" + (
        f", {' and '.join(others)} does" * bool(others)
    )


def _has(model: Any, key: tuple[str | int, ...]) -> bool:
    for part in key:
        if part not in getattr(model, "model_fields", {}):
            return False
        annotation = model.model_fields[part].annotation
        model = next((kind for kind in (annotation, *get_args(annotation)) if hasattr(kind, "model_fields")), None)
    return True
