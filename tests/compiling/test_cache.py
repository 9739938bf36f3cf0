"""Where compiled kernels are kept, also where little can be written."""

import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pfslam_viz.compiling import cache

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def afresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Nothing is chosen yet, nothing is named, and only folders of the test's own are looked at."""
    monkeypatch.setattr("numba.core.config.CACHE_DIR", "", raising=False)
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setattr(cache, "PACKAGE", tmp_path / "package")
    monkeypatch.setattr(cache, "_users", lambda: tmp_path / "home" / "pfslam-viz")
    monkeypatch.setattr(cache, "_temporary", lambda: tmp_path / "temporary")
    cache.folder.cache_clear()
    yield
    cache.folder.cache_clear()


def blocked(path: Path) -> None:
    """A file where a folder should be: nobody can write there, not even root."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("")


def test_the_package_is_first(tmp_path: Path) -> None:
    (tmp_path / "package" / "compiling").mkdir(parents=True)
    assert cache.folder() == tmp_path / "package"
    assert os.environ["NUMBA_CACHE_DIR"] == ""  # numba finds it itself
    assert cache.where() == f"compiled kernels are kept in {tmp_path / 'package'}"


def test_then_the_users_cache(tmp_path: Path) -> None:
    blocked(tmp_path / "package")
    assert cache.folder() == tmp_path / "home" / "pfslam-viz"
    assert os.environ["NUMBA_CACHE_DIR"] == str(tmp_path / "home" / "pfslam-viz")


def test_then_a_temporary_folder_of_the_users_own(tmp_path: Path) -> None:
    blocked(tmp_path / "package")
    blocked(tmp_path / "home")
    assert cache.folder() == tmp_path / "temporary"
    assert stat.S_IMODE((tmp_path / "temporary").stat().st_mode) == 0o700


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o755])
def test_a_temporary_folder_that_others_may_enter_is_none(tmp_path: Path, mode: int) -> None:
    blocked(tmp_path / "package")
    blocked(tmp_path / "home")
    (tmp_path / "temporary").mkdir()
    (tmp_path / "temporary").chmod(mode)
    assert cache.folder() is None and not cache.use_cache()


def test_nor_is_a_link_to_one(tmp_path: Path) -> None:
    blocked(tmp_path / "package")
    blocked(tmp_path / "home")
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    (tmp_path / "temporary").symlink_to(tmp_path / "elsewhere")
    assert cache.folder() is None


def test_a_folder_that_is_named_is_the_only_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "package" / "compiling").mkdir(parents=True)
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "named"))
    assert cache.folder() == tmp_path / "named"
    cache.folder.cache_clear()
    blocked(tmp_path / "file")
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "file"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert cache.folder() is None
    assert str(tmp_path / "file") in cache.where() and "NUMBA_CACHE_DIR" in cache.where()


def test_a_user_without_a_home_has_no_cache_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.undo()
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "expanduser", lambda self: (_ for _ in ()).throw(RuntimeError("no home")))
    assert not cache._users().is_absolute()
    assert cache._made(cache._users()) is None


def test_a_run_without_any_place_for_a_cache_says_so_and_goes_on(tmp_path: Path) -> None:
    """ "RuntimeError: cannot cache function", it was."""
    blocked(tmp_path / "nowhere")
    code = "import numpy as np\nfrom pfslam_viz.slam import kernels\nprint(kernels.compose(np.zeros(3), np.ones(3)))\n"
    code += "from pfslam_viz.compiling import cache\nprint(cache.where())"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "nowhere"), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    first, second = done.stdout.splitlines()
    assert first == "[1. 1. 1.]" and second.startswith("compiled kernels cannot be kept")
