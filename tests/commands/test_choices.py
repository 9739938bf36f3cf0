from pathlib import Path

import pytest

from pfslam_viz.commands.choices import SinkChoice
from pfslam_viz.errors import InputError


@pytest.mark.parametrize("name", ["x.mp4", "x.GIF", "x.png"])
def test_a_film_is_no_recording(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"no film or picture: pass --save .*x\.rrd"):
        SinkChoice(save=tmp_path / name).check()
    assert not list(tmp_path.iterdir())


def test_a_recording_is_written_under_any_other_name(tmp_path: Path) -> None:
    SinkChoice(save=tmp_path / "x.rrd").check()
    SinkChoice(save=tmp_path / "x").check()
