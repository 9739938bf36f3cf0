"""A short drive and a sweep of twelve cells over it."""

from pathlib import Path

import pytest

from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.simulation.recording import simulate
from pfslam_viz.sweep.plan import Block, Plan, make_plan
from pfslam_viz.sweep.worker import content


@pytest.fixture(scope="session")
def sweep_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated recording of 6 s, without frames."""
    out = tmp_path_factory.mktemp("recordings") / "drive"
    simulate(out, seed=0, duration=6.0, frames=False)
    return out


@pytest.fixture(scope="session")
def sweep_recording(sweep_drive: Path) -> Recording:
    return content(RecordingChoice(str(sweep_drive)).load())


@pytest.fixture
def twelve(sweep_drive: Path) -> Plan:
    """One recording, two numbers of particles, two policies, three seeds."""
    block = Block(("paper",), (("particles", ("20", "60")), ("resampling.policy", ("always", "n_eff"))))
    return make_plan([("drive", RecordingChoice(str(sweep_drive)))], [block], range(3))
