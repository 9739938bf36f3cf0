"""index.html of a sweep: its table and plots, recording by recording."""

from collections.abc import Sequence
from html import escape
from importlib.util import find_spec
from pathlib import Path

from pfslam_viz.errors import InputError
from pfslam_viz.figures_page import STYLE
from pfslam_viz.files import replaced
from pfslam_viz.sweep.curves import panels
from pfslam_viz.sweep.extremes import Extreme
from pfslam_viz.sweep.plan import Plan
from pfslam_viz.sweep.summary import BEST, SAME_MEANS, Ranking, cells_of, overview

TABLE_STYLE = """
table { border-collapse: collapse; margin: 1rem 0; font-size: .9rem; }
td, th { padding: .2rem .7rem; border-bottom: 1px solid var(--edge); text-align: left; white-space: nowrap; }
div.wide { overflow-x: auto; }
"""


def require_matplotlib() -> None:
    """Raise InputError, with what to do, where matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise InputError("index.html needs matplotlib, which is missing: pip install 'pfslam-viz[figures]'")


def write_page(folder: Path, plan: Plan, found: Sequence[Ranking], extremes: Sequence[Sequence[Extreme]]) -> Path:
    """Write the page and its pictures into the folder; ``extremes`` has those of each ranking."""
    require_matplotlib()
    from pfslam_viz.sweep.plots import draw_maps, draw_overview, draw_panels

    sections = []
    if len(found) > 1:
        measured = [(r.recording, r.by, shown) for r in found if (shown := panels(plan, r))]
        if measured:
            draw_overview(folder / "curves.png", measured)
        sections.append(_overview(plan, found, bool(measured)))
    for k, (ranking, ends) in enumerate(zip(found, extremes, strict=True)):
        pictures = []
        if shown := panels(plan, ranking):
            draw_panels(folder / f"curves-{k}.png", ranking.recording, ranking.by, shown)
            pictures.append((f"curves-{k}.png", f"{ranking.by}: a point a run, a line through the medians"))
        if ends:
            draw_maps(folder / f"maps-{k}.png", ranking.recording, [(end.title, end.trace) for end in ends])
            pictures.append((f"maps-{k}.png", "the best and the worst run"))
        sections.append(_section(plan, ranking, pictures))
    text = f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Sweep: {escape(plan.in_words)}</title>
<style>{STYLE}{TABLE_STYLE}</style>
</head>
<body>
<h1>Sweep</h1>
<p class="about">{escape(plan.in_words)}. Every run is a row of <a href="results.csv">results.csv</a>;
<code>rerun sweep.rrd</code> shows the runs in the viewer.</p>
{"".join(sections)}
</body>
</html>
"""
    path = folder / "index.html"
    with replaced(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


def _overview(plan: Plan, found: Sequence[Ranking], drawn: bool) -> str:
    note = f"<p class='about'>{BEST}: the best. {escape(SAME_MEANS)}</p>"
    figure = _figure("curves.png", "a point a run, a line through the medians") if drawn else ""
    return f"<h2>All recordings</h2>\n{_table(*overview(plan, found))}{note}\n{figure}\n"


def _figure(source: str, caption: str) -> str:
    return (
        f'<figure><a href="{source}"><img src="{source}" alt="{escape(caption)}" loading="lazy"></a>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _table(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    rows = "\n".join("<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in body)
    titles = "".join(f"<th>{escape(name)}</th>" for name in head)
    return f'<div class="wide"><table><tr>{titles}</tr>\n{rows}</table></div>'


def _section(plan: Plan, ranking: Ranking, pictures: Sequence[tuple[str, str]]) -> str:
    note = f"<p class='about'>{escape(SAME_MEANS)}</p>" if any(line.same for line in ranking.lines) else ""
    figures = "\n".join(_figure(source, caption) for source, caption in pictures)
    return (
        f"<h2>{escape(ranking.recording)} <small>best first by {escape(ranking.by)}</small></h2>\n"
        f"{_table(*cells_of(plan, ranking))}{note}\n{figures}\n"
    )
