"""What each ingredient of the filter buys: variants x recordings x seeds, as Markdown.

python -m benchmarks accuracy --data DIR --recording 21 --recording intel --seeds 5
python -m benchmarks accuracy --recording office:3 --recording ring:1 --variant default --variant "no resampling: ..."

A recording is a name or a path, or BUILDING:SEED (office, ring, hallway) for one that is simulated into --scratch. A
variant is one of VARIANTS below by its label, or "label: KEY=VALUE KEY=VALUE" on top of the default configuration.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks import machine

if TYPE_CHECKING:
    from pfslam_viz.config import Config
    from pfslam_viz.evaluation.report import Method, Report
    from pfslam_viz.recordings.recording import Recording

BUILDINGS = ("office", "ring", "hallway")


@dataclass(frozen=True)
class Variant:
    """A configuration by name, or the default one when there is no name, with settings on top."""

    label: str
    settings: tuple[str, ...] = ()
    config: str | None = None

    @classmethod
    def parse(cls, text: str) -> "Variant":
        """A label of VARIANTS, or ``label: KEY=VALUE ...``."""
        for variant in VARIANTS:
            if variant.label == text:
                return variant
        label, colon, settings = text.partition(":")
        if colon:
            return cls(label.strip(), tuple(settings.split()))
        known = ", ".join(f"'{variant.label}'" for variant in VARIANTS)
        sys.exit(f"no variant is called '{text}'; there are {known}, or write 'label: KEY=VALUE ...'")

    def load(self) -> "Config":
        """The configuration, called by the variant's label."""
        from pfslam_viz.commands.choices import ConfigChoice

        return ConfigChoice(self.config, (*self.settings, f"name='{self.label}'")).load()


VARIANTS = (
    Variant("paper", config="paper"),
    Variant("paper, resampling under N/2", ("resampling.policy=n_eff",), "paper"),
    Variant("paper, noise scaled by motion too", ("resampling.policy=n_eff", "motion.model=scaled"), "paper"),
    Variant("default"),
    Variant("default, loops not closed", ("loop_closing.enabled=false",)),
    Variant("default, not smoothed", ("smoothing.enabled=false",)),
    Variant("default, not smoothed, one particle", ("smoothing.enabled=false", "particles=1")),
    Variant("default, one particle", ("particles=1",)),
    Variant(
        "default, a scan every 0.3 m or 0.2 rad",
        ("rao_blackwellized.update_distance=0.3", "rao_blackwellized.update_angle=0.2"),
    ),
    Variant("default, a miss weighs as much as a hit", ("map.log_odds_miss=0.9",)),
    Variant("default, 0.1 m cells", ("map.cell=0.1",)),
)

# Section and key of a score, its heading, its format. Those that no recording of a table has are left out.
COLUMNS = (
    ("truth", "position_rmse_m", "rmse m", ".3f"),
    ("truth", "position_max_m", "max m", ".3f"),
    ("truth", "heading_rmse_deg", "rmse °", ".2f"),
    ("relations", "translation_mean_m", "translation m", ".4f"),
    ("relations", "translation_std_m", "± m", ".4f"),
    ("relations", "rotation_mean_deg", "rotation °", ".3f"),
    ("map", "wall_thickness_m", "walls m", ".4f"),
    ("map", "revisit_error_m", "revisits m", ".3f"),
    ("speed", "times_real_time", "x real time", ".0f"),
)


def main(arguments: list[str]) -> None:
    """Print a table for every recording, each as soon as it is done."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks accuracy",
        description=(__doc__ or "").split("\n\n", 1)[0],
        epilog="variants: " + "; ".join(variant.label for variant in VARIANTS),
    )
    parser.add_argument("--recording", action="append", help="name, path, or BUILDING:SEED; repeatable (default: demo)")
    parser.add_argument("--data", type=Path, help="folder of recordings")
    parser.add_argument(
        "--variant", action="append", help="label, or 'label: KEY=VALUE ...'; repeatable (default: all)"
    )
    parser.add_argument("--seeds", type=int, default=2, help="seeds 0, 1, ... of every variant")
    parser.add_argument("--stop", type=int, help="scan to stop before")
    parser.add_argument("--scratch", type=Path, help="folder to keep simulated recordings in")
    given = parser.parse_args(arguments)
    variants = [Variant.parse(text) for text in given.variant] if given.variant else list(VARIANTS)
    for variant in variants:  # a mistake in one shows before the first long run
        _checked(variant)
    print(machine.describe().replace("\n", "  \n"))
    print(f"Mean [smallest, largest] over {given.seeds} seeds.\n", flush=True)
    with ExitStack() as stack:
        scratch = given.scratch or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        for name in given.recording or ["demo"]:
            recording = load(name, given.data, scratch).select(0, given.stop)
            print(table(run(recording, variants, range(given.seeds))), flush=True)


def load(name: str, data: Path | None, scratch: Path) -> "Recording":
    """A recording by name or path; BUILDING:SEED is simulated if it is not there yet."""
    from dataclasses import replace

    from pfslam_viz.errors import PfslamError
    from pfslam_viz.recordings.catalog import load_recording

    building, colon, seed = name.partition(":")
    try:
        if not colon or building not in BUILDINGS:
            return load_recording(name, data)
        from pfslam_viz.simulation.recording import simulate

        folder = scratch / f"{building}-{int(seed)}"
        if not folder.is_dir():
            simulate(folder, seed=int(seed), building=building, frames=False)
        return replace(load_recording(folder), name=name)
    except PfslamError as error:
        sys.exit(str(error))


def run(recording: "Recording", variants: Iterable[Variant], seeds: Sequence[int]) -> "Report":
    """Score every variant; progress goes to stderr."""
    from pfslam_viz.evaluation.evaluate import evaluate

    def show(what: str, done: int, total: int) -> None:
        if sys.stderr.isatty() and (done % 200 == 0 or done == total):
            print(f"\r{recording.name}: {what}, {done / total:.0%}\033[K", end="", file=sys.stderr, flush=True)

    report = evaluate(recording, [v.load() for v in variants], seeds, show, paper=False)
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr, flush=True)
    return report


def table(report: "Report") -> str:
    """A Markdown table: a row for dead reckoning and for every variant."""
    columns = [c for c in COLUMNS if any(method.over_seeds(c[0], c[1]) is not None for method in report.methods)]
    lines = [
        f"### {report.recording}: {report.scans:,} scans, {report.duration:.0f} s\n",
        "| | " + " | ".join(heading for _, _, heading, _ in columns) + " |",
        "| --- |" + " --- |" * len(columns),
    ]
    for method in report.methods:
        cells = [_cell(method, section, key, spec) for section, key, _, spec in columns]
        lines.append(f"| {method.name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(method: "Method", section: str, key: str, spec: str) -> str:
    spread = method.over_seeds(section, key)
    return "" if spread is None else format(spread, spec)


def _checked(variant: Variant) -> None:
    from pfslam_viz.errors import PfslamError

    try:
        variant.load()
    except PfslamError as error:
        sys.exit(f"variant '{variant.label}': {error}")


if __name__ == "__main__":
    main(sys.argv[1:])
