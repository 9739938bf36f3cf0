"""Pictures of every tab, to look at all of them at once: docs/images/sheet-*.webp.

    python -m benchmarks contact-sheet --data DIR

Replays the demo, twin21, intel and twin21 under two configurations, opens each in Rerun's viewer without a window, once
1280 and once 1600 pixels wide, and puts its tabs into one picture for each. Recordings that DIR does not hold are left
out.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.case import ROOT
from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.viewer.headless import headless_viewer

Picture = NDArray[np.uint8]

SIZES = ((1280, 720), (1600, 900))
MENU_BAR = 36  # pixels at the top that belong to the viewer
TILE = 800  # pixels of the sheet that each picture is wide
COLUMNS, MARGIN, TITLE = 2, 8, 26  # of pictures; pixels around each, and above it for its name
MOST_BYTES = 500_000
QUALITIES = (80, 70, 60, 50, 40, 30)  # the best that is small enough is taken


@dataclass(frozen=True)
class Sheet:
    """A recording to photograph: how it is made, ``folder`` in --data being where it lies ("" for the demo)."""

    name: str
    command: tuple[str, ...]
    folder: str = ""


SHEETS = (
    Sheet("demo", ("replay", "demo")),
    Sheet("twin21", ("replay", "21", "--config", "default"), "twin21"),
    Sheet("intel", ("replay", "intel", "--config", "default"), "carmen"),
    Sheet("comparison", ("compare", "21", "--config", "default", "--config", "paper"), "twin21"),
)
SHOTS: tuple[tuple[str, float], ...] = (
    ("Compare", 0.1),
    ("Compare", 0.5),
    ("Compare", 1.0),
    ("Filter", 0.5),
    ("Error", 0.5),
    ("Error", 1.0),
    ("Texture", 0.5),
    ("3-D", 0.5),
    ("3-D", 1.0),
    ("About", 1.0),
)
"""Tabs, and where in the recording; those that a recording does not have are left out."""


def main(arguments: list[str]) -> None:
    """Make the sheets that the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks contact-sheet", description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=None, help="folder of the folders twin21 and carmen")
    parser.add_argument("--only", nargs="+", choices=[s.name for s in SHEETS], default=[s.name for s in SHEETS])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images")
    parser.add_argument("--keep", type=Path, default=None, help="folder for the recordings and the single pictures")
    given = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for sheet in (s for s in SHEETS if s.name in given.only):
            try:
                make(sheet, given.data, folder, given.out)
            except PfslamError as error:
                sys.exit(str(error))


def make(sheet: Sheet, data: Path | None, folder: Path, out: Path) -> None:
    """Record it, if ``folder`` does not hold it, and write its sheets; says what is left out, and what views report."""
    recorded, command = folder / f"{sheet.name}.rrd", list(sheet.command)
    if sheet.folder:
        if data is None or not (data / sheet.folder).is_dir():
            print(f"{sheet.name}: left out, there is no folder {sheet.folder} in --data")
            return
        command += ["--data", str(data / sheet.folder)]
    if not recorded.is_file():
        run = [sys.executable, "-m", "pfslam_viz", *command, "--quiet", "--save", str(recorded)]
        subprocess.run(run, cwd=ROOT, check=True)
    for size in SIZES:
        shots = photograph(recorded, size)
        for name, shot in shots:
            path = folder / f"{sheet.name}-{size[0]}" / f"{name.replace(' ', '-')}.png"
            path.parent.mkdir(exist_ok=True)
            cv2.imwrite(str(path), shot)
        path = out / f"sheet-{sheet.name}-{size[0]}.webp"
        written = write_small(tiled(shots), path)
        print(f"{path}: {len(shots)} pictures, {written / 1e3:.0f} kB")


def photograph(recorded: Path, size: tuple[int, int]) -> list[tuple[str, Picture]]:
    """What the tabs show, each with a name."""
    shots = []
    with tempfile.TemporaryDirectory() as temporary, headless_viewer(size) as viewer:
        path = Path(temporary) / "shot.png"
        viewer.open(recorded)
        last = viewer.last_step()
        for tab, share in SHOTS:
            try:
                viewer.show_tab(tab)
            except InputError:
                continue
            step = round(share * last)
            viewer.seek(step)
            viewer.photograph(path)
            shots.append((f"{tab} {step}", np.asarray(cv2.imread(str(path)), np.uint8)[MENU_BAR:]))
            for report in viewer.reports():
                print(f"{recorded.name}, {tab}, step {step}: {report}")
    return shots


def tiled(shots: Sequence[tuple[str, Picture]]) -> Picture:
    """The pictures in rows, reduced, each below its name."""
    height = round(TILE * shots[0][1].shape[0] / shots[0][1].shape[1])
    rows = -(-len(shots) // COLUMNS)
    wide, high = TILE + 2 * MARGIN, height + TITLE + MARGIN
    sheet = np.full((rows * high, COLUMNS * wide, 3), 255, np.uint8)
    for k, (name, shot) in enumerate(shots):
        top, left = k // COLUMNS * high, k % COLUMNS * wide + MARGIN
        cv2.putText(sheet, name, (left, top + TITLE - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 1, cv2.LINE_AA)
        small = cv2.resize(shot, (TILE, height), interpolation=cv2.INTER_AREA)
        sheet[top + TITLE : top + TITLE + height, left : left + TILE] = small
    return sheet


def write_small(sheet: Picture, path: Path) -> int:
    """Write it as WebP of at most MOST_BYTES, as well as that allows; its bytes."""
    for quality in QUALITIES:
        encoded = np.asarray(cv2.imencode(".webp", sheet, [cv2.IMWRITE_WEBP_QUALITY, quality])[1])
        if len(encoded) <= MOST_BYTES:
            break
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encoded.tobytes())
    return len(encoded)
