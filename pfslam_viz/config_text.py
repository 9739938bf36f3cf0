"""Settings as text: TOML that can be read back, and the reference page of the documentation.

Both come from the settings' types, so that they cannot say anything else than what is checked.
"""

import json
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

import annotated_types
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from pfslam_viz.config import load_config
from pfslam_viz.settings import Config
from pfslam_viz.slam.backends import BACKENDS

_LOWEST = ((annotated_types.Ge, "ge", ">="), (annotated_types.Gt, "gt", ">"))
_HIGHEST = ((annotated_types.Le, "le", "<="), (annotated_types.Lt, "lt", "<"))

SHIPPED = {"single_map": "paper", "rao_blackwellized": "default"}
"""The shipped configuration that shows a back end's sections."""

PAGE_HEAD = """\
# Settings

Every number that changes a result, by filter and section. This page is made from the code by
`pfslam-viz config --markdown`; `pfslam-viz config NAME` prints one configuration as TOML that `--config` reads back.
A key that the chosen filter does not read is an error.
"""


def as_toml(config: Config) -> str:
    """Every setting of a configuration, with range, unit and meaning as comments; :func:`load_config` reads it back."""
    lines: list[str] = []
    top = [(name, field) for name, field in type(config).model_fields.items() if not _is_section(field)]
    for name, field in top:
        lines += _toml_lines(name, field, getattr(config, name))
    for name, field in type(config).model_fields.items():
        if _is_section(field):
            section = getattr(config, name)
            lines += ["", f"[{name}]  # {_first_line(section)}"]
            for key, inner in type(section).model_fields.items():
                lines += _toml_lines(key, inner, getattr(section, key))
    return "\n".join(lines) + "\n"


def as_markdown() -> str:
    """The reference page: the settings of every back end, with the values of the shipped configuration that uses it."""
    parts = [PAGE_HEAD]
    for backend in BACKENDS:
        config = load_config(SHIPPED[backend])
        parts.append(f"\n## The filter `{backend}` (`--config {SHIPPED[backend]}`)\n\n{_first_line(config)}\n")
        parts += _table("", config)
        for name, field in type(config).model_fields.items():
            if _is_section(field):
                section = getattr(config, name)
                parts.append(f"\n### `[{name}]`\n\n{_first_line(section)}\n")
                parts += _table(f"{name}.", section)
    return "\n".join(parts) + "\n"


def settings_of(model: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Every setting of a settings type as (``section.key``, field)."""
    for name, field in model.model_fields.items():
        if _is_section(field):
            assert isinstance(field.annotation, type)
            yield from settings_of(field.annotation, f"{name}.")
        else:
            yield f"{prefix}{name}", field


def allowed(field: FieldInfo) -> str:
    """The range of a setting, in words: ``> 0``, ``0.005 to 1``, ``always or n_eff``."""
    annotation = field.annotation
    if get_origin(annotation) is Literal:
        return " or ".join(str(choice) for choice in get_args(annotation))
    if annotation is bool:
        return "true or false"
    limits = {type(m): m for m in field.metadata}
    low, high = (
        next((f"{sign} {_number(getattr(limits[kind], name))}" for kind, name, sign in kinds if kind in limits), "")
        for kinds in (_LOWEST, _HIGHEST)
    )
    if low.startswith(">=") and high.startswith("<="):
        return f"{low[3:]} to {high[3:]}"
    return f"{low} and {high}" if low and high else low or high


def _number(limit: float) -> str:
    return f"{limit:,}" if isinstance(limit, int) else f"{limit:g}"


def _is_section(field: FieldInfo) -> bool:
    return isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)


def _first_line(value: object) -> str:
    return (type(value).__doc__ or "").split("\n", 1)[0]


def _unit(field: FieldInfo) -> str:
    extra = field.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def _toml_lines(name: str, field: FieldInfo, value: Any) -> list[str]:
    """A comment and the value; a value that is not set stands in the comment alone."""
    about = "; ".join(part for part in (_unit(field), allowed(field), field.description or "") if part)
    return [f"# {name}: {about}", f"# {name} = (not set)" if value is None else f"{name} = {_toml(value)}"]


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    return repr(value)


def _table(prefix: str, section: BaseModel) -> list[str]:
    rows = ["| key | value | unit | range | meaning |", "| --- | --- | --- | --- | --- |"]
    for name, field in type(section).model_fields.items():
        if not _is_section(field):
            value = getattr(section, name)
            shown = "not set" if value is None else _toml(value)
            meaning = (field.description or "").replace("|", "\\|")
            rows.append(f"| `{prefix}{name}` | `{shown}` | {_unit(field)} | {allowed(field)} | {meaning} |")
    return rows
