"""Ranking, spread over seeds, and curves, on made-up numbers."""

import pytest

from pfslam_viz.errors import InputError
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.sweep.curves import as_number, panels
from pfslam_viz.sweep.plan import Block, Cell, Plan, make_plan
from pfslam_viz.sweep.results import TextRow
from pfslam_viz.sweep.summary import SAME, cells_of, check_column, cost, markdown, overview, rankings

ERRORS = {  # particles: rmse of the three seeds
    "10": (0.5, 0.9, 0.6),
    "100": (0.30, 0.35, 0.45),
    "1000": (0.2, 0.3, 0.1),
}


@pytest.fixture
def plan() -> Plan:
    return make_plan([("a", RecordingChoice("/a"))], [Block(("paper",), (("particles", tuple(ERRORS)),))], range(3))


def rows_of(cells: list[Cell]) -> list[TextRow]:
    return [
        {
            "cell": cell.id,
            "error": "",
            "position_rmse_m": str(ERRORS[str(cell.config.particles)][cell.seed]),
            "wall_thickness_m": "0.05",
        }
        for cell in cells
    ]


def test_best_first_with_median_and_range(plan: Plan) -> None:
    cells = plan.cells({"a": "1"})
    (found,) = rankings(plan, cells, rows_of(cells))
    assert found.by == "position_rmse_m"
    assert [line.variant.values.particles for line in found.lines] == [1000, 100, 10]
    ranges = [line.ranges["position_rmse_m"] for line in found.lines]
    assert [(r.median, r.min, r.max) for r in ranges] == [(0.2, 0.1, 0.3), (0.35, 0.3, 0.45), (0.6, 0.5, 0.9)]
    assert [line.same for line in found.lines] == [False, True, False]  # 0.3 is in both of the first two ranges
    head, body = cells_of(plan, found)
    assert head[:3] == ["", "particles", "rmse m"]
    assert body[1][:3] == [SAME, "100", "0.35 [0.3, 0.45]"]
    assert "| ≈ | 100 | 0.35 [0.3, 0.45] |" in markdown(plan, found)


def test_all_recordings_in_one_table() -> None:
    plan = make_plan(
        [("a", RecordingChoice("/a")), ("b", RecordingChoice("/b"))],
        [Block(("paper",), (("particles", tuple(ERRORS)),))],
        range(3),
    )  # fmt: skip
    cells = plan.cells({"a": "1", "b": "2"})
    rows = [row | {"cell_s": "90"} for row in rows_of(cells)]
    rows = [row for row, cell in zip(rows, cells, strict=True) if cell.recording == "a" or cell.config.particles < 1000]
    head, body = overview(plan, rankings(plan, cells, rows))
    assert head == ["particles", "a, rmse m", "b, rmse m"]
    assert body == [
        ["10", "0.6 [0.5, 0.9]", "0.6 [0.5, 0.9]"],
        ["100", "0.35 [0.3, 0.45] ≈", "0.35 [0.3, 0.45] *"],
        ["1000", "0.2 [0.1, 0.3] *", ""],
    ]
    assert cost(rows) == "15 runs, 0.38 core-hours"  # 15 x 90 s


def test_one_seed_has_no_spread_that_could_hide_a_difference(plan: Plan) -> None:
    cells = [cell for cell in plan.cells({"a": "1"}) if cell.seed == 0]
    rows = [row | {"position_rmse_m": "0.25"} for row in rows_of(cells)]
    (found,) = rankings(plan, cells, rows)
    assert not any(line.same for line in found.lines)


def test_failed_and_unmeasured_cells(plan: Plan) -> None:
    cells = plan.cells({"a": "1"})
    rows = rows_of(cells)
    rows[0] |= {"error": "out of memory", "position_rmse_m": ""}
    for row in rows[6:]:  # 1000 particles
        row["position_rmse_m"] = ""
    (found,) = rankings(plan, cells, rows)
    assert [line.variant.values.particles for line in found.lines] == [100, 10, 1000]
    assert [line.failed for line in found.lines] == [0, 1, 0]
    assert found.lines[1].ranges["position_rmse_m"].median == pytest.approx(0.75)
    assert cells_of(plan, found)[1][1][-1] == "2, 1 failed"


def test_larger_is_better_for_some(plan: Plan) -> None:
    cells = plan.cells({"a": "1"})
    rows: list[TextRow] = [
        {"cell": cell.id, "error": "", "scan_to_map_score": str(1.0 / cell.config.particles)} for cell in cells
    ]
    (found,) = rankings(plan, cells, rows, "scan_to_map_score")
    assert [line.variant.values.particles for line in found.lines] == [10, 100, 1000]


def test_without_truth_the_map_judges(plan: Plan) -> None:
    cells = plan.cells({"a": "1"})
    rows = [{name: value for name, value in row.items() if name != "position_rmse_m"} for row in rows_of(cells)]
    (found,) = rankings(plan, cells, rows)
    assert found.by == "wall_thickness_m"


def test_no_such_column() -> None:
    with pytest.raises(InputError, match="--by speed: no such column"):
        check_column("speed")


def test_curves_over_a_number_are_in_its_order_on_a_logarithmic_axis(plan: Plan) -> None:
    cells = plan.cells({"a": "1"})
    (found,) = rankings(plan, cells, rows_of(cells))
    (panel,) = panels(plan, found)
    assert (panel.setting, panel.log, panel.ticks) == ("particles", True, ((10, "10"), (100, "100"), (1000, "1000")))
    (curve,) = panel.curves
    assert [(p.position, p.median, sorted(p.values)) for p in curve.points] == [
        (10, 0.6, [0.5, 0.6, 0.9]),
        (100, 0.35, [0.30, 0.35, 0.45]),
        (1000, 0.2, [0.1, 0.2, 0.3]),
    ]


def test_other_settings_make_other_curves_and_blocks_keep_to_their_panels() -> None:
    grid = (("particles", ("10", "20")), ("resampling.policy", ("always", "n_eff")))
    blocks = [Block(("paper",), grid), Block(("paper",), (("map.cell", ("0.05", "0.07")), ("particles", ("10",))))]
    plan = make_plan([("a", RecordingChoice("/a"))], blocks, [0])
    cells = plan.cells({"a": "1"})
    rows: list[TextRow] = [{"cell": cell.id, "error": "", "position_rmse_m": "1.0"} for cell in cells]
    (found,) = rankings(plan, cells, rows)
    shapes = {
        panel.setting: {curve.label: [point.text for point in curve.points] for curve in panel.curves}
        for panel in panels(plan, found)
    }
    assert shapes == {
        "particles": {"policy always, cell 0.07": ["10", "20"], "policy n_eff, cell 0.07": ["10", "20"]},
        "resampling.policy": {
            "particles 10, cell 0.07": ["always", "n_eff"],
            "particles 20, cell 0.07": ["always", "n_eff"],
        },
        "map.cell": {"particles 10, policy always": ["0.05", "0.07"]},
    }


@pytest.mark.parametrize(
    ("text", "value"), [("0.5", 0.5), ("[0.1, 0.1, 0.1]", 0.1), ("[0.1, 0.2, 0.1]", None), ("always", None), ("", None)]
)
def test_places_on_an_axis(text: str, value: float | None) -> None:
    assert as_number(text) == value
