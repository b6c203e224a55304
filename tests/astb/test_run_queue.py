"""Runs on one rig wait for each other in the order in which they came; the ticket of a dead process is void."""

import subprocess
import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest

from astb import run_queue
from astb.run_queue import Ticket, queue_path, queued

RIG = Path("hall.toml")
HOLDER = """
import sys
from pathlib import Path
from astb.run_queue import queued
with queued(Path("hall.toml"), ["aw0"], 100.0, "A. Miller", None):
    print("has it", flush=True)
    sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(run_queue, "_LOOK", 0.01)


def test_runs_take_the_rig_in_the_order_in_which_they_came():
    order: list[str] = []
    seen: dict[str, list[list[str]]] = {"second": [], "third": []}
    waiting = {name: threading.Event() for name in seen}

    def run(name: str) -> None:
        def keep(before: list[Ticket]) -> None:
            seen[name].append([one.by for one in before])
            waiting[name].set()

        with queued(RIG, ["aw0"], 60.0, name, keep):
            order.append(name)

    with ExitStack() as first:
        first.enter_context(queued(RIG, ["aw0"], 60.0, "first", None))
        threads = [threading.Thread(target=run, args=(name,)) for name in seen]
        for thread, event in zip(threads, waiting.values(), strict=True):
            thread.start()
            assert event.wait(10.0)
        assert order == []
    for thread in threads:
        thread.join(10.0)
    assert order == ["second", "third"]
    assert seen["second"] == [["first"]] and seen["third"][0] == ["first", "second"]
    assert not list(queue_path(RIG).glob("[0-9]*"))


def test_a_ticket_that_vanishes_while_others_look_is_no_ticket():
    with queued(RIG, ["aw0"], 60.0, "first", None):
        pass
    (queue_path(RIG) / "20000101T000000.000000-1").symlink_to("vanished")
    seen: list[list[Ticket]] = []
    with queued(RIG, ["aw0"], 60.0, "second", seen.append):
        assert seen == []


def test_a_killed_run_leaves_its_place():
    child = subprocess.Popen(
        [sys.executable, "-c", HOLDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None and child.stdout.readline() == "has it\n"
    waiting: list[Ticket] = []

    def kill(before: list[Ticket]) -> None:
        waiting.extend(before)
        child.kill()

    with queued(RIG, ["aw3"], 0.0, "B. Smith", kill):
        (holder,) = waiting
        assert (holder.by, holder.plans, holder.lasts) == ("A. Miller", ["aw0"], 100.0)
        assert "until about" in str(holder)
    child.communicate()


def test_a_run_without_wait_takes_a_place_and_does_not_wait():
    with (
        queued(RIG, ["aw0"], 0.0, "first", None),
        queued(RIG, ["aw0"], 0.0, "second", None),
        queued(Path("other.toml"), ["aw0"], 0.0, "third", pytest.fail),
    ):
        assert len(list(queue_path(RIG).glob("[0-9]*"))) == 2
