import re
from typing import TYPE_CHECKING

from pfslam_viz.viewer.pages import about_page, help_page

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor


def test_the_help_page_names_what_was_logged_and_nothing_else() -> None:
    page = help_page(["filter"], {"world/filter/map", "plots/n_eff/filter", "world/truth/robot"})
    assert re.findall(r"\| `/(.*?)` \|", page) == ["world/filter/map", "world/truth/robot", "plots/n_eff/filter"]


def test_several_runs_are_told_by_colour() -> None:
    page = help_page(["paper", "mine"], None)
    assert "paper blue, mine amber" in page
    assert "| `/world/mine/robot` | amber arrow" in page


def test_the_about_page_tells_recording_configuration_and_versions(corridor: "Corridor") -> None:
    import rerun

    page = about_page(corridor.recording, [corridor.config], ["maps: 3 of 60"])
    assert "| scans | 60 of 91 beams |" in page
    assert "| particles | 40 |" in page
    assert "| resampling.policy | n_eff |" in page
    assert "- maps: 3 of 60" in page
    assert f"rerun {rerun.__version__}" in page
