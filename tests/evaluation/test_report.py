"""Spread over seeds, the JSON and the table."""

import io
import json

import pytest
from rich.console import Console

from pfslam_viz.config import Config
from pfslam_viz.evaluation.report import Method, Report, Run


def report() -> Report:
    runs = (
        Run(3, {"truth": {"position_rmse_m": 0.1}, "map": {"revisit_error_m": None, "path_ratio": 1.0}}),
        Run(4, {"truth": {"position_rmse_m": 0.4}, "map": {"revisit_error_m": 0.05, "path_ratio": 1.0}}),
    )
    reckoned = Method("dead reckoning", None, (Run(None, {"truth": {"position_rmse_m": 1.5}}),))
    return Report("a [strange] name", "carmen", 10, 5.0, (reckoned, Method("mine", Config(), runs)))


def test_over_seeds() -> None:
    spread = report().methods[1].over_seeds("truth", "position_rmse_m")
    assert spread is not None
    assert spread.mean == pytest.approx(0.25) and (spread.min, spread.max) == (0.1, 0.4)
    known = report().methods[1].over_seeds("map", "revisit_error_m")
    assert known is not None and known.mean == 0.05
    assert report().methods[0].over_seeds("map", "path_ratio") is None


def test_json() -> None:
    parsed = json.loads(json.dumps(report().as_dict(), allow_nan=False))
    reckoned, mine = parsed["methods"]
    assert (reckoned["name"], reckoned["config"], reckoned["runs"][0]["seed"]) == ("dead reckoning", None, None)
    assert [run["seed"] for run in mine["runs"]] == [3, 4]
    assert mine["runs"][1]["truth"]["position_rmse_m"] == 0.4
    assert mine["over_seeds"]["truth"]["position_rmse_m"] == {"mean": 0.25, "min": 0.1, "max": 0.4}
    assert mine["over_seeds"]["map"]["revisit_error_m"]["max"] == 0.05
    assert mine["config"]["particles"] == Config().particles


def test_table() -> None:
    console = Console(width=120, file=io.StringIO())
    console.print(report().table())
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "a [strange] name: 10 scans, 5 s, 2 seeds" in text
    assert "0.250 [0.100, 0.400]" in text  # over the seeds
    assert "1.500" in text  # dead reckoning: one number
    assert "position rmse (m)" in text and "against relations" not in text
    assert "mean [smallest, largest] over the seeds" in text
