"""A sweep as a TOML file, for larger studies: docs/sweep.md shows one."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pfslam_viz.config import configs_dir, find_config
from pfslam_viz.errors import InputError
from pfslam_viz.sweep.plan import Block, text_of

Seed = Annotated[int, Field(ge=0)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class BlockTable(_Table):
    """``config`` and ``set``: a list of values for each key, or one value."""

    config: str | list[str] = "default"
    set: dict[str, Any] = Field(default_factory=dict)

    def block(self) -> Block:
        """The same as a :class:`~pfslam_viz.sweep.plan.Block`."""
        configs = (self.config,) if isinstance(self.config, str) else tuple(self.config)
        values = []
        for key, listed in _flat(self.set):
            many = listed if isinstance(listed, list) else [listed]
            values.append((key, tuple(text_of(value) for value in many)))
        return Block(configs, tuple(values))


class PlanFile(BlockTable):
    """A whole file: ``recordings``, ``seeds`` (how many, or which) and one block, or several as ``[[runs]]``."""

    recordings: list[str] = Field(default_factory=list)
    seeds: Annotated[int, Field(ge=1)] | list[Seed] | None = None
    by: str | None = None
    runs: list[BlockTable] = Field(default_factory=list)

    @property
    def blocks(self) -> list[Block]:
        """The blocks that it lists; none where it lists no configuration and no setting."""
        if self.runs:
            return [table.block() for table in self.runs]
        return [self.block()] if self.model_fields_set & {"config", "set"} else []


def _flat(table: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys of nested tables, since TOML reads ``map.cell`` without quotes as a table."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_plan_file(name_or_path: Path) -> PlanFile:
    """A path, or the name of a study in ``configs/sweeps``. Raises InputError for a file that is not such a plan."""
    path = find_config(name_or_path, "sweep", configs_dir() / "sweeps")
    try:
        table = PlanFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"] if isinstance(part, int) or part.islower())
        known = "recordings, seeds, by, config, set, and [[runs]] with config and set"
        raise InputError(f"{path}: '{key}': {first['msg']}; a sweep's file has {known}") from None
    if table.runs and table.model_fields_set & {"config", "set"}:
        raise InputError(f"{path}: config and set stand either at the top or in [[runs]], not in both")
    return table
