"""``pfslam-viz video``: a film or a picture of a recording, as Rerun's viewer shows it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pfslam_viz import console
from pfslam_viz.commands.interrupt import Interrupted, stop_on_interrupt
from pfslam_viz.errors import InputError
from pfslam_viz.files import check_writable
from pfslam_viz.outputs import check_film
from pfslam_viz.viewer import film
from pfslam_viz.viewer.film import LEAST_SIZE, MOST_SIZE, STILLS, Clock, Scene
from pfslam_viz.viewer.film_writers import ANIMATIONS, VIDEOS, has_h264


@dataclass(frozen=True, slots=True)
class FilmChoice:
    """``--from``, ``--to`` and ``--speed`` of a film, ``--step`` of a picture; None was not asked for."""

    first: int | None = None
    last: int | None = None
    speed: float | None = None
    step: int | None = None

    def require(self, still: bool) -> None:
        """Raise InputError for an option of the other kind."""
        options = {"--from": self.first, "--to": self.last, "--speed": self.speed, "--step": self.step}
        given = [name for name, value in options.items() if value is not None]
        wrong = [name for name in given if (name == "--step") != still]
        if wrong:
            kind, other = ("a picture", "a film") if still else ("a film", "a picture")
            raise InputError(f"{wrong[0]} is for {other}, and {kind} was asked for")


def run(recording: Path, out: Path, view: str, size: str, width: int | None, chosen: FilmChoice, quiet: bool) -> None:
    """Everything that can be wrong is checked before the viewer is started."""
    still = _is_still(out)
    chosen.require(still)
    scene = Scene(view, _parse_size(size), width)
    check_writable(out)
    check_film(out)
    with stop_on_interrupt() as stopped:

        def stop() -> None:
            if stopped():
                raise Interrupted(f"interrupted: {out} was not written")

        make = _still if still else _film
        said, complaints = make(recording, out, scene, chosen, stop, quiet)
    for complaint in complaints:
        console.tell(f"warning: the viewer complains: {complaint}")
    if not quiet:
        console.results().print(f"{out}: {said}, {out.stat().st_size / 1e6:.1f} MB", markup=False, soft_wrap=True)


def _still(
    recording: Path, out: Path, scene: Scene, chosen: FilmChoice, stop: Callable[[], None], quiet: bool
) -> tuple[str, list[str]]:
    """What was done, and what the viewer complains of."""
    clock = Clock.read(recording)
    first, last = int(clock.steps[0]), int(clock.steps[-1])
    step = last if chosen.step is None else chosen.step
    if not first <= step <= last:
        raise InputError(f"--step {step}: the recording has scans {first} to {last}")
    with console.status("photographing", quiet):
        complaints = film.still(recording, out, scene, step, stop)
    return f"scan {step:,}", complaints


def _film(
    recording: Path, out: Path, scene: Scene, chosen: FilmChoice, stop: Callable[[], None], quiet: bool
) -> tuple[str, list[str]]:
    clock = Clock.read(recording).span(chosen.first, chosen.last)
    speed = chosen.speed or clock.default_speed()
    steps = clock.pictured(speed, film.rate_of(out))
    if out.suffix.lower() == ".mp4" and not has_h264():
        console.tell(
            "note: without PyAV the .mp4 is MPEG-4 Part 2, large, and not for browsers; pip install"
            " 'pfslam-viz[film]' for H.264, or write .webm"
        )
    with console.progress("film", len(steps), quiet) as advance:

        def on_picture() -> None:
            advance()
            stop()

        complaints = film.film(recording, out, scene, steps, on_picture)
    said = f"{len(steps):,} pictures of scans {steps[0]:,} to {steps[-1]:,}, {speed:.3g} times as fast as the robot"
    return said, complaints


def _is_still(out: Path) -> bool:
    if out.suffix.lower() not in (*VIDEOS, *ANIMATIONS, *STILLS):
        films = ", ".join((*VIDEOS, *ANIMATIONS))
        raise InputError(f"{out}: unknown ending; a film has {films}, a picture {', '.join(STILLS)}")
    return out.suffix.lower() in STILLS


def _parse_size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise InputError(f"--size {text}: write WIDTHxHEIGHT in pixels, as 1280x720")
    size = int(width), int(height)
    if not all(low <= side <= high for low, side, high in zip(LEAST_SIZE, size, MOST_SIZE, strict=True)):
        least, most = (f"{width}x{height}" for width, height in (LEAST_SIZE, MOST_SIZE))
        raise InputError(f"--size {text}: from {least} to {most} is possible")
    return size
