"""Run two configurations on one recording and print a table.

    python examples/compare_two_configs.py                             the demo, under paper and default
    python examples/compare_two_configs.py intel default my.toml       any recording and two configurations

The command ``pfslam-viz compare`` shows the same side by side in the viewer.
"""

import sys
from time import perf_counter

import numpy as np

import pfslam_viz as pf


def row(name: str, result: pf.Result, seconds: float) -> str:
    """One line of the table: error against the truth (if it is known), where the drive ends, and time."""
    error = "unknown"
    if result.truth is not None:
        error = f"{np.sqrt(((result.estimate - result.truth)[:, :2] ** 2).sum(axis=1).mean()):.3f} m"
    gap = np.hypot(*(result.estimate[-1] - result.estimate[0])[:2])
    return f"{name:20} {error:>10} {gap:>14.3f} m {1e3 * seconds / len(result.stamps):>9.2f} ms"


def compare(recording: pf.Recording, configs: tuple[str, str]) -> list[str]:
    """The table's lines."""
    lines = [f"{recording.name + f', {len(recording):,} scans':20} {'rmse':>10} {'end to start':>16} {'a scan':>12}"]
    for name in configs:
        started = perf_counter()
        result = pf.run(recording, pf.load_config(name, ["seed=1"]))
        lines.append(row(name, result, perf_counter() - started))
    return lines


def main(arguments: list[str]) -> None:
    """Read the recording and print the table."""
    name, first, second = [*arguments, *("demo", "paper", "default")[len(arguments) :]]
    print("\n".join(compare(pf.load_recording(name), (first, second))))


if __name__ == "__main__":
    main(sys.argv[1:])
