"""What the user chose on the command line, as values, and how each choice becomes the thing itself."""

import os
import re
import sys
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pfslam_viz.config import Config, load_config
from pfslam_viz.errors import InputError
from pfslam_viz.files import check_writable, missing_folders
from pfslam_viz.names import path_for_rerun
from pfslam_viz.outputs import check_recording
from pfslam_viz.recordings.choice import RecordingChoice as RecordingChoice
from pfslam_viz.streams import stdout_was_closed


@dataclass(frozen=True, slots=True)
class ConfigChoice:
    """``--config`` with ``--set``, ``--particles`` and ``--seed``; ``name`` None is the default one."""

    name: str | None = None
    settings: tuple[str, ...] = ()
    particles: int | None = None
    seed: int | None = None
    label: str | None = None

    @classmethod
    def parse(
        cls, text: str | None, settings: tuple[str, ...] = (), particles: int | None = None, seed: int | None = None
    ) -> "ConfigChoice":
        """From ``NAME|PATH[,KEY=VALUE...]``; what stands in the text wins over the arguments beside it."""
        if text is None:
            return cls(None, settings, particles, seed)
        name, *own = re.split(r",(?![^\[]*\])", text)  # commas outside brackets
        keys = {setting.partition("=")[0].strip() for setting in own}
        return cls(
            name,
            (*settings, *own),
            None if "particles" in keys else particles,
            None if "seed" in keys else seed,
            text if own else None,
        )

    def load(self) -> Config:
        """The configuration. A mistake is blamed on the option that made it."""
        overrides = {"particles": self.particles, "seed": self.seed}
        options = {f"{key}={value}": f"--{key} {value}" for key, value in overrides.items() if value is not None}
        settings = [*self.settings, *options]
        if self.label is not None:
            settings.append(f"name='{self.label}'")
        return load_config(self.name or "default", settings, lambda text: options.get(text, f"--set {text}"))


@dataclass(frozen=True, slots=True)
class DetailChoice:
    """How much is logged; None leaves it to the stream's budgets."""

    map_every: int | None = None
    max_particles: int | None = None
    max_beams: int | None = None

    def options(self) -> Any:
        """The viewer's StreamOptions, with its own defaults for what was not chosen."""
        from pfslam_viz.viewer.collector import StreamOptions

        chosen = {
            "map_every": self.map_every,
            "max_particles": self.max_particles,
            "max_beams": self.max_beams,
        }
        return StreamOptions(**{name: value for name, value in chosen.items() if value is not None})


@dataclass(frozen=True, slots=True)
class SinkChoice:
    """Where the Rerun data goes."""

    save: Path | None = None
    spawn: bool = False
    serve: bool = False
    bind: str = "127.0.0.1"
    connect: str | None = None
    stdout: bool = False
    web: bool = False

    @property
    def any(self) -> bool:
        """Whether there is a place to send it to."""
        return bool(self.save or self.spawn or self.serve or self.connect or self.stdout)

    def or_viewer(self) -> "SinkChoice":
        """Itself, or the viewer where nothing was chosen."""
        if self.any:
            return self
        return SinkChoice(spawn=True, bind=self.bind)

    def open(self) -> AbstractContextManager[Any]:
        """The viewer's sink to all of these; what happens to them is told on stderr."""
        from pfslam_viz.console import tell
        from pfslam_viz.viewer.sinks import open_sinks

        return open_sinks(
            save=self.save,
            spawn=self.spawn,
            serve=self.serve,
            bind=self.bind,
            web=self.web,
            connect=self.connect,
            stdout=self.stdout,
            on_message=tell,
        )

    def check(self) -> None:
        """Raise InputError for what cannot work: options that exclude each other, a file that cannot be written."""
        live = [name for name in ("spawn", "serve", "connect") if getattr(self, name)]
        if len(live) > 1:
            raise InputError(f"--{live[0]} and --{live[1]} exclude each other: pass one of them")
        if self.web:
            self._check_web()
        if self.stdout and (live or self.save):
            raise InputError(f"--stdout goes alone, without --{live[0] if live else 'save'}")
        if self.stdout and stdout_was_closed():
            raise InputError("--stdout: standard output is closed; redirect it to a file or a program")
        if self.stdout and sys.stdout.isatty():
            raise InputError("--stdout writes binary data: redirect it to a file or a program")
        if self.save is not None:
            _refuse_film(self.save)
            check_writable(self.save)
            check_recording(self.save)
            path_for_rerun(self.save)

    def tell_folder(self, quiet: bool) -> None:
        """Say so where the file goes into a folder that is to be made: its name may be a slip."""
        if self.save is not None and not quiet and (missing := missing_folders(self.save)):
            from pfslam_viz.console import tell

            tell(f"note: {missing[0]} is not there and will be made")

    def _check_web(self) -> None:
        from pfslam_viz.viewer.connections import LOOPBACK

        if not self.serve:
            raise InputError("--web goes with --serve: pass both")
        if self.bind not in LOOPBACK:
            raise InputError(f"--web serves this machine alone, and --bind {self.bind} others: leave --bind out")

    def check_screen(self) -> None:
        """Raise InputError where only a window could show it and none can be opened."""
        if self.spawn and self.save is None and not has_screen():
            raise InputError(
                "there is no screen to open the viewer on: pass --save out.rrd to write a recording, --serve or"
                " --connect URL to watch it elsewhere"
            )


FILMS = (".mp4", ".webm", ".gif", ".webp", ".mov", ".avi", ".mkv", ".png", ".jpg", ".jpeg")


def _refuse_film(path: Path) -> None:
    """Raise InputError for a file whose name promises a film or a picture: what is written is a Rerun recording."""
    if path.suffix.lower() in FILMS:
        recording = path.with_suffix(".rrd")
        raise InputError(
            f"--save {path}: a Rerun recording is written, no film or picture: pass --save {recording}, and then"
            f" pfslam-viz video {recording} {path}"
        )


def has_screen() -> bool:
    """Whether a window can be opened here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
