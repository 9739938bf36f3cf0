"""What a sweep runs, from values and from a file."""

from pathlib import Path

import pytest

from pfslam_viz.config import configs_dir
from pfslam_viz.errors import InputError
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.slam.paper.settings import PaperConfig
from pfslam_viz.sweep.plan import Block, Plan, make_plan, parse_values
from pfslam_viz.sweep.plan_file import read_plan_file

PLACES = [("a", RecordingChoice("/a")), ("b", RecordingChoice("/b"))]


def plan(*blocks: Block, seeds: int = 2) -> Plan:
    return make_plan(PLACES, blocks, range(seeds))


def test_every_combination_once() -> None:
    values = (("particles", ("10", "20", "30")), ("resampling.policy", ("always", "n_eff")))
    found = plan(Block(("paper",), values))
    cells = found.cells({"a": "1", "b": "2"})
    assert found.in_words == "24 runs: 2 recordings x 6 configurations x 2 seeds"
    assert found.count == len(cells) == len({cell.id for cell in cells}) == 24
    keys = [(c.recording, c.config.particles, c.config.resampling.policy, c.config.seed) for c in cells]
    assert keys[:3] == [("a", 10, "always", 0), ("a", 10, "always", 1), ("a", 10, "n_eff", 0)]
    assert len(set(keys)) == 24
    assert cells[2].key == {
        "recording": "a",
        "config": "paper",
        "particles": "10",
        "resampling.policy": "n_eff",
        "seed": "0",
    }


def test_blocks_share_their_common_cell_and_tell_each_others_settings() -> None:
    found = plan(
        Block(("paper",), (("particles", ("500", "50")),)), Block(("paper",), (("map.cell", ("0.07", "0.1")),))
    )
    rows = [dict(variant.settings) for variant in found.variants]
    assert rows == [
        {"particles": "500", "map.cell": "0.07"},  # the paper's own, asked for by both
        {"particles": "50", "map.cell": "0.07"},
        {"particles": "500", "map.cell": "0.1"},
    ]


def test_the_identity_of_a_cell_is_its_content() -> None:
    one, same = (plan(Block(("paper",), (("particles", (n,)),))) for n in ("10", "10"))
    other = plan(Block(("paper",), (("particles", ("11",)),)))
    prints = {"a": "1", "b": "2"}
    ids = [cell.id for cell in one.cells(prints)]
    assert [cell.id for cell in same.cells(prints)] == ids
    assert not set(ids) & {cell.id for cell in other.cells(prints)}
    assert not set(ids) & {cell.id for cell in one.cells({"a": "3", "b": "4"})}  # other recordings of the same names


def test_lists_are_values_too() -> None:
    values = parse_values(["motion.variance=[0.001, 0.001, 0.002],[0.1,0.1,0.1]", "map.cell=0.05,0.1"])
    assert values[0] == ("motion.variance", ("[0.001, 0.001, 0.002]", "[0.1,0.1,0.1]"))
    variants = plan(Block(("paper",), values)).variants
    assert len(variants) == 4
    first = variants[0].values
    assert isinstance(first, PaperConfig) and first.motion.variance == (0.001, 0.001, 0.002)
    assert dict(variants[2].settings)["motion.variance"] == "[0.1, 0.1, 0.1]"


def test_a_setting_that_one_filter_lacks_is_refused() -> None:
    with pytest.raises(InputError, match=r"motion\.variance.*rao_blackwellized does not read it"):
        plan(Block(("default",), (("motion.variance", ("[0.1, 0.1, 0.1]",)),)))


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["particles"], "particles=50,100"),
        (["particles=5,,6"], "particles=50,100"),
        (["particles=5", "particles=6"], "set twice"),
    ],
)
def test_mistakes_in_values(texts: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_values(texts)


def test_mistakes_in_plans() -> None:
    with pytest.raises(InputError, match="listed twice"):
        make_plan([PLACES[0], PLACES[0]], [Block()], [0])
    with pytest.raises(InputError, match="needs a recording"):
        make_plan([], [Block()], [0])
    with pytest.raises(InputError, match="seed 3 is listed twice"):
        make_plan(PLACES, [Block()], [3, 3])
    with pytest.raises(InputError, match="is swept by"):
        plan(Block(("paper,particles=3",), (("particles", ("4",)),)))


def test_a_file_says_the_same(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(
        'recordings = ["a"]\nseeds = [3, 7]\nby = "position_max_m"\n'
        '[[runs]]\nconfig = "paper"\nset.particles = [50, 100]\n'
        '[[runs]]\nconfig = ["paper", "default"]\n[runs.set]\nmap.cell = [0.05]\n'
        '[[runs]]\nconfig = "paper"\nset."motion.variance" = [[0.1, 0.1, 0.1], [0.2, 0.2, 0.2]]\n'
    )
    file = read_plan_file(path)
    assert (file.recordings, file.seeds, file.by) == (["a"], [3, 7], "position_max_m")
    assert file.blocks == [
        Block(("paper",), (("particles", ("50", "100")),)),
        Block(("paper", "default"), (("map.cell", ("0.05",)),)),
        Block(("paper",), (("motion.variance", ("[0.1, 0.1, 0.1]", "[0.2, 0.2, 0.2]")),)),
    ]


@pytest.mark.parametrize("path", sorted((configs_dir() / "sweeps").glob("*.toml")), ids=lambda path: path.stem)
def test_the_shipped_studies_can_be_run_with_five_seeds_or_more(path: Path) -> None:
    file = read_plan_file(Path(path.stem))
    assert isinstance(file.seeds, int) and file.seeds >= 5
    found = make_plan([(name, RecordingChoice(name)) for name in file.recordings], file.blocks, range(file.seeds))
    assert len(found.variants) > 1 and "twin21" in file.recordings


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("seeds = 0", "seeds"),
        ("recording = 3", "recording"),
        ("seeds = ", "not valid TOML"),
        ('config = "paper"\n[[runs]]\nconfig = "paper"', "not in both"),
    ],
)
def test_mistakes_in_files(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_plan_file(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
