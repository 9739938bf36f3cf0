"""results.csv: appended row by row, read back, resumed."""

import csv
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.sweep.plan import Block, Cell, Plan, make_plan
from pfslam_viz.sweep.results import Results
from pfslam_viz.sweep.row import Row

ROW: Row = {"position_rmse_m": 0.1 + 0.2, "resamplings": 12, "code": "c1", "numpy": "2.4"}


@pytest.fixture
def cells(twelve: Plan) -> list[Cell]:
    return twelve.cells({"drive": "f1"})


def results(folder: Path, plan: Plan) -> Results:
    return Results(folder, plan.keys)


def lines(folder: Path) -> list[dict[str, str]]:
    with (folder / "results.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_row_is_on_the_disk_as_soon_as_it_is_added(twelve: Plan, cells: list[Cell], tmp_path: Path) -> None:
    kept = results(tmp_path, twelve)
    assert kept.start(cells, "c1") == cells
    assert not (tmp_path / "results.csv").exists()  # nothing is done yet
    kept.add(cells[4], ROW)
    (row,) = lines(tmp_path)
    first = {"recording": "drive", "config": "paper", "particles": "20", "resampling.policy": "n_eff", "seed": "1"}
    assert {name: row[name] for name in first} == first
    assert list(row)[:5] == list(first)
    assert float(row["position_rmse_m"]) == 0.1 + 0.2  # to the last bit
    assert (row["heading_rmse_deg"], row["error"], row["cell"]) == ("", "", cells[4].id)


def test_only_what_is_missing_or_failed_is_run_again(twelve: Plan, cells: list[Cell], tmp_path: Path) -> None:
    kept = results(tmp_path, twelve)
    kept.start(cells, "c1")
    kept.add(cells[0], ROW)
    kept.add(cells[1], {"code": "c1"}, error="lost, twice\nover")
    kept.add(cells[2], ROW)
    with (tmp_path / "results.csv").open("a") as file:
        file.write("drive,paper,20,n_")  # a run that was killed while it wrote
    again = results(tmp_path, twelve)
    assert again.start(cells, "c1") == [cells[1], *cells[3:]]
    for cell in reversed([cells[1], *cells[3:]]):
        again.add(cell, ROW)
    again.finish(cells)
    assert [row["cell"] for row in lines(tmp_path)] == [cell.id for cell in cells]
    assert results(tmp_path, twelve).start(cells, "c1") == []


def test_a_row_that_was_cut_in_its_last_column_is_none(twelve: Plan, cells: list[Cell], tmp_path: Path) -> None:
    kept = results(tmp_path, twelve)
    kept.start(cells, "c1")
    kept.add(cells[0], ROW)
    kept.add(cells[1], ROW)
    path = tmp_path / "results.csv"
    path.write_text(path.read_text()[:-4])
    assert [row["cell"] for row in results(tmp_path, twelve).rows] == [cells[0].id]


def test_rows_of_other_code_are_noticed(twelve: Plan, cells: list[Cell], tmp_path: Path) -> None:
    kept = results(tmp_path, twelve)
    kept.start(cells, "c1")
    kept.add(cells[0], ROW)
    kept.add(cells[1], ROW | {"code": "c2"})
    again = results(tmp_path, twelve)
    assert again.other_code(cells, "c2") == {"c1": 1}
    assert again.other_code(cells[1:], "c2") == {}
    assert again.start(cells, "c2") == [cells[0], *cells[2:]]
    assert results(tmp_path, twelve).start(cells, None) == cells[2:]  # kept, whatever made them


def test_another_recording_of_the_same_name_replaces_its_rows(twelve: Plan, cells: list[Cell], tmp_path: Path) -> None:
    kept = results(tmp_path, twelve)
    kept.start(cells, "c1")
    kept.add(cells[0], ROW)
    others = twelve.cells({"drive": "f2"})
    again = results(tmp_path, twelve)
    assert again.start(others, "c1") == others
    again.add(others[0], ROW)
    assert [row["cell"] for row in lines(tmp_path)] == [others[0].id]


def test_rows_of_other_cells_stay(twelve: Plan, cells: list[Cell], tmp_path: Path) -> None:
    kept = results(tmp_path, twelve)
    kept.start(cells[:6], "c1")
    for cell in cells[:6]:
        kept.add(cell, ROW)
    again = results(tmp_path, twelve)
    assert again.start(cells[6:], "c1") == cells[6:]
    again.add(cells[6], ROW)
    assert len(lines(tmp_path)) == 7
    assert [row["cell"] for row in again.of(cells[6:])] == [cells[6].id]


def test_rows_of_another_study_stay_where_it_sweeps_one_setting_more(
    twelve: Plan, cells: list[Cell], tmp_path: Path
) -> None:
    """Its values of the settings that both have may be the same, and only those it shares are this study's, too."""
    values = (("particles", ("20",)), ("resampling.policy", ("always",)), ("map.cell", ("0.07", "0.1")))
    study = make_plan(twelve.recordings, [Block(("paper",), values)], range(1))
    fine, coarse = study.cells({"drive": "f1"})
    kept = results(tmp_path, study)
    kept.start([fine, coarse], "c1")
    kept.add(fine, ROW)
    kept.add(coarse, ROW)
    again = results(tmp_path, twelve)
    assert cells[0].id == fine.id and again.start(cells, "c1") == cells[1:]
    assert {row["cell"] for row in again.rows} == {fine.id, coarse.id}
    changed = twelve.cells({"drive": "f2"})
    again = results(tmp_path, twelve)
    assert again.start(changed, "c1") == changed
    assert [row["cell"] for row in again.rows] == [coarse.id]  # the other one is run anew


def test_parquet_holds_numbers_as_numbers(twelve: Plan, cells: list[Cell], tmp_path: Path) -> None:
    kept = results(tmp_path, twelve)
    kept.start(cells, "c1")
    kept.add(cells[0], ROW)
    kept.finish(cells[:1])
    (row,) = pq.read_table(tmp_path / "results.parquet").to_pylist()
    assert (row["particles"], row["seed"], row["resampling.policy"]) == (20.0, 0, "always")
    assert row["position_rmse_m"] == 0.1 + 0.2 and row["heading_rmse_deg"] is None and row["error"] is None


def test_a_file_of_somebody_else_is_left_alone(twelve: Plan, tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="not the results of a sweep"):
        results(tmp_path, twelve)
    assert path.read_text() == "a,b\n1,2\n"
