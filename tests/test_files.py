"""A final name never holds half a file."""

import errno
import os
import stat
import sys
import tempfile
from pathlib import Path

import pytest

from pfslam_viz import files
from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.files import check_writable, replaced
from pfslam_viz.simulation.recording import simulate


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


@pytest.mark.parametrize(("times", "made"), [(1, True), (9, True), (10, False)])
def test_a_folder_that_another_thread_removes_in_between_is_made_again(
    times: int, made: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where several files are fetched into one new folder, and the first of them is not there."""
    mkstemp, calls = tempfile.mkstemp, list[Path]()

    def removed_before(prefix: str, suffix: str, dir: Path) -> tuple[int, str]:
        calls.append(dir)
        if len(calls) <= times:
            dir.rmdir()
        return mkstemp(prefix=prefix, suffix=suffix, dir=dir)

    monkeypatch.setattr(tempfile, "mkstemp", removed_before)
    path = tmp_path / "new" / "out.npz"
    if made:
        with replaced(path) as temporary:
            temporary.write_text("all")
        assert path.read_text() == "all"
    else:
        with pytest.raises(InputError, match="cannot be written: No such file"), replaced(path):
            pass


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


def part_of(path: Path, number: int = 0, nested: bool = False) -> Path:
    """A temporary file as a run that was killed leaves it."""
    mark = f".{number:08d}.part{path.suffix}"
    part = path.with_name(f".{path.name}{mark}")
    part = part.with_name(f".{part.name}{mark}") if nested else part
    part.write_text("half")
    return part


@pytest.mark.skipif(sys.platform == "win32", reason="needs locks on files")
def test_what_a_killed_run_left_of_the_same_file_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "out.rrd"
    stale = [part_of(path, 1), part_of(path, 2, nested=True)]
    others = [part_of(tmp_path / "other.rrd"), part_of(tmp_path / "out.rrd.bak"), tmp_path / ".out.rrd.mine"]
    others[-1].write_text("no part")
    with replaced(path) as temporary:
        temporary.write_text("new")
        assert not any(part.exists() for part in stale)
    assert path.read_text() == "new"
    assert all(other.exists() for other in others)


@pytest.mark.skipif(sys.platform == "win32", reason="needs locks on files")
def test_what_another_run_is_writing_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "out.rrd"
    with replaced(path) as first:
        first.write_text("first")
        files._PARTS.clear()  # as another process, which has not looked yet
        with replaced(path) as second:
            second.write_text("second")
            assert first.exists()
        assert path.read_text() == "second"
    assert path.read_text() == "first"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO])
def test_a_full_disk_is_told_with_the_file_and_leaves_nothing(tmp_path: Path, number: int) -> None:
    path = tmp_path / "new" / "out.rrd"
    with pytest.raises(PfslamError, match=r"new/out\.rrd: cannot be written: .+") as caught, replaced(path):
        raise OSError(number, os.strerror(number))
    assert caught.value.exit_status == 1
    assert list(tmp_path.iterdir()) == []


def test_another_files_trouble_is_not_blamed_on_this_one(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="elsewhere"), replaced(tmp_path / "out.rrd"):
        raise OSError(errno.ENOSPC, "No space left on device", "elsewhere")


@pytest.mark.skipif(sys.platform == "win32", reason="needs locks on files")
def test_what_a_killed_simulation_left_is_removed(tmp_path: Path) -> None:
    stale = tmp_path / ".drive.12345678.part"
    stale.mkdir()
    (stale / "Hokuyo1.npz").write_text("half")
    simulate(tmp_path / "drive", duration=5, frames=False)
    assert [path.name for path in tmp_path.iterdir()] == ["drive"]
