"""Fixtures that every test module may use."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pfslam_viz import cli, geometry
from pfslam_viz.simulation.floor import floor_color
from pfslam_viz.simulation.world import World

SHARED_DATA = Path(__file__).resolve().parents[1].parent / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    """Compile the kernels before several processes run tests: numba's cache is not made for two that write at once."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        code = "from pfslam_viz import cli; sys.exit(cli.call(['compile', '--quiet']))"
        subprocess.run([sys.executable, "-c", f"import sys; {code}"], check=True)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real and twin recordings that lies beside the checkout; skips where there is none."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"needs the recordings in {SHARED_DATA}")
    return SHARED_DATA


@pytest.fixture(scope="session")
def floor_colors() -> Callable[[World, NDArray[np.float64]], NDArray[np.float64]]:
    """True colours (n, 3), RGB in 0..255, of a simulated floor at points (n, 2) of the world."""

    def at(world: World, points: NDArray[np.float64]) -> NDArray[np.float64]:
        on_plan = geometry.transform(geometry.inverse(world.plan), points)
        return np.floor([floor_color(x, y, world.zones, world.floors) for x, y in on_plan])

    return at


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Call the command line in this process: exit status, stdout, stderr."""

    def call(*arguments: object) -> tuple[int, str, str]:
        capfd.readouterr()
        status = cli.call([str(argument) for argument in arguments])
        return status, *capfd.readouterr()

    return call


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    """No viewer can open on this machine."""
    monkeypatch.setattr("pfslam_viz.commands.choices.has_screen", lambda: False)


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated recording of 6 s, without frames."""
    out = tmp_path_factory.mktemp("recordings") / "drive"
    assert cli.call(["simulate", str(out), "--duration", "6", "--no-frames"]) == 0
    return out
