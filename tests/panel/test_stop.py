"""Starting and stopping runs: one at a time, and a stop that waits for no run and ends it."""

import math
import threading
import time
from http.client import HTTPConnection
from types import SimpleNamespace

import pytest

from astb.live.door import Deaf
from astb.panel import runs as runs_module
from astb.panel import watch as watch_module
from astb.panel.runs import CannotDo
from astb.panel.watch import Status
from drivers.errors import Refused
from tests.refusals import refuses


def test_a_run_that_does_not_answer_is_killed_by_a_stop(client, door, parts, monkeypatch):
    killed = []
    monkeypatch.setattr(runs_module.os, "kill", lambda pid, number: killed.append(pid))
    door.answer = None
    parts.watch.status = Status(link="", state="ACTIVE", pid=4711)
    assert "killed" in client().post("/api/estop").json()["done"]
    assert killed == [4711]


def test_a_stop_without_a_run_goes_to_the_rig(client, door, parts, monkeypatch):
    door.answer, acts = None, []
    monkeypatch.setattr(parts.watch, "go_safe", lambda: acts.append("safe"))
    assert client().post("/api/estop").status_code == 200
    assert acts == ["safe"]

    def refused():
        raise Refused("no authority", 6)

    monkeypatch.setattr(parts.watch, "go_safe", refused)
    told = client().post("/api/estop")
    assert told.status_code == 409
    assert "the rig did not take its safe position" in told.json()["error"], "it is not reported as stopped"
    parts.watch.status = Status(link="", state="DISABLED", at_rest=True)
    assert "its state is DISABLED" in client().post("/api/estop").json()["done"], "there is no run to stop"
    parts.watch.status = Status(link="no word since 12 s", state="DISABLED", at_rest=True)
    assert client().post("/api/estop").status_code == 409, "what it said once may be so no more"


def test_a_stop_tells_who_when_and_since_when_the_springs_are_empty(client, door, parts, monkeypatch):
    air = {"left": 2.3e5, "right": 1.1e5}
    monkeypatch.setattr(
        parts.watch,
        "glimpses",
        lambda names: {one: air[one.partition(".")[0]] if "bellows" in one else math.nan for one in names},
    )
    page = client()
    assert page.post("/api/estop", json={"by": "A. Tester"}).status_code == 200
    assert door.orders[-1] == {"do": "safe", "by": "A. Tester"}
    told = parts.runs.state()["stopped"]
    assert (told["by"], told["empty"]) == ("A. Tester", None)
    air["left"] = 0.0
    assert parts.runs.state()["stopped"]["empty"] is None, "one of both still holds air"
    air["right"] = math.nan
    assert parts.runs.state()["stopped"]["empty"] is None, "an unread value is not empty"
    air["right"] = 0.1e5
    told = parts.runs.state()["stopped"]
    assert time.time() - 5 < told["at"] / 1000 <= told["empty"] / 1000 <= time.time()
    assert page.post("/api/estop").status_code == 200
    assert parts.runs.state()["stopped"]["by"] == "a user of the panel"


def test_a_stop_ends_a_run_that_receives_no_data(parts, monkeypatch):
    def deaf(*_, **__):
        raise Deaf("timed out")

    monkeypatch.setattr(watch_module, "knock", deaf)
    parts.watch.status = Status(link="", state="ACTIVE", pid=4711)
    assert parts.watch._run() == (None, 4711)


def test_a_rig_without_a_stop_offers_neither_stop_nor_start(client, door, parts):
    door.answer = None
    parts.watch.lacks_stop = "the wiring of hall has no action.disable and no sequence to rest"
    page = client()
    assert page.get("/api/rig").json()["lacks_stop"] == parts.watch.lacks_stop
    stop = page.post("/api/estop")
    assert stop.status_code == 409 and stop.json()["error"] == parts.watch.lacks_stop
    start = page.post("/api/run/start", json={"plan": "aw0"})
    assert start.status_code == 409 and parts.watch.lacks_stop in start.json()["error"]


class Process(SimpleNamespace):
    """Instead of a process that was started and runs until it is killed."""

    def poll(self):
        return self.code

    def kill(self):
        self.code = -9


def test_whoever_clicks_twice_starts_one_run(parts, monkeypatch):
    started, refused = [], []

    def popen(*_, **__):
        time.sleep(0.1)  # as a fork may take
        started.append(Process(code=None, pid=1))
        return started[-1]

    def start():
        try:
            parts.runs.start("aw0", {})
        except CannotDo as error:
            refused.append(str(error))

    monkeypatch.setattr(runs_module.subprocess, "Popen", popen)
    clicks = [threading.Thread(target=start) for _ in range(3)]
    for one in clicks:
        one.start()
    for one in clicks:
        one.join(10)
    assert (len(started), len(refused)) == (1, 2)


def test_a_stop_while_a_run_is_being_started_ends_it(parts, door, monkeypatch):
    """Before there is a process, the stop reaches the rig alone; the run would arm it again."""
    door.answer = None
    monkeypatch.setattr(parts.watch, "go_safe", lambda: None)
    started = []

    def popen(*_, **__):
        parts.runs.emergency_stop()
        started.append(Process(code=None, pid=1))
        return started[-1]

    monkeypatch.setattr(runs_module.subprocess, "Popen", popen)
    with refuses(CannotDo, "STOP"):
        parts.runs.start("aw0", {})
    assert started[0].code == -9


@pytest.mark.real_time
def test_a_stop_waits_for_no_other_order(served, parts, door, monkeypatch):
    """With any number of blocked orders and views: a socket of the rig without an answer takes seconds each."""
    port, _ = served
    free = threading.Event()
    monkeypatch.setattr(parts.runs, "order", lambda *_, **__: free.wait(10))
    monkeypatch.setattr("astb.panel.faults._order", lambda *_: free.wait(10))
    headers = {"X-ASTB-Page": "one", "Cookie": f"{parts.access.cookie}={parts.access.token}"}

    def ask(method, path):
        connection = HTTPConnection("127.0.0.1", port, timeout=3)
        connection.request(method, path, headers=headers)
        return connection

    hanging = [ask("POST", f"/api/run/{what}") for what in ("hold", "resume", "stop") for _ in range(5)]
    hanging += [ask("GET", "/api/faults") for _ in range(15)]
    stop = ask("POST", "/api/estop")
    assert stop.getresponse().status == 200
    assert "safe" in [order["do"] for order in door.orders]
    free.set()
    for one in (*hanging, stop):
        one.close()
