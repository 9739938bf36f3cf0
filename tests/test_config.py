"""Every number of the filter is checked when it is read, and a mistake is named with its file and key."""

from pathlib import Path

import pytest

from pfslam_viz.config import configs_dir, load_config, load_robot
from pfslam_viz.config_text import allowed, as_markdown, as_toml, settings_of
from pfslam_viz.errors import InputError
from pfslam_viz.slam.paper.settings import PaperConfig

ROBOT = (configs_dir() / "robots" / "ece276a.toml").read_text(encoding="utf-8")


def toml(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_paper_is_the_paper() -> None:
    paper = load_config("paper")
    assert (paper.backend, paper.particles, paper.map.cell) == ("single_map", 500, 0.07)
    assert (paper.motion.model, paper.motion.variance) == ("additive", (0.001, 0.001, 0.001))
    assert (paper.observation.model, paper.observation.perturbation) == ("correlation", False)
    assert (paper.observation.perturbation_cells, paper.observation.perturbation_angle) == (1, 0.02)
    assert paper.observation.max_beams is None
    assert (paper.resampling.policy, paper.resampling.scheme) == ("always", "multinomial")
    assert paper.map.log_odds_hit == paper.map.log_odds_miss == pytest.approx(1.386294)  # log 4
    assert paper.name == "paper"


@pytest.mark.parametrize(
    ("config", "setting"),
    [
        ("paper", "particles=100001"),
        ("default", "particles=1001"),  # a map each
        ("paper", f"particles={2**60}"),
        ("paper", f"observation.max_beams={2**60}"),
        ("default", f"rao_blackwellized.samples={2**60}"),
        ("default", f"scan_matching.most_points={2**60}"),
        ("default", f"loop_closing.points={2**60}"),
    ],
)
def test_counts_that_would_fill_the_memory_are_refused(config: str, setting: str) -> None:
    key, number = setting.split("=")
    with pytest.raises(InputError, match=rf"'{key}' = {number}: input should be less than or equal to"):
        load_config(config, [setting])


def test_every_count_has_a_limit() -> None:
    """All but the seed, of which any number will do."""
    for name in ("paper", "default"):
        for key, field in settings_of(type(load_config(name))):
            if field.annotation is int and key != "seed":
                assert "to" in allowed(field), key
    assert load_config("default", [f"seed={2**60}"]).seed == 2**60


@pytest.mark.parametrize("path", sorted(configs_dir().glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_configuration_is_valid(path: Path) -> None:
    assert load_config(path.stem).name == load_config(path).name


@pytest.mark.parametrize("path", sorted((configs_dir() / "robots").glob("*.toml")), ids=lambda path: path.stem)
def test_every_shipped_robot_is_valid(path: Path) -> None:
    assert load_robot(path.stem) == load_robot(path)


def test_an_empty_file_is_the_defaults(tmp_path: Path) -> None:
    assert load_config(toml(tmp_path, "")) == PaperConfig(name="mine")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("particle = 3", "unknown key 'particle': the filter single_map does not read it; allowed here: .*particles"),
        ("[map]\ncel = 1.0", "unknown key 'map.cel': the filter single_map does not read it; allowed here: cell, "),
        ("[filter]\nx = 1", "unknown key 'filter'"),
        ("particles = 0", "'particles' = 0: .*greater than or equal to 1"),
        ("particles = 500.0", "'particles' = 500.0: .*valid integer"),
        ("particles = true", "'particles' = True: .*valid integer"),
        ("particles = 'many'", "'particles' = 'many': .*valid integer"),
        ("seed = -1", "'seed' = -1"),
        ("[map]\ncell = 0.0", "'map.cell' = 0.0: .*greater than or equal to 0.005"),
        ("[map]\ncell = nan", "'map.cell' = nan"),
        ("[map]\nlog_odds_hit = inf", "'map.log_odds_hit' = inf: .*finite"),
        ("[motion]\nmodel = 'loud'", "'motion.model' = 'loud': .*'additive' or 'scaled'"),
        ("[motion]\nvariance = [0.1, -0.1, 0.1]", r"'motion\.variance\.1' = -0\.1: .*greater than or equal to 0"),
        ("[motion]\nvariance = [0.1, 0.1]", r"'motion\.variance\.2' is missing"),
        ("map = 3", r"'map' = 3: it is a section, \[map\]"),
        ("map = [", "not valid TOML"),
    ],
)
def test_mistakes_name_file_key_and_what_is_allowed(tmp_path: Path, text: str, message: str) -> None:
    path = toml(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        load_config(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_all_mistakes_are_named_at_once(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"'particles' = 0.*'seed' = -1"):
        load_config(toml(tmp_path, "particles = 0\nseed = -1"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wheels = 4\n" + ROBOT, "unknown key 'wheels'"),
        (ROBOT + "\nlens = 1", "unknown key 'camera.lens'; allowed here: position"),
        ("axle_height = 0.1", "'wheel_diameter' is missing; .*'lidar' is missing"),
        (ROBOT.replace("ticks_per_revolution = 360", "ticks_per_revolution = 0"), "'ticks_per_revolution' = 0"),
        (ROBOT.replace("yaw = 0.0", "yaw = 90.0"), r"'lidar\.yaw' = 90\.0"),
    ],
)
def test_mistakes_in_a_robot_file(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_robot(toml(tmp_path, text))


def test_settings_reach_every_section_in_toml_or_bare_words() -> None:
    config = load_config(
        "paper",
        [
            "particles=7",
            "map.cell = 0.05",
            "resampling.policy=n_eff",
            "observation.perturbation=true",
            "motion.variance=[0.1, 0.2, 0.3]",
            "observation.max_range=12",
        ],
    )
    assert (config.particles, config.map.cell, config.resampling.policy) == (7, 0.05, "n_eff")
    assert config.observation.perturbation is True
    assert config.observation.max_range == 12.0
    assert config.motion.variance == (0.1, 0.2, 0.3)
    assert config.resampling.scheme == "multinomial"  # what was not set stays


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("map.cell", "section.key=value"),
        ("=1", "section.key=value"),
        ("map..cell=1", "section.key=value"),
        ("particles.x=1", "particles is not a section"),
        ("map.size=1", "unknown key 'map.size'"),
        ("map.cell=", "'map.cell' = ''"),
        ("map.cell=big", "'map.cell' = 'big'"),
    ],
)
def test_mistakes_in_settings(setting: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load_config("paper", [setting])
    assert str(caught.value).startswith(f"--set {setting}: ")


def test_a_mistake_is_blamed_on_who_made_it(tmp_path: Path) -> None:
    """The file has one, the command line another; a setting that mends the file's leaves nothing to blame."""
    path = toml(tmp_path, "particles = 0")
    with pytest.raises(InputError) as caught:
        load_config(path, ["map.cell=big"])
    file, setting = str(caught.value).split("; ")
    assert file.startswith(f"{path}: 'particles' = 0: ")
    assert setting.startswith("--set map.cell=big: 'map.cell' = 'big': ")
    assert load_config(path, ["particles=3"]).particles == 3
    with pytest.raises(InputError, match=r"^--particles 0: 'particles' = 0"):
        load_config("paper", ["particles=0"], lambda text: f"--particles {text.partition('=')[2]}")


@pytest.mark.parametrize(
    ("name", "setting", "message"),
    [
        (
            "default",
            "motion.model=scaled",
            "unknown key 'motion': the filter rao_blackwellized does not read it, single_map does",
        ),
        (
            "default",
            "observation.perturbation=true",
            "unknown key 'observation.perturbation': .* single_map does; allowed",
        ),
        ("paper", "smoothing.enabled=false", "unknown key 'smoothing': .* rao_blackwellized does"),
        (
            "paper",
            "matching.sigma=1.0",
            "unknown key 'matching': the filter single_map does not read it; allowed here: name",
        ),
        (
            "paper",
            "backend=magic",
            "^--set backend=magic: 'backend' = 'magic': there are single_map and rao_blackwellized",
        ),
    ],
)
def test_a_key_that_the_filter_does_not_read_is_an_error(name: str, setting: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_config(name, [setting])


def test_carmen_is_another_name_of_the_default() -> None:
    assert load_config("carmen") == load_config("default")


def test_a_configuration_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no configuration is called 'papper'; there are .*paper"):
        load_config("papper")
    with pytest.raises(InputError, match=r"nowhere\.toml: no such configuration file"):
        load_config(tmp_path / "nowhere.toml")
    with pytest.raises(InputError, match="no robot is called 'r2d2'; there are ece276a"):
        load_robot("r2d2")
    with pytest.raises(InputError, match="no such configuration file"):
        (tmp_path / "folder.toml").mkdir()
        load_config(tmp_path / "folder.toml")


def test_a_file_that_is_not_text(tmp_path: Path) -> None:
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not valid TOML"):
        load_config(path)


def test_a_configuration_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="frozen"):
        load_config("paper").particles = 3  # type: ignore[misc]


@pytest.mark.parametrize("name", ["paper", "default"])
def test_what_is_printed_reads_back(name: str, tmp_path: Path) -> None:
    config = load_config(name, ["particles=7", "observation.max_beams=90"])
    path = toml(tmp_path, as_toml(config))
    assert load_config(path) == config
    for key, field in settings_of(type(config)):
        assert field.description, f"{key} says nothing of itself"
        assert f"# {key.rpartition('.')[2]}: " in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("map.cell", "0.005 to 1"),
        ("map.log_odds_hit", "> 0"),
        ("resampling.threshold", "> 0 and <= 1"),
        ("resampling.policy", "always or n_eff"),
        ("texture.enabled", "true or false"),
        ("motion.variance", ""),
    ],
)
def test_ranges_in_words(key: str, text: str) -> None:
    assert allowed(dict(settings_of(PaperConfig))[key]) == text


def test_the_reference_page_is_what_the_code_says() -> None:
    page = Path(__file__).resolve().parents[1] / "docs" / "configuration.md"
    assert page.read_text(encoding="utf-8") == as_markdown(), (
        "run: pfslam-viz config --markdown > docs/configuration.md"
    )
