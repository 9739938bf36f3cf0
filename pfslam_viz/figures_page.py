"""index.html: the figures of a recording on one page."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from pathlib import Path

from pfslam_viz.evaluation.metrics import metrics
from pfslam_viz.files import replaced
from pfslam_viz.replay import Result

SECTIONS = {
    "1, 2": "Dead reckoning",
    "3, 4": "Particle filter",
    "5, 6": "Texture map",
    "7 to 15": "Trajectory and occupancy grid over time",
    "16 to 24": "Texture map over time",
}

STYLE = """
:root { color-scheme: light dark; --edge: #d0d7de; --faint: #59636e; }
@media (prefers-color-scheme: dark) { :root { --edge: #3d444d; --faint: #9198a1; } }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1400px; margin: 2rem auto; padding: 0 1.5rem; }
h1 { margin-bottom: .25rem; }
h2 { margin: 2.5rem 0 .75rem; border-bottom: 1px solid var(--edge); padding-bottom: .25rem; }
h2 small, p.about, figcaption { color: var(--faint); font-weight: normal; }
h2 small { font-size: .9rem; margin-left: .5rem; }
dl { display: grid; grid-template-columns: max-content auto; gap: .1rem 1rem; margin: 1rem 0; }
dt { color: var(--faint); } dd { margin: 0; }
.many { display: grid; grid-template-columns: repeat(auto-fit, minmax(420px, 1fr)); gap: 1.25rem; }
figure { margin: 0; }
img { width: 100%; height: auto; border: 1px solid var(--edge); border-radius: 6px; background: #fff; }
.one img { max-width: 1000px; }
"""


@dataclass(frozen=True, slots=True)
class Figure:
    """One picture: its file, the numbers of the paper's figures that it is like, and what to write under it."""

    path: Path
    like: str
    caption: str


def write_page(path: Path, result: Result, figures: Sequence[Figure]) -> Path:
    """Write the page that shows ``figures``, which lie beside it, in the order given."""
    name = escape(result.recording.name)
    sections = "\n".join(_section(like, list(group)) for like, group in groupby(figures, lambda f: f.like))
    painted = any(figure.like == "5, 6" for figure in figures)
    without = "" if painted else "<p class='about'>This replay painted no floor, so there are no texture maps.</p>\n"
    text = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{name}: particle-filter SLAM</title>
<style>{STYLE}</style>
</head>
<body>
<h1>{name}</h1>
<p class="about">The figures of &ldquo;Particle Filter SLAM&rdquo;, made from this recording, in the paper's order.</p>
{_facts(result)}
{without}{sections}
</body>
</html>
"""
    with replaced(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _section(like: str, figures: list[Figure]) -> str:
    shown = "\n".join(_figure(figure) for figure in figures)
    heading = f"{SECTIONS[like]} <small>the paper's figures {like.replace(', ', ' and ')}</small>"
    return f'<h2>{heading}</h2>\n<div class="{"many" if len(figures) > 1 else "one"}">\n{shown}\n</div>'


def _figure(figure: Figure) -> str:
    source, caption = escape(figure.path.name), escape(figure.caption)
    return (
        f'<figure><a href="{source}"><img src="{source}" alt="{caption}" loading="lazy"></a>'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _facts(result: Result) -> str:
    """The run's main numbers, the filter's beside dead reckoning's."""
    m = metrics(result)
    config = result.config
    path, gap = m["path_length_m"], m["end_to_start_gap_m"]
    facts = [
        ("Recording", f"{len(result.stamps):,} scans, {result.stamps[-1] - result.stamps[0]:.1f} s"),
        (
            "Configuration",
            f"{config.name}: {config.particles} particles, {config.map.cell:g} m cells, seed {config.seed}",
        ),
        ("Path length", f"{path['estimate']:.2f} m; dead reckoning {path['dead_reckoning']:.2f} m"),
        ("End-to-start gap", f"{gap['estimate']:.2f} m; dead reckoning {gap['dead_reckoning']:.2f} m"),
    ]
    if m["truth"]:
        rmse = {name: scores["position_rmse_m"] for name, scores in m["truth"].items()}
        facts.append(
            ("Error against truth", f"{rmse['estimate']:.3f} m rmse; dead reckoning {rmse['dead_reckoning']:.3f} m")
        )
    if m["relations"]:
        mean = {name: scores["translation_mean_m"] for name, scores in m["relations"].items()}
        facts.append(
            ("Error of relations", f"{mean['estimate']:.3f} m mean; dead reckoning {mean['dead_reckoning']:.3f} m")
        )
    return "<dl>" + "".join(f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in facts) + "</dl>"
