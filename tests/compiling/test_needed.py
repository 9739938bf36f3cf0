"""What is said to be needed is what runs call: nothing is compiled in a run."""

import subprocess
import sys
from pathlib import Path

import pytest

from pfslam_viz.compiling.needed import every, needed
from pfslam_viz.config import load_config
from pfslam_viz.simulation.recording import simulate

CODE = """
import sys
from pfslam_viz import cli
from pfslam_viz.compiling.kernel import SIGNATURES, types_of
from pfslam_viz.compiling.needed import needed
from pfslam_viz.config import load_config

recording, name, out = sys.argv[1:]
assert cli.call(["replay", recording, "--save", out, "--config", name, "--quiet"]) == 0
wanted = needed([load_config(name)], viewer=True, texture=True)
for module, kernels in SIGNATURES.items():
    for compiled, signature in kernels:
        kernel = f"{module.removeprefix('pfslam_viz.')}.{compiled.py_func.__name__}"
        for found in compiled.signatures:
            if kernel not in (*wanted.first, *wanted.later) or found != types_of(compiled, signature):
                print(kernel, found)
"""


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten seconds of a ring with a camera."""
    return simulate(tmp_path_factory.mktemp("needed") / "drive", seed=3, duration=10.0, building="ring")


@pytest.mark.parametrize("name", ["paper", "default"])
def test_a_run_compiles_nothing_that_was_not_said_to_be_needed(drive: Path, tmp_path: Path, name: str) -> None:
    """Nor loads it. In an interpreter of its own, where no other test has called a kernel.

    The kernels that these call are compiled along with them, so that only a run that finds them kept can tell.
    """
    compiling = "from pfslam_viz.compiling.compile import compile_all; compile_all(needed([load_config(name)], "
    filled = CODE.partition("assert cli")[0] + compiling + "viewer=True, texture=True))"
    for code in (filled, CODE):
        found = subprocess.run(
            [sys.executable, "-c", code, str(drive), name, str(tmp_path / "out.rrd")],
            capture_output=True, text=True, check=True,
        )  # fmt: skip
    assert found.stdout == ""


def test_who_draws_nothing_and_paints_nothing_needs_less() -> None:
    paper = load_config("paper")
    plain, drawn, painted = needed([paper]), needed([paper], viewer=True), needed([paper], texture=True)
    assert not any(name.startswith(("viewer", "texture", "simulation")) for name in plain.first)
    assert {name.split(".")[0] for name in set(drawn.first) - set(plain.first)} == {"viewer", "slam"}
    assert {name.split(".")[0] for name in set(painted.first) - set(plain.first)} == {"texture"}
    assert needed([load_config("paper", ["texture.enabled=false"])], texture=True) == plain


def test_several_configurations_need_what_each_does() -> None:
    paper, default = load_config("paper"), load_config("default")
    both = needed([paper, default])
    assert set(both.first) == set(needed([paper]).first) | set(needed([default]).first)
    assert both.later == needed([default]).later and needed([paper]).later == ()
    assert set(every().first) >= {*both.first, *both.later}
    assert len(both.first) == len(set(both.first))
