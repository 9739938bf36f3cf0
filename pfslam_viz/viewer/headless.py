"""Rerun's own viewer without a window: to check recordings in it, and to photograph them.

Needs Vulkan on the machine; a software renderer will do (Debian: mesa-vulkan-drivers and libvulkan1).
"""

import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.viewer.connections import free_port, out_of_reach_of_ctrl_c, viewer_binary

START_SECONDS = 60.0
SETTLE_SECONDS = 1.0  # compressed images decode after the first paint
MENU_BAR = 36  # pixels at the top of the window that belong to the viewer and not to the recording
VULKAN = "install Vulkan, of which a software renderer will do (apt-get install mesa-vulkan-drivers libvulkan1)"


class HeadlessViewer:
    """A viewer that runs and listens on the loopback; made by :func:`headless_viewer`."""

    def __init__(self, client: Any, process: "subprocess.Popen[bytes]") -> None:
        self._client = client
        self.process = process

    def open(self, path: Path) -> float:
        """Open a recording; seconds until it was painted."""
        started = time.monotonic()
        self._client.open(str(path.resolve()))
        deadline = started + START_SECONDS
        while self._client.get_state().loading or not self._views():
            if time.monotonic() > deadline:
                raise PfslamError(f"{path}: the viewer did not open it within {START_SECONDS:.0f} s")
            time.sleep(0.02)
        self._paint()
        return time.monotonic() - started

    def seek(self, step: int) -> float:
        """Go to a scan and stay there; seconds until it was painted."""
        started = time.monotonic()
        self._go_to(step)
        self._paint()
        return time.monotonic() - started

    def last_step(self) -> int:
        """The recording's last scan."""
        ends = [t.end for r in self._client.get_state().recordings for t in r.timelines if t.name == "step"]
        return int(max(end for end in ends if end is not None))

    def show_tab(self, name: str) -> None:
        """Bring the outermost tab of this name, in whatever case, to the front. Raises InputError if there is none."""
        blueprint = self._client.get_blueprint().blueprint
        parts = {path.lstrip("/"): part for path, part in blueprint.items()}
        root = parts.get("viewport", {}).get("ViewportBlueprint", {}).get("root_container")
        container = _container(parts, f"container/{root}")
        while container and container["container_kind"] != "Tabs":
            container = _container(parts, container["contents"][0]) if container["contents"] else {}
        names = {_name(parts[tab]): tab for tab in container.get("contents", ()) if tab in parts}
        if not names:
            raise InputError("the recording has no layout with tabs; was it written by pfslam-viz?")
        found = [tab for known, tab in names.items() if known.casefold() == name.casefold()]
        if not found:
            raise InputError(f"no view is called '{name}'; there are {', '.join(names)}")
        container["active_tab"] = found[0]
        self._client.set_blueprint(blueprint, of="recording")
        self._paint()

    def reports(self) -> list[str]:
        """Every error and warning that a view on screen shows."""
        return [f"{view.name}: {report}" for view in self._client.get_state().views for report in view.reports]

    def photograph(self, path: Path) -> None:
        """Write what is on screen as PNG."""
        time.sleep(SETTLE_SECONDS)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._client.save_screenshot(str(path), view_id=None)

    def settle(self) -> None:
        """Wait until what has to be decoded first was painted too."""
        time.sleep(SETTLE_SECONDS)
        self._paint()

    def picture_at(self, step: int) -> NDArray[np.uint8]:
        """What is on screen below the viewer's menu bar at a scan, (rows, columns, 3) BGR."""
        import cv2

        self._go_to(step)
        image = cv2.imdecode(np.frombuffer(self._client.take_screenshot(), np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise PfslamError("the viewer gave no picture")
        return np.asarray(image[MENU_BAR:], np.uint8)

    def _go_to(self, step: int) -> None:
        self._client.set_time("step", sequence=step, play_state="paused")

    def _paint(self) -> None:
        self._client.take_screenshot(max_size=64)

    def _views(self) -> Sequence[Any]:
        views: Sequence[Any] = self._client.get_state().views
        return views


@contextmanager
def headless_viewer(size: tuple[int, int] = (1600, 900), memory: str = "4GB") -> Iterator[HeadlessViewer]:
    """A viewer of this size in pixels, its menu bar included, which ends with the block.

    Raises PfslamError where there is no Vulkan, or no viewer.
    """
    binary = viewer_binary()
    if not binary.is_file():
        raise PfslamError(f"{binary}: the viewer is not there; it comes with rerun-sdk (pip install rerun-sdk)")
    port = free_port("127.0.0.1")
    width, height = size
    command: list[str | Path] = [binary, "--headless", "--hide-welcome-screen", "--memory-limit", memory]
    command += ["--bind", "127.0.0.1", "--port", str(port), "--window-size", f"{width}x{height}"]
    with tempfile.TemporaryDirectory() as runtime:
        environment = {**os.environ, "XDG_RUNTIME_DIR": runtime}
        output = Path(runtime) / "output"
        with running(command, output, environment) as process:
            client = _connect(port, process, output)
            try:
                yield HeadlessViewer(client, process)
            except Exception as error:
                if isinstance(error, PfslamError) or not _has_ended(process):
                    raise
                raise PfslamError(f"the viewer ended in mid-work: {_last_words(process, output)}") from error


def _connect(port: int, process: "subprocess.Popen[bytes]", output: Path) -> Any:
    """A client of the viewer, once that has drawn for the first time: where it cannot draw, it still answers before."""
    from rerun.experimental import ViewerClient

    deadline = time.monotonic() + START_SECONDS
    while process.poll() is None:
        try:
            client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            client.take_screenshot(max_size=64)
            return client
        except Exception as error:  # the client's errors have no type of their own
            if time.monotonic() > deadline:
                raise PfslamError(f"the viewer did not answer within {START_SECONDS:.0f} s") from error
            time.sleep(0.1)
    raise PfslamError(
        f"the viewer cannot draw without a window here: {VULKAN}; it ended with: {_last_words(process, output)}"
    )


def _has_ended(process: "subprocess.Popen[bytes]") -> bool:
    """Whether it ended, or does so within a moment: its connection goes before itself."""
    try:
        process.wait(2.0)
    except subprocess.TimeoutExpired:
        return False
    return True


@contextmanager
def running(
    command: Sequence[str | Path], output: Path, environment: dict[str, str] | None = None
) -> "Iterator[subprocess.Popen[bytes]]":
    """A process that writes what it says to ``output`` and ends with the block, by force if need be.

    Ctrl-C is for us alone: what it was started for may still have to be put in order. Raises PfslamError where it
    cannot be started.
    """
    with output.open("wb") as sink:
        try:
            process = subprocess.Popen(
                command, env=environment, stdout=sink, stderr=subprocess.STDOUT, **out_of_reach_of_ctrl_c()
            )
        except OSError as error:
            raise PfslamError(f"{command[0]}: cannot be started: {error.strerror}") from None
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _container(parts: dict[str, dict[str, Any]], path: str) -> dict[str, Any]:
    """A container of the layout; empty where there is none."""
    found: dict[str, Any] = parts.get(path, {}).get("ContainerBlueprint", {})
    return found


def _name(part: dict[str, Any]) -> str:
    return str(part.get("ContainerBlueprint", part.get("ViewBlueprint", {})).get("display_name"))


def _last_words(process: "subprocess.Popen[bytes]", output: Path) -> str:
    """Why the viewer ended: where it panicked, else its status."""
    lines = [line.strip() for line in output.read_text(errors="replace").splitlines()]
    return next((line for line in lines if "panicked" in line), f"status {process.returncode}")
