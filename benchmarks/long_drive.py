"""How time, memory and the file grow with the length of a drive: its first eighth, quarter, half, and all of it.

pfslam-viz simulate DIR/campus --building campus --no-frames --scan-rate 12.5
python -m benchmarks long-drive --recording campus --data DIR --config paper
"""

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.case import load, measure
from benchmarks.speed import add_case_options, case_of
from pfslam_viz import geometry

PARTS = (8, 4, 2, 1)
GROWTH = 10.0  # hours that the last line foresees


def main(arguments: list[str]) -> None:
    """Print a markdown table, and what ten hours of such a drive would take."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks long-drive", description=__doc__.splitlines()[0])
    add_case_options(parser)
    case = case_of(parser.parse_args(arguments))
    recording, _ = load(case)
    lengths = [geometry.path_length(recording.select(0, len(recording) // part).dead_reckoning()) for part in PARTS]
    print(f"{case.recording}, {case.config}, with a file\n")
    print("| scans | m driven | s | ms a scan | peak MB | file MB |", "| ---: " * 6 + "|", sep="\n")
    rows = []
    for part, length in zip(PARTS, lengths, strict=True):
        numbers = measure(replace(case, stop=len(recording) // part))
        scans, seconds = numbers["scans"], numbers["seconds"]
        rows.append((scans, seconds, numbers["peak_mb"], numbers["file_mb"]))
        cells = f"{scans:,} | {length:,.0f} | {seconds:.1f} | {1e3 * seconds / scans:.2f}"
        print(f"| {cells} | {numbers['peak_mb']:,.0f} | {numbers['file_mb']:.1f} |", flush=True)
    scans = GROWTH * 3600.0 * len(recording) / recording.duration
    (n, seconds, memory, file), slopes = rows[-1], np.diff(np.array(rows[-2:]), axis=0)[0]
    slopes = slopes[1:] / slopes[0]  # of the second half, a scan
    times, memories, files = (
        last + slope * (scans - n) for last, slope in zip((seconds, memory, file), slopes, strict=True)
    )
    print(f"\nAs the second half grows, {GROWTH:g} hours ({scans:,.0f} scans) take {times / 3600:.1f} hours,", end=" ")
    print(f"{memories / 1e3:.1f} GB and a file of {files / 1e3:.1f} GB.")
