"""Cells on a real cluster of one worker."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import psutil
import pytest

from pfslam_viz.errors import InputError, PfslamError
from pfslam_viz.recordings.choice import RecordingChoice
from pfslam_viz.recordings.recording import Recording
from pfslam_viz.sweep import engine
from pfslam_viz.sweep.engine import open_cluster, run_cells
from pfslam_viz.sweep.plan import Cell, Plan
from pfslam_viz.sweep.version import code_version
from pfslam_viz.sweep.worker import Answer, fingerprint, receive

if TYPE_CHECKING:
    from distributed import Client


@pytest.fixture(scope="module")
def client() -> Iterator["Client"]:
    """Of a scheduler with one worker, reached by its address."""
    with open_cluster(None, 1) as local, open_cluster(address_of(local)) as client:
        yield client


def address_of(client: "Client") -> str:
    """The scheduler's."""
    address: str = client.scheduler_info()["address"]
    return address


@pytest.fixture
def cells(twelve: Plan, sweep_recording: Recording) -> list[Cell]:
    return twelve.cells({"drive": fingerprint(sweep_recording)})[:4]


def answers(client: "Client", cells: list[Cell], recording: Recording, place: RecordingChoice) -> list[Answer]:
    found: list[Answer] = []
    run_cells(
        client,
        cells,
        {"drive": place},
        {"drive": recording},
        {"drive": fingerprint(recording)},
        lambda cell, answer: found.append(answer),
    )
    return found


@pytest.mark.slow
def test_a_recording_that_the_worker_does_not_have_is_sent_once(
    client: "Client", cells: list[Cell], sweep_recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[Any] = []
    run = client.run

    def counted(function: Any, *arguments: Any, **options: Any) -> Any:
        sent.append(function)
        return run(function, *arguments, **options)

    monkeypatch.setattr(client, "run", counted)
    found = answers(client, cells, sweep_recording, RecordingChoice("/nowhere"))
    assert sorted(a.cell for a in found) == sorted(cell.id for cell in cells)
    assert all(a.error is None and a.row["position_rmse_m"] is not None for a in found)
    assert sent.count(receive) == 1


@pytest.mark.slow
@pytest.mark.parametrize("late", [False, True])
def test_a_worker_of_another_version_is_refused(
    client: "Client", cells: list[Cell], sweep_recording: Recording, monkeypatch: pytest.MonkeyPatch, late: bool
) -> None:
    """Also one that joins when the sweep has begun."""
    other = "0.0.9+00000000"
    monkeypatch.setattr(engine, "code_version", lambda: other)
    if late:
        monkeypatch.setattr(engine._Run, "check_workers", lambda self: None)
    said = rf"worker tcp://127\.0\.0\.1:\d+ has pfslam-viz {re.escape(code_version())}, and this is {re.escape(other)}"
    with pytest.raises(InputError, match=said):
        answers(client, cells, sweep_recording, RecordingChoice("/nowhere"))


@pytest.mark.slow
def test_a_scheduler_that_goes_away_ends_the_sweep(cells: list[Cell], sweep_recording: Recording) -> None:
    """What has been answered before is answered."""
    found: list[Answer] = []
    digest = fingerprint(sweep_recording)
    with open_cluster(None, 1) as local, open_cluster(address_of(local)) as client:

        def on_answer(cell: Cell, answer: Answer) -> None:
            found.append(answer)
            assert local.cluster is not None
            local.cluster.close(timeout=5)

        places, recordings = {"drive": RecordingChoice("/nowhere")}, {"drive": sweep_recording}
        with pytest.raises(PfslamError, match=r"^the scheduler went away$"):
            run_cells(client, cells * 5, places, recordings, {"drive": digest}, on_answer)
    assert found and found[0].error is None


@pytest.mark.slow
def test_nothing_listens_beyond_this_machine(client: "Client") -> None:
    assert address_of(client).startswith("tcp://127.0.0.1:")
    assert all(address.startswith("tcp://127.0.0.1:") for address in client.nthreads())
    assert set(client.nthreads().values()) == {1}
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    listening = [c.laddr for p in processes for c in p.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
    assert listening and {address.ip for address in listening} == {"127.0.0.1"}


def test_a_scheduler_that_is_not_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "CONNECT_SECONDS", 0.3)
    for address in ("tcp://127.0.0.1:1", "nonsense"):
        said = f"--scheduler {address}: no Dask scheduler answers"
        with pytest.raises(InputError, match=said) as caught, open_cluster(address):
            pass
        assert "\n" not in str(caught.value)
