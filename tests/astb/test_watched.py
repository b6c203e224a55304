"""A run with its twin as seen by its plan: the story until now in real time, all of it in virtual time."""

import queue
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from astb import watched
from astb.watched import RunTwin
from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.units import NS
from bench_records.twin import Deviation, DeviationState, TwinStory, write_twin
from test_plans.plans.endurance import ASKED_EVERY, _wait_done
from test_plans.run import NoTwin


def story(until, *all_deviations):
    return TwinStory(
        "astb",
        until,
        (),
        tuple(Deviation(told, told, "left.height", 0.0, 0.0, 0.0) for told in all_deviations),
    )


def process(alive=True):
    return SimpleNamespace(poll=lambda: None if alive else 1, pid=0)


def test_in_real_time_it_says_what_is_known_and_what_is_withdrawn(tmp_path):
    twin = RunTwin(process(), tmp_path, RealClock())
    assert twin.watching and twin.deviation is None
    write_twin(tmp_path, story(10.0, 4.0, 9.0))
    assert twin.deviation.detected == 9.0
    write_twin(tmp_path, story(12.0))
    assert twin.deviation is None


def test_in_virtual_time_it_waits_until_the_twin_has_come(tmp_path, monkeypatch):
    clock = VirtualClock()
    twin = RunTwin(process(), tmp_path, clock)
    clock.sleep_until(60 * NS)
    write_twin(tmp_path, story(30.0))

    class Waits(RealClock):
        def sleep_until(self, _):
            write_twin(tmp_path, story(59.0, 55.0))

    monkeypatch.setattr(watched, "RealClock", Waits)
    assert twin.deviation.detected == 55.0


def test_in_virtual_time_it_does_not_wait_for_a_twin_that_is_gone(tmp_path):
    clock = VirtualClock()
    twin = RunTwin(process(alive=False), tmp_path, clock)
    clock.sleep_until(60 * NS)
    write_twin(tmp_path, story(30.0, 20.0))
    assert not twin.watching
    assert twin.deviation.detected == 20.0


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processor time is read from Linux' /proc")
@pytest.mark.parametrize(
    ("does", "ended"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSTOP)", True),
        ("import threading; threading.Event().wait()", True),
        ("import time\nwhile time.process_time() < 3.0: pass", False),
    ],
)
def test_a_twin_that_stands_still_does_not_hold_up_the_end_of_a_run(tmp_path, monkeypatch, does, ended):
    monkeypatch.setattr(watched, "_STILL", 2.0)
    monkeypatch.setattr(watched, "_QUIET", 0.5)
    clock, told = RealClock(), []
    with subprocess.Popen([sys.executable, "-c", does], stderr=subprocess.PIPE, text=True) as twin:
        news = watched._News(RunTwin(twin, tmp_path, clock), told.append)
        news.end()
        watched._conclude(twin, tmp_path, news, told.append)
        assert clock.now() < 60 * NS
        assert twin.returncode == (-9 if ended else 0)
    assert len(told) == 2, "why it takes long, and what became of it"
    assert (f"process {twin.pid}" in told[1]) == ended


def test_a_deviation_is_reported_while_the_run_lasts_and_again_when_its_kind_changes(tmp_path, monkeypatch):
    monkeypatch.setattr(watched, "_NEWS", 0.01)
    lines: queue.Queue[str] = queue.Queue()
    news = watched._News(RunTwin(process(), tmp_path, RealClock()), lines.put)

    def kept(word, sentence):
        found = Deviation(
            4.0, 3.0, "left.height", 0.0, 0.0, 0.0, sentence=sentence, course=(DeviationState(4.0, word),)
        )
        write_twin(tmp_path, TwinStory("astb", 10.0, (), (found,)))

    kept("told", "93 N below the model")
    assert lines.get(timeout=30) == "93 N below the model"
    kept("explained", "a leak of 0.5 mm²")
    assert lines.get(timeout=30) == "a leak of 0.5 mm²"
    news.end()
    news.report(RunTwin(process(), tmp_path, RealClock()).story(), final=True)
    assert lines.empty(), "nothing is reported twice"
    kept("explained", "a leak of 0.6 mm²")
    news.report(RunTwin(process(), tmp_path, RealClock()).story(), final=True)
    assert lines.get_nowait() == "a leak of 0.6 mm²"


class Generator:
    """Runs for so many s of a clock."""

    def __init__(self, lasts):
        self.now, self.lasts = 0.0, lasts

    def wait_done(self, within):
        from drivers.errors import BenchTimeout

        self.now += min(within, self.lasts - self.now)
        if self.now < self.lasts:
            raise BenchTimeout("the program runs")


@pytest.mark.parametrize(("ends", "parts_at"), [(True, 30.0), (True, 1e9), (False, 30.0)])
def test_cycles_end_at_a_deviation_only_if_requested(ends, parts_at):
    generator = Generator(100.0)
    parting = object()

    class Twin(NoTwin):
        @property
        def deviation(self):
            return parting if generator.now >= parts_at else None

    class Run:
        bench, twin = SimpleNamespace(generator=generator), Twin()

        @property
        def now(self):
            return round(generator.now * NS)

    told = _wait_done(Run(), 110.0, ends)
    if ends and parts_at < 100.0:
        assert told is parting
        assert parts_at <= generator.now <= parts_at + ASKED_EVERY
    else:
        assert told is None
        assert generator.now == 100.0
