import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from pfslam_viz.config import Config
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.replay import Result
from pfslam_viz.step import Step
from pfslam_viz.viewer import compare as module
from pfslam_viz.viewer.compare import compare, run_names
from pfslam_viz.viewer.sinks import open_sinks

if TYPE_CHECKING:
    from tests.viewer.conftest import Corridor, Readable


def config(name: str) -> Config:
    return Config(name=name, particles=40)


def test_runs_get_distinct_names_fit_for_paths() -> None:
    names = run_names([config("paper"), config("paper"), config("default,particles=50"), config("truth"), config("/")])
    assert names == ["paper", "paper_2", "default_particles_50", "truth_run", "run"]


@pytest.fixture
def replays(corridor: "Corridor", monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Replay, but it yields the corridor's made-up Steps."""
    made: list[Any] = []

    class Replay:
        def __init__(self, recording: Recording, config: Config) -> None:
            self.config = config
            self.steps: list[Step] = []
            made.append(self)

        def __iter__(self) -> Iterator[Step]:
            for step in corridor.steps():
                self.steps.append(step)
                yield step

        def result(self) -> Result:
            return corridor.result(self.steps)

    monkeypatch.setattr(module, "Replay", Replay)
    return made


def test_two_runs_share_a_file(
    corridor: "Corridor", replays: list[Any], read_back: "type[Readable]", tmp_path: Path
) -> None:
    path, seen = tmp_path / "cmp.rrd", []
    with open_sinks(save=path) as sink:
        on_step = lambda name, step: seen.append((name, step.index))  # noqa: E731
        results = compare(corridor.recording, [config("a"), config("b")], sink, on_step=on_step)
    n = len(corridor.recording)
    assert seen == [(name, k) for k in range(n) for name in ("a", "b")]  # side by side
    assert [len(result.stamps) for result in results] == [n, n]
    file = read_back(path)
    assert "1 file verified" in file.verify()
    for entity in ("world/a/particles", "world/b/particles", "plots/n_eff/a", "plots/n_eff/b", "plots/error/b"):
        assert len(file.temporal(entity)) == n, entity
    assert len(file.rows("world/dead_reckoning/robot")) == n  # once, not once a run
    named = re.findall(r"- `/(.*?)`: ", file.static("help", "text")[0])
    assert {"world/a/map", "world/b/map"} < set(named)
    colors = [file.static(f"plots/n_eff/{run}", "colors")[0] for run in ("a", "b")]
    assert colors[0] != colors[1]


def test_runs_are_comparable_at_a_glance(
    corridor: "Corridor", replays: list[Any], read_back: "type[Readable]", tmp_path: Path
) -> None:
    """N_eff as a share of the particles, close-ups beside each other, and each configuration in its own colour."""
    with open_sinks(save=tmp_path / "cmp.rrd") as sink:
        compare(corridor.recording, [config("paper"), config("b"), config("default")], sink)
    file = read_back(tmp_path / "cmp.rrd")
    share = [1 / (s.estimate.weights**2).sum() / len(s.estimate.weights) for s in replays[1].steps]
    assert [row["scalars"][0] for row in file.temporal("plots/n_eff/b")] == pytest.approx(share)
    assert not file.temporal("plots/n_eff/b/resampled")  # after every scan: marks would say nothing
    colors = {name: file.static(f"plots/n_eff/{name}", "colors")[0] >> 8 for name in ("paper", "b", "default")}
    assert colors["default"] == 0x006EDC and colors["paper"] == 0xEBAC00 and len(set(colors.values())) == 3
    names = [view.name for view in file.views()]
    assert {f"{name}: the robot (9 m)" for name in colors} < set(names)
    (n_eff,) = {view.name for view in file.views() if "plots/n_eff/b" in view.contents}
    assert n_eff == "N_eff, share of N"
    events = {view.name: view.contents for view in file.views() if view.kind == "TextLog"}
    assert events == {f"Events: {name}": {f"events/{name}"} for name in colors}  # a list for each
    assert {f"Floor: {name}" for name in colors} | set(colors) < set(names)  # 3-D has the run's name alone
    (by_error,) = (view.contents for view in file.views() if view.name == "b by error")
    assert {"world/b/error/done", "world/b/error/open", "world/error_scale", "world/error_scale/limits"} < by_error
    about = file.static("about", "text")[0]
    assert "| | paper | b | default | dead reckoning |" in about


def test_it_stops_between_scans(
    corridor: "Corridor", replays: list[Any], read_back: "type[Readable]", tmp_path: Path
) -> None:
    with open_sinks(save=tmp_path / "cmp.rrd") as sink:
        stopped = iter([False] * 5 + [True])
        results = compare(corridor.recording, [config("a"), config("b")], sink, stopped=lambda: next(stopped))
    assert [len(result.stamps) for result in results] == [5, 5]
    rows = read_back(tmp_path / "cmp.rrd").temporal("world/b/robot")
    np.testing.assert_allclose(rows[4]["translation"][0][:2], replays[1].steps[4].estimate.best[:2], atol=1e-6)


def test_more_runs_than_colours_are_refused(corridor: "Corridor", tmp_path: Path) -> None:
    with pytest.raises(InputError, match="at most"), open_sinks(save=tmp_path / "x.rrd") as sink:
        compare(corridor.recording, [config(str(k)) for k in range(9)], sink)
