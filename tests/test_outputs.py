"""Nothing of anybody else's is overwritten, whatever it is called; our own outputs are."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pfslam_viz import outputs
from pfslam_viz.errors import InputError
from pfslam_viz.simulation.recording import check_replaceable, simulate

Run = Callable[..., tuple[int, str, str]]
PAPER = ["--config", "paper", "--particles", 10, "--stop", 40, "--quiet"]


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, hidden ones too."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("name", ["Hokuyo1.npz", "ground_truth.npz", "robot.toml", "simulation.json"])
def test_a_recording_does_not_replace_its_own_input(run: Run, drive: Path, name: str) -> None:
    before = contents(drive)
    status, out, err = run("replay", drive, "--save", drive / name, *PAPER)
    assert (status, out) == (2, "")
    assert name in err and "not overwritten" in err and err.count("\n") == 1
    assert contents(drive) == before


@pytest.mark.parametrize(
    "content",
    [b"thesis", b"\x89PNG\r\n\x1a\n", b"PK\x03\x04", b"RRF", b"RRF2\x00\x29\x00\x00 somebody's own application"],
    ids=["text", "picture", "zip", "magic alone", "another program's recording"],
)
@pytest.mark.parametrize("command", ["replay", "compare"])
def test_save_refuses_what_is_no_recording_of_ours(
    run: Run, drive: Path, tmp_path: Path, command: str, content: bytes
) -> None:
    path = tmp_path / "out.rrd"
    path.write_bytes(content)
    configs = ["--config", "paper", "--config", "paper,seed=1"] if command == "compare" else PAPER[:2]
    status, _, err = run(command, drive, "--save", path, *configs, *PAPER[2:])
    assert status == 2
    assert str(path) in err
    assert contents(tmp_path) == {"out.rrd": content}


def test_our_own_recording_and_an_empty_file_are_replaced(run: Run, drive: Path, tmp_path: Path) -> None:
    path = tmp_path / "named.like.nothing"
    path.touch()
    for _ in range(2):
        assert run("replay", drive, "--save", path, *PAPER)[0] == 0
        assert path.read_bytes()[:4] == b"RRF2"


def test_a_link_to_a_foreign_file_is_seen_through(run: Run, drive: Path, tmp_path: Path) -> None:
    (tmp_path / "data").write_text("precious")
    (tmp_path / "out.rrd").symlink_to(tmp_path / "data")
    assert run("replay", drive, "--save", tmp_path / "out.rrd", *PAPER)[0] == 2
    assert (tmp_path / "data").read_text() == "precious"


FOREIGN = {
    "estimate.tum": b"1.5 0.1 0.2 0.0 0.0 0.0 0.0 1.0\n",
    "truth.tum": b"# timestamp tx ty tz qx qy qz qw\n1.5 0.1 0.2 0 0 0 0 1\n",
    "map.pgm": b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n1 1\n255\n\xcd",
    "map.yaml": b"image: map.pgm\nresolution: 0.05\norigin: [-10, -10, 0]\nnegate: 0\n",
    "metrics.json": b'{"accuracy": 1.0}',
}


@pytest.mark.parametrize("name", FOREIGN)
def test_export_refuses_a_folder_where_a_file_of_others_is_in_the_way(
    run: Run, drive: Path, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).write_bytes(FOREIGN[name])
    (tmp_path / "notes.txt").write_text("in nobody's way")
    before = contents(tmp_path)
    status, _, err = run("replay", drive, "--export", tmp_path, *PAPER)
    assert (status, err.count("\n")) == (2, 1)
    assert str(tmp_path / name) in err
    assert contents(tmp_path) == before


def test_an_export_is_replaced_by_the_next_one_beside_other_files(run: Run, drive: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("in nobody's way")
    for seed in (0, 1):
        assert run("replay", drive, "--export", tmp_path, *PAPER, "--seed", seed)[0] == 0
        assert json.loads((tmp_path / "metrics.json").read_text())["seed"] == seed
    assert {p.name for p in tmp_path.iterdir()} == {"notes.txt", *outputs.EXPORTED}


@pytest.mark.parametrize(
    ("save", "export"), [("both", "both"), ("a", "a/b"), ("out/metrics.json", "out"), ("out/../out/map.pgm", "out/")]
)
def test_a_recording_and_an_export_in_one_place(run: Run, drive: Path, tmp_path: Path, save: str, export: str) -> None:
    status, _, err = run("replay", drive, "--save", tmp_path / save, "--export", tmp_path / export, *PAPER)
    assert (status, err.count("\n")) == (2, 1)
    assert "name them apart" in err
    assert not list(tmp_path.iterdir())


def test_figures_replace_figures_and_nothing_else(run: Run, drive: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    command = ["figures", drive, tmp_path, *PAPER, "--every", 20]
    assert run(*command)[0] == 0
    for picture in tmp_path.glob("*.png"):
        assert Image.open(picture).info["Software"] == "pfslam-viz"
    (tmp_path / "index.html").unlink()  # a run that was killed before its end
    assert run(*command)[0] == 0
    foreign = io.BytesIO()
    Image.new("RGB", (4, 4)).save(foreign, "PNG")
    (tmp_path / "04_map_00060.png").write_bytes(foreign.getvalue())
    before = contents(tmp_path)
    status, _, err = run(*command)
    assert status == 2
    assert "04_map_00060.png" in err
    assert contents(tmp_path) == before
    (tmp_path / "04_map_00060.png").unlink()
    (tmp_path / "index.html").write_text("<title>my home page</title>")
    assert run(*command)[0] == 2


def test_a_picture_with_our_mark_is_still_the_picture() -> None:
    pixels = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    plain = io.BytesIO()
    Image.fromarray(pixels).save(plain, "PNG")
    marked = outputs.marked_png(plain.getvalue())
    assert outputs.is_own_png(marked) and not outputs.is_own_png(plain.getvalue())
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(marked))), pixels)


@pytest.mark.parametrize(
    "name", ["table.md", "sweep.rrd", "results.parquet", "index.html", "curves-0.png", "results.csv"]
)
def test_a_sweep_refuses_a_folder_with_files_of_others_in_its_way(
    run: Run, drive: Path, tmp_path: Path, name: str
) -> None:
    pytest.importorskip("distributed")
    (tmp_path / name).write_text("a,b\n1,2\n")
    status, _, err = run("sweep", drive, "--config", "paper", "--out", tmp_path, "--quiet")
    assert status == 2
    assert name in err
    assert contents(tmp_path) == {name: b"a,b\n1,2\n"}


def test_a_sweeps_own_folder_is_gone_on_with(tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text("recording,config,seed,cell,code,error\n")
    (tmp_path / "table.md").write_text("of the last time")
    outputs.check_sweep(tmp_path)


@pytest.mark.parametrize("manifest", ["{}", '{"world": "gazebo"}', "not json"])
def test_a_folder_with_some_simulation_json_is_not_taken_for_a_simulated_recording(
    run: Run, tmp_path: Path, manifest: str
) -> None:
    (tmp_path / "simulation.json").write_text(manifest)
    (tmp_path / "world.sdf").write_text("mine")
    before = contents(tmp_path)
    assert run("simulate", tmp_path, "--no-frames", "--duration", 5)[0] == 2
    assert contents(tmp_path) == before


def test_a_users_file_in_a_simulated_recording_keeps_it_from_being_replaced(tmp_path: Path) -> None:
    out = simulate(tmp_path / "drive", duration=5, frames=False)
    check_replaceable(out)
    (out / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt"):
        simulate(out, duration=5, frames=False)
    assert (out / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("ending", [".png", ".gif", ".webp", ".webm", ".mp4"])
def test_a_film_replaces_films_of_its_kind_alone(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"out{ending}"
    path.write_bytes(b"RRF2 the recording itself, by a wrong name")
    with pytest.raises(InputError, match="not overwritten"):
        outputs.check_film(path)
    heads = {
        ".png": b"\x89PNG\r\n\x1a\n", ".gif": b"GIF89a", ".webp": b"RIFF\0\0\0\0WEBP", ".webm": b"\x1a\x45\xdf\xa3",
        ".mp4": b"\0\0\0\x20ftypisom",
    }  # fmt: skip
    path.write_bytes(heads[ending])
    outputs.check_film(path)


def test_a_folder_that_is_made_for_the_file_is_told(run: Run, drive: Path, tmp_path: Path) -> None:
    options = [option for option in PAPER if option != "--quiet"]
    _, _, err = run("replay", drive, "--save", tmp_path / "resluts" / "out.rrd", *options)
    assert f"note: {tmp_path / 'resluts'} is not there and will be made\n" in err
    assert "will be made" not in run("replay", drive, "--save", tmp_path / "resluts" / "out.rrd", *options)[2]
