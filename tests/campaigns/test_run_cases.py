"""Cases on workers of this machine: every one is a row, whatever becomes of it."""

import threading

import pytest

from astb.campaigns.core import carried_out
from astb.campaigns.kept import read_rows
from astb.campaigns.run import Standing, run_cases
from astb.campaigns.workers import ClusterError, cluster
from tests.campaigns import questions
from tests.refusals import refuses


@pytest.fixture(scope="module")
def client():
    with cluster(workers=2) as client:
        yield client


@pytest.mark.slow
def test_all_cases_become_rows_in_their_order(client, tmp_path):
    standings: list[Standing] = []
    cases = {f"case {n}": n for n in range(20)}
    rows = run_cases(
        questions.square,
        cases,
        tmp_path,
        facts=lambda n: {"number": n},
        client=client,
        watch=standings.append,
    )
    assert [(row["key"], row["number"], row["square"]) for row in rows] == [
        (k, n, n * n) for k, n in cases.items()
    ]
    assert all(row["error"] == "" and row["seconds"] >= 0 for row in rows)
    assert [one.done for one in standings] == list(range(21))
    assert standings[-1].left == standings[-1].failed == 0


@pytest.mark.slow
def test_what_is_kept_is_not_computed_again(client, tmp_path):
    some = {name: (str(tmp_path), name, 0.0) for name in "ab"}
    run_cases(questions.seen, some, tmp_path / "rows", client=client)
    rows = run_cases(
        questions.seen, some | {"c": (str(tmp_path), "c", 0.0)}, tmp_path / "rows", client=client
    )
    assert [row["name"] for row in rows] == ["a", "b", "c"]
    assert all((tmp_path / name).read_text() == "begun\n" for name in "abc")


@pytest.mark.slow
def test_a_case_that_fails_is_a_row_and_not_the_end(client, tmp_path):
    run_cases(questions.whatever, {"fine": "fine"}, tmp_path, client=client)
    asked = ["fine", "raise", "leave", "die", "linger", "text", "number", "renames", "unkept", "good"]
    rows = run_cases(questions.whatever, {what: what for what in asked}, tmp_path, client=client, limit=1.0)
    errors = {row["key"]: row["error"] for row in rows}
    assert errors["raise"].startswith("ValueError at questions.py:")
    assert errors["raise"].endswith("this case raises")
    assert "SystemExit" in errors["leave"]
    assert errors["die"] == "its worker process ended 2 times during this case"
    assert errors["linger"] == "stopped after its time limit of 1 s"
    assert "has other types than the rows before" in errors["text"]
    assert "cannot be stored in a table" in errors["unkept"]
    assert errors["number"].startswith("the case returned int")
    assert (errors["fine"], errors["renames"], errors["good"]) == ("", "", "")


@pytest.mark.slow
def test_those_that_failed_are_tried_again_when_that_is_asked_for(client, tmp_path):
    cases = {"x": "raise", "y": "fine"}
    run_cases(questions.whatever, cases, tmp_path, client=client)
    rows = run_cases(questions.whatever, {"x": "better", "y": "raise"}, tmp_path, client=client, again=True)
    assert [(row["length"], row["error"]) for row in rows] == [(6, ""), (4, "")]
    assert len(read_rows(tmp_path)) == 2


def test_what_cannot_be_sent_is_an_error_of_its_case(client):
    cases = {"there": threading.Lock(), "back": None, "neither": 1}
    errors = {one.key: one.error for one in carried_out(client, lambda one: one or threading.Lock(), cases)}
    assert errors["there"].startswith("the case cannot be sent: TypeError")
    assert "pickle" in errors["back"]
    assert errors["neither"] == ""


def test_an_unknown_scheduler_is_reported(monkeypatch):
    monkeypatch.setattr("astb.campaigns.workers.CONNECT", 0.5)
    with (
        refuses(ClusterError, "tcp://127.0.0.1:9"),
        cluster("tcp://127.0.0.1:9"),
    ):
        pass
