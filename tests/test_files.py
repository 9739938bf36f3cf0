"""A final name never holds half a file."""

import os
import stat
from pathlib import Path

import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.files import check_writable, replaced


def test_the_file_appears_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "new" / "deep" / "out.rrd"
    with replaced(path) as temporary:
        temporary.write_text("half")
        assert not path.exists()
        assert temporary.parent == path.parent  # a rename within one file system
        assert temporary.suffix == path.suffix
    assert path.read_text() == "half"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "out.rrd"
    path.write_text("old")
    with pytest.raises(error), replaced(path) as temporary:
        temporary.write_text("half")
        raise error
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_file_has_the_users_permissions(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        with replaced(tmp_path / "out") as temporary:
            temporary.write_text("x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o640


def test_a_file_in_the_way_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"), replaced(tmp_path / "file" / "out.rrd"):
        pass


def test_a_folder_in_the_way_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "out.rrd").mkdir()
    with pytest.raises(InputError, match=r"out\.rrd"), replaced(tmp_path / "out.rrd") as temporary:
        temporary.write_text("x")
    assert [p.name for p in tmp_path.iterdir()] == ["out.rrd"]


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "target")
    with replaced(tmp_path / "link") as temporary:
        temporary.write_text("x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "x"


@pytest.mark.skipif(not Path("/dev/null").exists(), reason="needs a device")
def test_a_device_is_not_replaced() -> None:
    with pytest.raises(InputError, match="not a regular file"), replaced(Path("/dev/null")):
        pass
    with pytest.raises(InputError, match="not a regular file"):
        check_writable(Path("/dev/null"))


def test_check_writable_accepts_what_can_be_made_and_leaves_nothing(tmp_path: Path) -> None:
    check_writable(tmp_path / "a" / "b" / "out.rrd")
    check_writable(tmp_path / "a" / "b", folder=True)
    check_writable(tmp_path, folder=True)
    assert list(tmp_path.iterdir()) == []


def test_check_writable_refuses_a_folder_where_a_file_is_meant_and_the_reverse(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder"):
        check_writable(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="not a folder"):
        check_writable(tmp_path / "file", folder=True)
    with pytest.raises(InputError, match="not a folder"):
        check_writable(tmp_path / "file" / "out.rrd")


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_check_writable_refuses_a_read_only_folder(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="Permission denied"):
        check_writable(tmp_path / "out.rrd")


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a file system that nobody can write to")
def test_check_writable_refuses_a_file_system_that_takes_no_files() -> None:
    with pytest.raises(InputError, match="cannot be written"):
        check_writable(Path("/proc/pfslam/out.rrd"))
