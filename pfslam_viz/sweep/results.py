"""The folder of a sweep: results.csv, a row a cell, written as cells finish; traces; results.parquet at the end."""

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from pfslam_viz.errors import InputError
from pfslam_viz.files import check_writable, replaced
from pfslam_viz.outputs import check_sweep
from pfslam_viz.sweep.plan import Cell, setting_text
from pfslam_viz.sweep.row import LIBRARIES, NUMBERS, Row, columns
from pfslam_viz.sweep.trace import Trace, read_trace

TEXTS = ("code", *LIBRARIES, "error", "cell", "recording", "config")
TextRow = dict[str, str]


class Results:
    """The rows of a sweep in a folder, one for each cell that is done.

    Rows are appended and synced to the disk one by one, so that nothing that is done can be lost; what a killed run
    left of half a row is dropped.
    """

    def __init__(self, folder: Path, settings: Sequence[str]) -> None:
        """Read what is there. Raises InputError for a folder that cannot be written, or a results.csv of others."""
        self.folder, self.settings = folder, tuple(settings)
        self.csv, self.parquet = folder / "results.csv", folder / "results.parquet"
        check_writable(self.csv)
        check_sweep(folder)
        self.rows: list[TextRow] = _read(self.csv)
        self.columns = columns(self.settings)
        self._ready = False  # whether the file has these columns, and no row that is to be run anew

    def other_code(self, cells: Iterable[Cell], code: str) -> dict[str, int]:
        """How many of these cells are done with other code than ``code``, by its version."""
        ids = {cell.id for cell in cells}
        found: dict[str, int] = {}
        for row in self.rows:
            if row["cell"] in ids and not row["error"] and row["code"] != code:
                found[row["code"]] = found.get(row["code"], 0) + 1
        return found

    def start(self, cells: Sequence[Cell], code: str | None) -> list[Cell]:
        """Which of these cells are still to be run, the failed ones among them.

        Rows that they replace are left out: of a cell that failed, of another recording or configuration of the same
        name, of other code than ``code`` unless that is None. Rows of cells that are not among these stay, those of
        another study too, which differ in a setting that is not swept here.
        """
        wanted = {cell.id: cell for cell in cells}
        names = {_name(cell.key): cell for cell in cells}
        kept: dict[str, TextRow] = {}
        others: list[TextRow] = []
        for row in self.rows:
            if row["cell"] in wanted:
                if not row["error"] and code in (None, row["code"]):
                    kept[row["cell"]] = row | wanted[row["cell"]].key
            elif not self._replaced(row, names.get(_name({key: row.get(key, "") for key in cells[0].key}))):
                others.append(row)
        self.rows = [*others, *(kept[cell.id] for cell in cells if cell.id in kept)]
        own = [name for row in self.rows for name in row if name not in self.columns]
        at = self.columns.index("seed")
        self.columns[at:at] = dict.fromkeys(own)
        return [cell for cell in cells if cell.id not in kept]

    def add(self, cell: Cell, row: Row, trace: bytes = b"", error: str | None = None) -> None:
        """One more cell is done, or has failed with ``error``."""
        if trace:
            with replaced(self.trace_path(cell)) as temporary:
                temporary.write_bytes(trace)
        if not self._ready:
            self._write()
        text = _texts(row) | cell.key | {"cell": cell.id, "error": error or ""}
        self.rows.append(text)
        with self.csv.open("a", encoding="utf-8", newline="") as file:
            csv.DictWriter(file, self.columns, restval="", lineterminator="\n").writerow(text)
            file.flush()
            os.fsync(file.fileno())

    def finish(self, cells: Sequence[Cell]) -> None:
        """All are done: the rows in the sweep's order, and results.parquet."""
        order = {cell.id: k for k, cell in enumerate(cells)}
        self.rows.sort(key=lambda row: order.get(row["cell"], -1))
        self._write()
        self._write_parquet()

    def of(self, cells: Sequence[Cell]) -> list[TextRow]:
        """The rows of these cells, in their order, as far as they are done."""
        rows = {row["cell"]: row for row in self.rows}
        return [rows[cell.id] for cell in cells if cell.id in rows]

    def trace_path(self, cell: Cell) -> Path:
        """Where a cell's trace is kept."""
        return self.folder / "cells" / f"{cell.id}.npz"

    def trace(self, cell: Cell) -> Trace | None:
        """A cell's trace, where it is kept."""
        return read_trace(self.trace_path(cell))

    def _replaced(self, row: TextRow, cell: Cell | None) -> bool:
        """Whether ``cell``, which has the row's values in the columns of this sweep, has them in all others, too."""
        others = [name for name, value in row.items() if value and name not in columns(self.settings)]
        return cell is not None and all(setting_text(cell.variant.values, name) == row[name] for name in others)

    def _write(self) -> None:
        with replaced(self.csv) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, self.columns, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(self.rows)
        self._ready = True

    def _write_parquet(self) -> None:
        """The same rows; numbers as numbers, and settings too where all of their values are numbers."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.table({name: pa.array(_column(name, self.rows)) for name in self.columns})
        with replaced(self.parquet) as temporary:
            pq.write_table(table, temporary)


def number(text: str) -> float | None:
    """A cell of the table as a number; None where it is empty or none."""
    try:
        return float(text)
    except ValueError:
        return None


def _read(path: Path) -> list[TextRow]:
    if not path.exists():
        return []
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    whole = text[: text.rfind("\n") + 1]
    reader = csv.DictReader(whole.splitlines())
    rows = list(reader)
    needed = {"recording", "config", "seed", "cell", "code", "error"}
    if reader.fieldnames is not None and not needed <= set(reader.fieldnames):
        raise InputError(f"{path}: not the results of a sweep; choose another folder with --out")
    return [row for row in rows if None not in row and None not in row.values()]


def _name(key: Mapping[str, str]) -> tuple[tuple[str, str], ...]:
    return tuple(sorted(key.items()))


def _texts(row: Row) -> TextRow:
    """As the file has them: numbers as Python writes them, so that they read back the same."""
    return {name: "" if value is None else str(value) for name, value in row.items()}


def _column(name: str, rows: Sequence[TextRow]) -> list[str | float | int | None]:
    texts = [row.get(name, "") for row in rows]
    if name == "seed":
        return [int(text) for text in texts]
    values = [number(text) for text in texts]
    if name in NUMBERS or name == "cell_s":
        return list(values)
    if name not in TEXTS and all((value is None) == (text == "") for value, text in zip(values, texts, strict=True)):
        return list(values)
    return [text or None for text in texts]
