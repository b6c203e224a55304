"""Signals stop a run: the first its plan, the second its tear-down, and no further one keeps it from its result."""

import signal
import threading
from contextlib import contextmanager

import pytest

from bench_records.recorder import Recorder
from bench_records.result import Outcome, Result, read_result
from test_plans.execution import execute
from test_plans.interruptions import STOPPING, Interruptions
from test_plans.plan import Plan
from tests.plans.test_life_cycle import FakeBench


@pytest.fixture(params=STOPPING, ids=lambda number: number.name, autouse=True)
def stop(request):
    """Send a signal that stops a run to this process, which listens as `astb run` does."""
    before = signal.signal(request.param, signal.default_int_handler)
    yield lambda *_, **__: signal.raise_signal(request.param)
    signal.signal(request.param, before)


@contextmanager
def stopped_in(owner, name, stop, monkeypatch):
    """Send a signal at the beginning and at the end of each call of a method."""
    method = getattr(owner, name)

    def call(*given, **named):
        stop()
        found = method(*given, **named)
        stop()
        return found

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, call)
        yield


@pytest.mark.parametrize(
    ("owner", "name"),
    [(Recorder, "close"), (Result, "write"), (FakeBench, "read_file"), ("test_plans.execution", "air_left")],
    ids=lambda one: getattr(one, "__name__", one),
)
def test_the_third_signal_leaves_a_result_wherever_it_comes(stop, owner, name, tmp_path, monkeypatch):
    if isinstance(owner, str):
        import test_plans.execution as owner
    plan = Plan("fake", "Fake.", "Fake.", main=stop, setup=lambda run: None, teardown=stop)
    with pytest.raises(KeyboardInterrupt), stopped_in(owner, name, stop, monkeypatch):
        execute(plan, FakeBench(), tmp_path)
    result = read_result(tmp_path)
    assert result.verdict is Outcome.BLOCKED
    assert result.reason.startswith("stopped by the operator; then in tear-down: stopped by the operator")
    assert (tmp_path / "record.parquet").exists() and (tmp_path / "junit.xml").exists()


def test_a_signal_during_the_writing_of_the_result_is_handled_afterwards(stop, tmp_path, monkeypatch):
    def checks(run):
        run.check("x", 1.0, "1", high=2.0)

    plan = Plan("fake", "Fake.", "Fake.", main=checks, setup=lambda run: None, teardown=lambda run: None)
    with pytest.raises(KeyboardInterrupt), stopped_in(Result, "write", stop, monkeypatch):
        execute(plan, FakeBench(), tmp_path)
    assert read_result(tmp_path).verdict is Outcome.PASS


def test_a_signal_between_two_parts_stops_the_next_one(stop):
    ran = []
    with Interruptions() as stops:
        with stops.interruptible():
            ran.append("first")
        stop()
        stop()
        with pytest.raises(KeyboardInterrupt), stops.interruptible():
            ran.append("second")
        with stops.interruptible():  # both were one
            ran.append("third")
    assert ran == ["first", "third"]
    with pytest.raises(KeyboardInterrupt):
        stop()


def test_in_another_thread_signals_are_as_they_were(stop):
    def look():
        with Interruptions() as stops, stops.interruptible():
            found.append([signal.getsignal(number) for number in STOPPING])

    found, before = [], [signal.getsignal(number) for number in STOPPING]
    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert found == [before]
