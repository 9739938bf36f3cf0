"""The same recording and seed give the same bytes, with any number of threads, whoever watches."""

from pathlib import Path

import pytest

import pfslam_viz as pf

pytest.importorskip("benchmarks", reason="needs the checkout on the path: run python -m pytest in its folder")

from benchmarks.digest import CONFIGS, of_run, short_drive


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> pf.Recording:
    return short_drive(tmp_path_factory.mktemp("drive") / "drive", seconds=10.0)


@pytest.mark.parametrize("config", CONFIGS)
def test_bit_for_bit(drive: pf.Recording, config: str, tmp_path: Path) -> None:
    alone = of_run(drive, config, 1)
    assert of_run(drive, config, 2) == alone
    assert of_run(drive, config, 4) == alone
    assert of_run(drive, config, 2, save=tmp_path / "run.rrd") == alone
    assert of_run(drive, config, 2, serve=True, hold=lambda: None, on_message=lambda message: None) == alone
    assert of_run(drive.select(0, len(drive) - 1), config, 2) != alone  # the digest tells one scan more or less


def test_the_same_seed_simulates_the_same_drive(drive: pf.Recording, tmp_path: Path) -> None:
    again = short_drive(tmp_path / "again", seconds=10.0)
    for name in ("stamps", "ranges", "odometry"):
        assert getattr(again, name).tobytes() == getattr(drive, name).tobytes()
