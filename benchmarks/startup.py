"""How long the command line takes to answer.

python -m benchmarks startup
"""

import argparse
import subprocess
import sys
from statistics import median
from time import perf_counter

REPEATS = 11
COMMANDS = {
    "python -c pass": ["-c", "pass"],
    "import pfslam_viz": ["-c", "import pfslam_viz"],
    "pfslam-viz --help": ["-m", "pfslam_viz", "--help"],
    "pfslam-viz replay --help": ["-m", "pfslam_viz", "replay", "--help"],
}


def main(arguments: list[str]) -> None:
    """Print median and fastest of several starts of each."""
    argparse.ArgumentParser(prog="python -m benchmarks startup", description=__doc__).parse_args(arguments)
    print("| | median s | fastest s |", "| --- | ---: | ---: |", sep="\n")
    for name, command in COMMANDS.items():
        seconds = [_run(command) for _ in range(REPEATS)]
        print(f"| {name} | {median(seconds):.3f} | {min(seconds):.3f} |")


def _run(command: list[str]) -> float:
    started = perf_counter()
    subprocess.run([sys.executable, *command], check=True, stdout=subprocess.DEVNULL)
    return perf_counter() - started
