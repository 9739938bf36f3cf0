"""What docs/security.md promises: nothing that is read is run, and every socket listens on this machine alone."""

import ast
import ipaddress
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

import pfslam_viz

PACKAGE = Path(pfslam_viz.__file__).parent

FORBIDDEN_MODULES = {"pickle", "cPickle", "_pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve", "code"}
FORBIDDEN_CALLS = {"eval", "exec", "compile", "__import__", "input", "breakpoint"}
FORBIDDEN_METHODS = {
    ("os", "system"), ("os", "popen"), ("subprocess", "getoutput"), ("subprocess", "getstatusoutput"),
    ("yaml", "load"), ("yaml", "unsafe_load"), ("runpy", "run_path"), ("tempfile", "mktemp"),
}  # fmt: skip


def dangers(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of everything in a module that could run what it was given."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name.split(".")[0] for alias in node.names]
            yield from ((node.lineno, name) for name in names if name in FORBIDDEN_MODULES)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in FORBIDDEN_MODULES:
            yield node.lineno, node.module or ""
        elif isinstance(node, ast.Call):
            yield from ((node.lineno, what) for what in _dangers_of_call(node))


def _dangers_of_call(call: ast.Call) -> Iterator[str]:
    called, arguments = call.func, {keyword.arg: keyword.value for keyword in call.keywords}
    if isinstance(called, ast.Name) and called.id in FORBIDDEN_CALLS:
        yield called.id
    if isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name):
        name = (called.value.id, called.attr)
        if name in FORBIDDEN_METHODS or called.attr.startswith(("spawnl", "execv")):
            yield ".".join(name)
        if name == ("np", "load") and "allow_pickle" not in arguments:
            yield "np.load"
    for danger in {"shell", "allow_pickle"} & set(arguments):
        value = arguments[danger]
        if not isinstance(value, ast.Constant) or value.value is not False:
            yield danger


def test_nothing_in_the_package_can_run_what_it_reads() -> None:
    modules = sorted(PACKAGE.rglob("*.py"))
    assert len(modules) > 150
    found = {
        f"{path.relative_to(PACKAGE)}:{line}: {what}"
        for path in modules
        for line, what in dangers(ast.parse(path.read_text(encoding="utf-8")))
    }
    assert found == set()


@pytest.mark.parametrize(
    "line",
    [
        "import pickle", "from pickle import loads", "import os, marshal", "eval('1')", "exec(text)",
        "__import__(name)", "subprocess.run(command, shell=True)", "subprocess.run(command, shell=how)",
        "os.system(command)", "np.load(file)", "np.load(file, allow_pickle=True)", "yaml.load(text)",
        "tempfile.mktemp()",
    ],
)  # fmt: skip
def test_the_search_finds_each_of_them(line: str) -> None:
    assert list(dangers(ast.parse(line)))


def listening(process: psutil.Process) -> set[tuple[str, int]]:
    """Address and port of every socket that a process and its children listen on."""
    family = [process, *process.children(recursive=True)]
    return {
        (socket.laddr.ip, socket.laddr.port)
        for member in family
        for socket in member.net_connections(kind="inet")
        if socket.status == psutil.CONN_LISTEN
    }


@pytest.mark.parametrize("options", [["--serve"], ["--serve", "--web"]], ids=" ".join)
def test_what_is_served_is_served_on_the_loopback_alone(tmp_path: Path, options: list[str]) -> None:
    log = tmp_path / "drive.clf"
    ranges = " ".join(["2.5"] * 181)
    lines = [f"FLASER 181 {ranges} {0.1 * k} 0 0 {0.1 * k} 0 0 {0.2 * k} host {0.2 * k}" for k in range(30)]
    log.write_text("\n".join(lines))
    command = [sys.executable, "-m", "pfslam_viz", "replay", str(log), "--config", "paper", "--particles", "5"]
    process = subprocess.Popen([*command, "--force", "--quiet", *options], stderr=subprocess.PIPE, text=True)
    try:
        said = ""
        for line in process.stderr or ():
            said += line
            if "still serving" in line:
                break
        else:
            raise AssertionError(said)
        found = listening(psutil.Process(process.pid))
        assert len(found) >= len(options)  # the server, and the page's
        assert all(ipaddress.ip_address(address).is_loopback for address, _ in found), found
    finally:
        process.terminate()
        process.wait(60)
