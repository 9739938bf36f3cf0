import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pfslam_viz import geometry
from pfslam_viz.slam.protocol import Kept
from pfslam_viz.viewer.colors import RUNS
from pfslam_viz.viewer.pages import about_page, filter_legend_page, help_page, legend_page

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor


def test_the_help_page_names_what_was_logged_and_nothing_else() -> None:
    page = help_page({"filter": RUNS[0]}, {"world/filter/map", "plots/n_eff/filter", "world/truth/robot"})
    assert re.findall(r"- `/(.*?)`: ", page) == ["world/filter/map", "world/truth/robot", "plots/n_eff/filter"]


def test_several_runs_are_told_by_colour() -> None:
    page = help_page({"paper": RUNS[1], "mine": RUNS[0]}, None)
    assert "paper amber, mine blue" in page
    assert "- `/world/mine/robot`: blue arrow" in page


def test_the_about_page_tells_recording_configuration_and_versions(corridor: "Corridor") -> None:
    import rerun

    page = about_page(corridor.recording, [corridor.config], ["maps: 3 of 60"])
    assert "| scans | 60 of 91 beams |" in page
    assert "| particles | 40 |" in page
    assert "| resampling.policy | n_eff |" in page
    assert "- maps: 3 of 60" in page
    assert f"rerun {rerun.__version__}" in page


def test_the_about_page_tells_what_came_of_the_run(corridor: "Corridor") -> None:
    result = replace(corridor.result(list(corridor.steps())), kept=Kept("settled", 0.02, 5.24, (20, 31)))
    assert result.truth is not None
    page = about_page(corridor.recording, [corridor.config], (), {"filter": result})
    moved = [
        np.hypot(*(geometry.between(poses[0], poses) - geometry.between(result.truth[0], result.truth))[:, :2].T)
        for poses in (result.estimate, result.online, result.dead_reckoning)
    ]  # paths are compared from where they start
    ours, online, reckoned = (np.sqrt(np.mean(apart**2)) for apart in moved)
    rows = {line.split("|")[1].strip(): line.split("|")[2:-1] for line in page.splitlines() if line.count("|") == 4}
    assert f"{ours:.3f} m" in rows["error, rmse"][0] and f"{reckoned:.3f} m" in rows["error, rmse"][1]
    assert f"{online:.3f} m" in rows["error on the way, rmse"][0]
    gap = np.hypot(*(result.estimate[-1] - result.estimate[0])[:2])
    assert f"{gap:.2f} m" in rows["end-to-start gap"][0]
    assert "after 15 scans" in rows["resampled"][0] and rows["loops closed"][0].strip() == "1"
    assert rows["kept"][0].strip() == "settled trajectory (+5.2 sigmas)"
    assert rows["against odometry that is right elsewhere"][0].strip() == "at 2 of the key scans"
    assert "## Result" not in about_page(corridor.recording, [corridor.config])


def test_the_legend_names_the_colours_that_are_there(corridor: "Corridor") -> None:
    alone = legend_page({"filter": RUNS[0]}, corridor.recording)
    assert "- blue: the filter" in alone and "- thin green: the truth" in alone and "- violet, last step" in alone
    two = legend_page({"default": RUNS[0], "paper": RUNS[1]}, replace(corridor.recording, truth=None))
    assert "- blue: default\n- amber: paper" in two and "green: the" not in two
    assert filter_legend_page({"default": RUNS[0], "paper": RUNS[1]}).startswith("- blue: default\n- amber: paper\n")
    assert filter_legend_page({"filter": RUNS[1]}).startswith("- amber: the filter\n")
