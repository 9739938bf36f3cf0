"""``pfslam-viz config``: print every setting of a configuration."""

from pfslam_viz.config import load_config
from pfslam_viz.config_text import as_markdown, as_toml
from pfslam_viz.streams import write_result


def run(name: str, settings: tuple[str, ...], markdown: bool) -> None:
    """Print a configuration as TOML, or the reference of all settings as Markdown."""
    write_result(as_markdown() if markdown else as_toml(load_config(name, settings)))
