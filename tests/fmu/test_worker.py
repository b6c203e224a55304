"""Worker processes of FMUs: answers, refused requests, crashes, timeouts and logs."""

from collections.abc import Iterator
from itertools import count
from pathlib import Path

import pytest

from bench_sim.fmu.description import FmuError
from bench_sim.fmu.process import Worker
from tests.refusals import refuses


@pytest.fixture
def worker(tmp_path: Path) -> Iterator[Worker]:
    worker = Worker("some.fmu", "tests.fmu.echo_worker", tmp_path)
    yield worker
    worker.close()


def ask(worker: Worker, what: str, value: object = None, **given: object) -> object:
    options = {"timeout": 60.0, "where": lambda: "in doStep at 2 s"} | given
    return worker.request((what, value), **options)


def test_a_worker_answers_until_it_is_closed(worker: Worker) -> None:
    large = bytes(1 << 20)  # more than a pipe holds
    assert [ask(worker, "echo", one) for one in (1, large, "x")] == [1, large, "x"]
    assert ask(worker, "read") == "", "a library cannot read requests"
    worker.close()
    with pytest.raises((FmuError, ValueError)):
        ask(worker, "echo", 1)


@pytest.mark.parametrize(
    ("what", "value", "message"),
    [
        ("refuse", "status 3", "some.fmu doStep 2 s 3"),
        ("crash", None, "some.fmu (SIGSEGV) doStep 2 s"),
        ("exit", 7, "some.fmu 7 doStep 2 s"),
    ],
)
def test_a_failure_is_reported_with_its_call(worker: Worker, what: str, value: object, message: str) -> None:
    with refuses(FmuError, message):
        ask(worker, what, value)


def test_a_worker_without_progress_is_killed(worker: Worker) -> None:
    ask(worker, "echo", 1)
    with refuses(FmuError, "0.2 s doStep"):
        ask(worker, "hang", timeout=0.2)


def test_progress_extends_the_timeout(worker: Worker) -> None:
    steps = count()

    def progress() -> bytes:
        return bytes([min(next(steps), 5)])

    with refuses(FmuError, "progress 0.1 s"):
        ask(worker, "hang", timeout=0.1, progress=progress)
    assert next(steps) > 6


def test_a_failure_repeats_only_the_log_of_its_request(worker: Worker) -> None:
    ask(worker, "print", "old")
    with pytest.raises(FmuError) as failure:
        ask(worker, "crash")
    assert "old" not in str(failure.value)


def test_output_of_a_library_is_in_the_log(worker: Worker) -> None:
    ask(worker, "print", "valve 3 is stuck")
    assert worker.log_tail().endswith("valve 3 is stuck")
