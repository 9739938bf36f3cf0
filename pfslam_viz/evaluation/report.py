"""What an evaluation found: per run, over the seeds, as a table and as JSON."""

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import fmean
from typing import TYPE_CHECKING, Any

from pfslam_viz.config import Config
from pfslam_viz.evaluation.metrics import versions

if TYPE_CHECKING:
    from rich.console import RenderableType

Scores = dict[str, dict[str, Any]]

# What the table shows: section, key, label, format. JSON has everything.
ROWS = (
    ("truth", "position_rmse_m", "position rmse (m)", ".3f"),
    ("truth", "position_max_m", "position max (m)", ".3f"),
    ("truth", "position_final_m", "position at the end (m)", ".3f"),
    ("truth", "heading_rmse_deg", "heading rmse (°)", ".2f"),
    ("truth", "heading_max_deg", "heading max (°)", ".2f"),
    ("relations", "translation_mean_m", "|translation| mean (m)", ".4f"),
    ("relations", "translation_std_m", "|translation| std (m)", ".4f"),
    ("relations", "rotation_mean_deg", "|rotation| mean (°)", ".3f"),
    ("relations", "rotation_std_deg", "|rotation| std (°)", ".3f"),
    ("relations", "translation_squared_mean_m2", "translation² mean (m²)", ".5f"),
    ("relations", "translation_squared_std_m2", "translation² std (m²)", ".5f"),
    ("relations", "rotation_squared_mean_deg2", "rotation² mean (°²)", ".3f"),
    ("relations", "rotation_squared_std_deg2", "rotation² std (°²)", ".3f"),
    ("relations", "matched", "relations used", ".0f"),
    ("relations", "unmatched", "relations without a scan", ".0f"),
    ("map", "end_to_start_gap_m", "end-to-start gap (m)", ".3f"),
    ("map", "path_ratio", "path ÷ wheel path", ".4f"),
    ("map", "occupied_area_m2", "occupied area (m²)", ".1f"),
    ("map", "wall_thickness_m", "wall thickness (m)", ".4f"),
    ("map", "scan_to_map_score", "scan-to-map score", ".3f"),
    ("map", "revisit_error_m", "revisit error (m)", ".3f"),
    ("map", "revisit_rotation_deg", "revisit error (°)", ".2f"),
    ("map", "revisits", "revisits matched", ".0f"),
    ("map", "resamplings", "resamplings", ".0f"),
    ("speed", "total_s", "time (s)", ".1f"),
    ("speed", "ms_per_scan", "time a scan (ms)", ".2f"),
    ("speed", "times_real_time", "times real time", ".0f"),
)
SECTIONS = {"truth": "against truth", "relations": "against relations", "map": "without truth", "speed": "time"}
PER_SEED = (  # columns of the table of single runs, where known
    ("truth", "position_rmse_m", "rmse (m)", ".3f"),
    ("truth", "position_max_m", "max (m)", ".3f"),
    ("truth", "heading_rmse_deg", "rmse (°)", ".2f"),
    ("relations", "translation_mean_m", "|t| (m)", ".4f"),
    ("relations", "translation_std_m", "± (m)", ".4f"),
    ("relations", "rotation_mean_deg", "|r| (°)", ".3f"),
    ("map", "end_to_start_gap_m", "gap (m)", ".3f"),
    ("map", "wall_thickness_m", "walls (m)", ".4f"),
    ("speed", "times_real_time", "x real time", ".0f"),
)


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean, smallest and largest over seeds."""

    mean: float
    min: float
    max: float

    def __format__(self, spec: str) -> str:
        if self.min == self.max:
            return format(self.mean, spec)
        return f"{self.mean:{spec}} [{self.min:{spec}}, {self.max:{spec}}]"


@dataclass(frozen=True, slots=True)
class Run:
    """One seed's scores: section, then key, then number. ``seed`` is None where nothing is random."""

    seed: int | None
    scores: Scores


@dataclass(frozen=True, slots=True)
class Method:
    """All runs of one configuration; of dead reckoning when ``config`` is None."""

    name: str
    config: Config | None
    runs: tuple[Run, ...]

    def over_seeds(self, section: str, key: str) -> Spread | None:
        """Spread of one score over the runs that have it."""
        values = [run.scores.get(section, {}).get(key) for run in self.runs]
        known = [float(value) for value in values if value is not None]
        return Spread(fmean(known), min(known), max(known)) if known else None


@dataclass(frozen=True, slots=True)
class Report:
    """An evaluation of one recording: dead reckoning first, then the configurations as asked."""

    recording: str
    format: str
    scans: int
    duration: float
    methods: tuple[Method, ...]

    def as_dict(self) -> dict[str, Any]:
        """JSON-able: per seed, and over seeds as mean, min and max."""
        return {
            "recording": self.recording,
            "format": self.format,
            "scans": self.scans,
            "duration_s": self.duration,
            "versions": versions(),
            "methods": [
                {
                    "name": method.name,
                    "config": method.config.model_dump(mode="json") if method.config else None,
                    "runs": [{"seed": run.seed, **run.scores} for run in method.runs],
                    "over_seeds": self._over_seeds(method),
                }
                for method in self.methods
            ],
        }

    def table(self) -> "RenderableType":
        """For the terminal: a column for each method, mean [smallest, largest] over the seeds; then every run."""
        from rich.console import Group
        from rich.markup import escape
        from rich.table import Table

        seeds = max((len(method.runs) for method in self.methods), default=0)
        title = f"{escape(self.recording)}: {self.scans} scans, {self.duration:.0f} s, {seeds} seed{'s' * (seeds != 1)}"
        summary = Table(title=title, caption=escape("mean [smallest, largest] over the seeds") if seeds > 1 else None)
        summary.add_column("")
        for method in self.methods:
            summary.add_column(escape(method.name), justify="right")
        section = ""
        for name, key, label, spec in ROWS:
            cells = [method.over_seeds(name, key) for method in self.methods]
            if all(cell is None for cell in cells):
                continue
            if name != section:
                summary.add_section()
                summary.add_row(SECTIONS[name], style="bold")
                section = name
            summary.add_row(label, *("" if cell is None else format(cell, spec) for cell in cells))
        if seeds < 2:
            return summary
        return Group(summary, "", self._runs())

    def _runs(self) -> "RenderableType":
        from rich.markup import escape
        from rich.table import Table

        shown = [column for column in PER_SEED if any(m.over_seeds(column[0], column[1]) for m in self.methods)]
        table = Table(title="every run")
        table.add_column("")
        table.add_column("seed", justify="right")
        for _, _, label, _ in shown:
            table.add_column(label, justify="right")
        for method in self.methods:
            for run in method.runs:
                values = [(run.scores.get(name, {}).get(key), spec) for name, key, _, spec in shown]
                seed = "" if run.seed is None else str(run.seed)
                table.add_row(escape(method.name), seed, *("" if v is None else format(v, spec) for v, spec in values))
            table.add_section()
        return table

    def _over_seeds(self, method: Method) -> dict[str, dict[str, dict[str, float]]]:
        out: dict[str, dict[str, dict[str, float]]] = {}
        for name, key in _keys(method):
            spread = method.over_seeds(name, key)
            if spread is not None:
                out.setdefault(name, {})[key] = {"mean": spread.mean, "min": spread.min, "max": spread.max}
        return out


def _keys(method: Method) -> Iterator[tuple[str, str]]:
    """Every section and key that any run has, each once, in order."""
    yield from dict.fromkeys((name, key) for run in method.runs for name, part in run.scores.items() for key in part)
