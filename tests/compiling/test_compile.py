"""Compiling beforehand: in two processes, with what is there loaded, and whatever happens to the cache."""

import os
import subprocess
import sys
from pathlib import Path
from threading import Event

import pytest

from pfslam_viz.compiling.compile import Compiling, compile_all, compiling
from pfslam_viz.compiling.kernel import find, types_of
from pfslam_viz.compiling.needed import Needed
from pfslam_viz.compiling.serve import serve

ROOT = Path(__file__).resolve().parents[2]
SMALL = ("slam.kernels.compose", "slam.kernels.transform", "slam.kernels.move", "slam.kernels.read_scan")
COUNT = """
import os, sys
from pfslam_viz.compiling import compile as module
from pfslam_viz.compiling.needed import Needed
from pfslam_viz.compiling.kernel import find
heard, names = [], {names!r}
{before}
count = module.compile_all(Needed(names[:2], names[2:]), lambda done, total: heard.append((done, total)))
print(count, heard == sorted(heard) and heard[-1:], all(find(name)[0].signatures for name in names))
"""


def run(folder: Path, before: str = "", names: tuple[str, ...] = SMALL) -> list[str]:
    """What a process prints that compiles four kernels with its cache in a folder."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder), "PYTHONPATH": str(ROOT)}
    code = COUNT.format(names=names, before=before)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def stored(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.nbc"))


def test_what_is_not_there_is_compiled_and_the_next_run_loads_it(tmp_path: Path) -> None:
    assert run(tmp_path) == ["4 [(4, 4)] True"]
    assert len(stored(tmp_path)) == 4
    assert run(tmp_path) == ["0 [] True"]


def test_one_process_does_it_alone_where_there_is_no_other(tmp_path: Path) -> None:
    """No second core, or none that starts; one that ends at once is as good as none."""
    assert run(tmp_path / "a", "module.cores = lambda: 1") == ["4 [(4, 4)] True"]
    assert run(tmp_path / "b", "module.OTHER = 'pfslam_viz.no_such_module'") == ["4 [(4, 4)] True"]


def test_the_other_process_does_its_part(tmp_path: Path) -> None:
    """This one, made to wait at its first kernel, finds the last ones compiled by the other."""
    wait = (
        "import time\nown = module.Compiling._compile\n"
        "def slow(self, name):\n"
        "    while name == names[0] and len(self._there) < 3: time.sleep(0.01)\n"
        "    own(self, name)\n"
        "module.Compiling._compile = slow\n"
        "import atexit\nstart = module.Compiling._start\n"
        "def started(self):\n"
        "    atexit.register(lambda: print(*self._there))\n"
        "    start(self)\n"
        "module.Compiling._start = started"
    )
    assert run(tmp_path, wait) == ["4 [(4, 4)] True", " ".join(reversed(SMALL[1:]))]
    assert len(stored(tmp_path)) == 4


def test_without_a_cache_everything_is_compiled_here(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert run(tmp_path / "file") == ["4 [(4, 4)] True"]


def test_a_cache_that_is_damaged_is_made_anew(tmp_path: Path) -> None:
    run(tmp_path)
    for path in tmp_path.rglob("*.nb[ic]"):
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert run(tmp_path) == ["4 [(4, 4)] True"]
    assert run(tmp_path) == ["0 [] True"]


def test_a_cache_that_fills_up_ends_no_run(tmp_path: Path) -> None:
    full = (
        "from numba.core.caching import IndexDataCacheFile\n"
        "def save(self, *a): raise OSError(28, 'No space left on device')\n"
        "IndexDataCacheFile.save = save\nmodule.use_cache = lambda: False"
    )
    assert run(tmp_path, full) == ["4 [(4, 4)] True"]
    assert stored(tmp_path) == []


def test_what_is_needed_later_is_waited_for_where_it_is_being_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kernel that the other process has begun is not begun here; one that it has not is taken away from it."""
    process = Compiling()
    process._later.extend(["slam.kernels.pick", "slam.kernels.moments"])
    assert process._fetch("slam.kernels.pick") is False  # it is for this one to compile
    assert list(process._later) == ["slam.kernels.moments"]
    waited = []
    event = Event()
    monkeypatch.setattr(event, "wait", lambda: waited.append(1))
    process._there["slam.kernels.moments"] = event
    assert process._fetch("slam.kernels.moments") is True
    assert waited == [1]


def test_nothing_is_left_running(tmp_path: Path) -> None:
    with compiling(Needed(SMALL[:1], SMALL[1:])) as count:
        assert count <= 1
    process = Compiling()
    process._start()
    other, thread = process._other, process._thread
    process.close()
    assert other is not None and other.poll() is not None
    assert thread is not None and not thread.is_alive()


def test_the_server_says_what_it_has_done(capsys: pytest.CaptureFixture[str]) -> None:
    serve(["slam.kernels.compose\n", "slam.kernels.move\n"])
    assert capsys.readouterr().out.split() == ["slam.kernels.compose", "slam.kernels.move"]
    for name in ("slam.kernels.compose", "slam.kernels.move"):
        compiled, signature = find(name)
        assert types_of(compiled, signature) in compiled.signatures


def test_what_is_loaded_already_counts_as_compiled() -> None:
    compile_all(Needed(SMALL))
    assert compile_all(Needed(SMALL)) == 0
