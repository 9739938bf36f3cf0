"""What a sweep runs: every combination of recordings, configurations, listed values and seeds."""

import hashlib
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from pfslam_viz.config import Config, load_config
from pfslam_viz.errors import InputError
from pfslam_viz.evaluation.cell import seeded
from pfslam_viz.recordings.choice import RecordingChoice

COMMA = re.compile(r",(?![^\[]*\])")  # outside brackets


@dataclass(frozen=True, slots=True)
class Block:
    """Configurations, ``NAME|PATH[,KEY=VALUE...]`` each, under all combinations of the values listed for each key."""

    configs: tuple[str, ...] = ("default",)
    values: tuple[tuple[str, tuple[str, ...]], ...] = ()


@dataclass(frozen=True, slots=True)
class Variant:
    """One configuration: what it is called, the value of every swept setting in it, and the thing itself."""

    config: str
    settings: tuple[tuple[str, str], ...]
    values: Config


@dataclass(frozen=True, slots=True)
class Cell:
    """One run. ``id`` tells its content: recording, configuration and seed."""

    id: str
    recording: str
    variant: Variant
    seed: int

    @property
    def config(self) -> Config:
        """The configuration with the cell's seed."""
        return seeded(self.variant.values, self.seed)

    @property
    def key(self) -> dict[str, str]:
        """What stands in the first columns of its row, as text: unique in a sweep."""
        return {
            "recording": self.recording,
            "config": self.variant.config,
            **dict(self.variant.settings),
            "seed": str(self.seed),
        }


@dataclass(frozen=True, slots=True)
class Plan:
    """A sweep: recordings by their labels, variants in the order in which they were listed, and seeds.

    ``keys`` are the swept settings, ``section.key``.
    """

    recordings: tuple[tuple[str, RecordingChoice], ...]
    variants: tuple[Variant, ...]
    seeds: tuple[int, ...]
    keys: tuple[str, ...]

    @property
    def count(self) -> int:
        """How many cells there are."""
        return len(self.recordings) * len(self.variants) * len(self.seeds)

    @property
    def in_words(self) -> str:
        """Such as ``12 runs: 1 recording x 4 settings x 3 seeds``."""
        numbers = ((self.recordings, "recording"), (self.variants, "configuration"), (self.seeds, "seed"))
        parts = [f"{len(items)} {word}{'s' * (len(items) != 1)}" for items, word in numbers]
        return f"{self.count:,} run{'s' * (self.count != 1)}: {' x '.join(parts)}"

    def cells(self, fingerprints: Mapping[str, str]) -> list[Cell]:
        """All cells, recording by recording; ``fingerprints`` has the digest of each recording by its label."""
        return [
            Cell(cell_id(label, fingerprints[label], variant, seed), label, variant, seed)
            for label, _ in self.recordings
            for variant in self.variants
            for seed in self.seeds
        ]


def make_plan(recordings: Sequence[tuple[str, RecordingChoice]], blocks: Sequence[Block], seeds: Sequence[int]) -> Plan:
    """All combinations; a configuration that several blocks ask for is run once.

    Raises InputError for a setting or a value that is not allowed, a name that stands for two recordings, no seed.
    """
    labels = [label for label, _ in recordings]
    if twice := [label for label in labels if labels.count(label) > 1]:
        raise InputError(f"{twice[0]}: is listed twice; give each recording once")
    if not recordings or not seeds:
        raise InputError("a sweep needs a recording and a seed, at least")
    if repeated := [seed for seed in seeds if list(seeds).count(seed) > 1]:
        raise InputError(f"seed {repeated[0]} is listed twice")
    keys = tuple(dict.fromkeys(key for block in blocks for key, _ in block.values))
    found: dict[str, Variant] = {}
    for block in blocks:
        for text in block.configs:
            for combination in itertools.product(*(values for _, values in block.values)):
                chosen = dict(zip((key for key, _ in block.values), combination, strict=True))
                variant = _variant(text, chosen, keys)
                found.setdefault(json.dumps([variant.config, _content(variant.values)]), variant)
    return Plan(tuple(recordings), tuple(found.values()), tuple(seeds), keys)


def parse_values(settings: Sequence[str]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """``--set`` texts ``section.key=value,value,...`` as keys with their values. Raises InputError for other texts."""
    found: dict[str, tuple[str, ...]] = {}
    for setting in settings:
        key, equals, text = (part.strip() for part in setting.partition("="))
        values = tuple(value.strip() for value in COMMA.split(text))
        if not equals or not key or not all(values):
            raise InputError(f"--set {setting}: write it as section.key=value,value, such as particles=50,100")
        if key in found:
            raise InputError(f"--set {setting}: {key} is set twice; list its values in one --set, with commas")
        found[key] = values
    return tuple(found.items())


def text_of(value: Any) -> str:
    """A setting's value as its column has it and ``--set`` reads it; empty for one that is not set."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(text_of(item) for item in value)}]"
    return str(value)


def setting_text(config: Config, key: str) -> str:
    """The value of ``section.key`` as :func:`text_of`; empty where the configuration's filter has no such setting."""
    value: Any = config
    for part in key.split("."):
        value = getattr(value, part, None)
    return "" if isinstance(value, BaseModel) else text_of(value)


def cell_id(recording: str, fingerprint: str, variant: Variant, seed: int) -> str:
    """Twelve hexadecimal digits of all that a cell's numbers depend on, the code aside."""
    content = json.dumps([recording, fingerprint, variant.config, _content(variant.values), seed])
    return hashlib.sha256(content.encode()).hexdigest()[:12]


def _variant(text: str, chosen: Mapping[str, str], keys: Sequence[str]) -> Variant:
    name, *own = COMMA.split(text)
    for setting in own:
        key = setting.partition("=")[0].strip()
        if key in chosen:
            raise InputError(f"--config {text}: {key} is swept by --set {key}=...; set it in one of the two places")
    settings = [*own, *(f"{key}={value}" for key, value in chosen.items())]
    config = load_config(name, [*settings, f"name='{text}'"])
    return Variant(text, tuple((key, setting_text(config, key)) for key in keys), config)


def _content(config: Config) -> Any:
    return config.model_dump(mode="json", exclude={"name", "seed"})
