"""Whether peak memory stays flat in the number of scans: a whole recording against its first quarter.

python -m benchmarks memory --recording intel --data DIR
"""

import argparse
from dataclasses import replace

from benchmarks.case import measure
from benchmarks.speed import add_case_options, case_of


def main(arguments: list[str]) -> None:
    """Print both peaks and their ratio, with a recording being written."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks memory", description=__doc__.splitlines()[0])
    add_case_options(parser)
    given = parser.parse_args(arguments)
    case = case_of(given)
    whole = measure(case)
    quarter = measure(replace(case, stop=whole["scans"] // 4))
    print(f"{case.recording}, {case.config}, with --save")
    for name, numbers in (("whole", whole), ("first quarter", quarter)):
        print(f"{name}: {numbers['scans']:,} scans, peak {numbers['peak_mb']:,.0f} MB, {numbers['seconds']:.1f} s")
    print(f"ratio {whole['peak_mb'] / quarter['peak_mb']:.2f}")
