"""Read a recording (.rrd) back as a table: N_eff and the error over time.

    python examples/read_recording.py demo.rrd              prints what the curves came to
    python examples/read_recording.py demo.rrd demo.csv     writes them besides

In a program, ``curves("demo.rrd").to_pandas()`` is a data frame with a row a scan.
"""

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
from pyarrow import csv
from rerun.chunk import RrdReader

SHOWN = ("n_eff", "error")  # see what there is with: RrdReader(path).store().schema().entity_paths()


def curves(path: str | Path, names: tuple[str, ...] = SHOWN) -> pa.Table:
    """The curves under ``/plots``, by scan: ``step``, ``seconds`` since the start, and a column for each curve.

    A recording of ``replay`` has ``n_eff/filter`` and, where the truth is known, ``error/filter`` (of the estimate at
    the time) and ``error/dead_reckoning``, both in m; one of ``compare`` has its runs' names instead of ``filter``, and
    N_eff as a share of the particles. Where a curve has no value the table is null.
    """
    seconds: dict[int, float] = {}
    values: dict[str, dict[int, float]] = {}
    for chunk in RrdReader(str(path)).stream().filter(content="/plots/**"):
        plot, _, curve = chunk.entity_path.removeprefix("/plots/").partition("/")
        rows = chunk.to_record_batch()
        if plot not in names or "/" in curve or not {"step", "Scalars:scalars"} <= set(rows.schema.names):
            continue
        steps = rows.column("step").to_pylist()
        since_start = rows.column("time").cast(pa.int64()).to_numpy() / 1e9
        seconds.update(zip(steps, since_start.tolist(), strict=True))
        scalars = zip(steps, rows.column("Scalars:scalars").to_pylist(), strict=True)  # a list a row; null where none
        values.setdefault(f"{plot}/{curve}", {}).update((step, row[0]) for step, row in scalars if row)
    order = sorted(seconds)
    table = {"step": order, "seconds": [seconds[step] for step in order]}
    return pa.table(table | {name: [found.get(step) for step in order] for name, found in sorted(values.items())})


def main(arguments: list[str]) -> None:
    """Print a line a curve, and write the table where a second path is given."""
    table = curves(arguments[0])
    print(f"{table.num_rows:,} scans in {table['seconds'][-1].as_py():.1f} s")
    for name in table.column_names[2:]:
        column = table[name].to_numpy()
        lowest, highest = int(np.nanargmin(column)), int(np.nanargmax(column))
        print(
            f"{name:22} median {np.nanmedian(column):8.3f}   lowest {column[lowest]:8.3f} at scan"
            f" {table['step'][lowest]}   highest {column[highest]:8.3f} at scan {table['step'][highest]}"
        )
    if len(arguments) > 1:
        csv.write_csv(table, arguments[1])


if __name__ == "__main__":
    main(sys.argv[1:])
