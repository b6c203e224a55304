"""The panel's server by itself: who may see and command, what is refused, and a page that does not read."""

import math
import socket
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import uvicorn
from click.testing import CliRunner
from starlette.websockets import WebSocketDisconnect
from websockets.sync.client import connect

from astb.cli import commands
from astb.live.door import NoRun
from astb.panel import runs as runs_module
from astb.panel.access import SEAT_KEPT, Access, kept_token
from astb.panel.parts import Parts
from astb.panel.runs import Runs
from astb.panel.server import application
from astb.panel.stream import HEAD
from astb.panel.watch import Status, Watch, first_out
from astb.rig_file import RigFile, Simulation
from bench_protocol.clock import VirtualClock
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from drivers.errors import Refused

pytest.importorskip("httpx2", reason="starlette's test client needs httpx2, which `make` installs")
from starlette.testclient import TestClient

RIG = RigFile("test", simulation=Simulation())
TOKEN = "a token"


class Said:
    """In the place of a run's door: what it was told, and what it answers."""

    def __init__(self):
        self.orders, self.answer = [], {"done": ""}

    def __call__(self, path, order, within=0.0):
        self.orders.append(order)
        if self.answer is None:
            raise NoRun("nobody")
        return self.answer


@pytest.fixture
def door(monkeypatch) -> Said:
    said = Said()
    monkeypatch.setattr(runs_module, "knock", said)
    return said


@pytest.fixture
def clock() -> VirtualClock:
    clock = VirtualClock()
    clock.sleep_until(NS)
    return clock


@pytest.fixture
def parts(tmp_path, door, clock) -> Parts:
    watch = Watch(RIG, tmp_path / "rig.toml")  # and not started: nothing is connected
    watch.status = Status(link="", state="HOLD")
    return Parts(watch, Runs(watch, tmp_path), Access(TOKEN, 1, clock), tmp_path)


@pytest.fixture
def client(parts):
    """Make a browser: its requests, as those of one page of its own."""

    def made(page="one", *, command=True, host="127.0.0.1:8137") -> TestClient:
        app = application(parts, host="127.0.0.1")
        one = TestClient(app, base_url=f"http://{host}", headers={"X-ASTB-Page": page})
        if command:
            assert one.post("/api/enter", json={"token": TOKEN}).status_code == 200
        return one

    return made


def test_everybody_sees_and_only_the_token_commands(client, door):
    viewer = client(command=False)
    assert viewer.get("/").status_code == 200
    assert viewer.get("/api/rig").json()["name"] == "test"
    assert {plan["name"] for plan in viewer.get("/api/plans").json()["plans"]} >= {"aw0", "safety"}
    for path in (
        "run/start",
        "run/hold",
        "run/resume",
        "run/stop",
        "run/answer",
        "reset",
        "vent",
        "estop",
        "seat",
    ):
        refused = viewer.post(f"/api/{path}", json={})
        assert refused.status_code == 403, path
        assert "only watches" in refused.json()["error"]
    assert viewer.post("/api/enter", json={"token": "guessed"}).status_code == 403
    assert not viewer.cookies
    assert door.orders == []


def test_the_cookie_is_for_no_script_and_for_no_other_page(client):
    cookie = client(command=False).post("/api/enter", json={"token": TOKEN}).headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


@pytest.mark.parametrize("host", ["rebound.example", "rebound.example:8137", "127.0.0.1.rebound.example", ""])
def test_a_name_that_is_not_this_machines_is_refused(client, host):
    """DNS rebinding: a page of somebody else's whose name suddenly leads here."""
    told = client(command=False).get("/api/rig", headers={"Host": host})
    assert told.status_code == 403


@pytest.mark.parametrize("host", ["localhost:1", "127.0.0.1", "192.0.2.7:8137", "[::1]:8137"])
def test_this_machines_own_names_are_let_in(client, host):
    assert client(command=False).get("/api/rig", headers={"Host": host}).status_code == 200


def test_orders_of_another_page_are_refused(client, door):
    one = client()
    assert one.post("/api/run/hold", headers={"Origin": "http://elsewhere.example"}).status_code == 403
    with (
        pytest.raises(WebSocketDisconnect),
        one.websocket_connect("/api/stream", headers={"Origin": "http://elsewhere.example"}) as stream,
    ):
        stream.receive_text()
    assert one.post("/api/run/hold", headers={"Origin": "http://127.0.0.1:8137"}).status_code == 200
    assert [order["do"] for order in door.orders] == ["hold"]


def test_one_page_commands_at_a_time_and_everybody_with_the_token_stops(client, door, clock):
    one, two = client("one"), client("two")
    assert one.post("/api/run/hold").status_code == 200
    refused = two.post("/api/run/resume")
    assert (refused.status_code, refused.json()["error"]) == (409, "another page commands; take over first")
    assert two.post("/api/estop").status_code == 200, "whoever sees danger stops"
    assert two.post("/api/seat").status_code == 200
    assert two.post("/api/run/resume").status_code == 200
    assert one.post("/api/run/resume").status_code == 409
    clock.sleep_until(clock.now() + round((SEAT_KEPT + 1) * NS))
    assert one.post("/api/run/stop").status_code == 200, "a seat that nobody keeps is free"
    assert [order["do"] for order in door.orders] == ["hold", "safe", "resume", "stop"]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"plan": "nothing"}, "there is no plan 'nothing'"),
        ({"plan": "axial_stiffness", "set": {"nothing": "1"}}, "has no parameter nothing"),
        ({"plan": 3}, "is no text"),
        ({"plan": "aw0", "set": [1]}, "is no table"),
    ],
)
def test_what_cannot_be_started_is_said_and_nothing_starts(client, body, words, monkeypatch):
    monkeypatch.setattr(runs_module.subprocess, "Popen", None)
    told = client().post("/api/run/start", json=body)
    assert told.status_code in {400, 409}
    assert words in told.json()["error"]


def test_a_refused_value_has_the_words_of_the_command_line(client):
    plan, value = "dynamic_stiffness", "amplitude=1 km"
    command = CliRunner().invoke(commands, ["run", plan, "--set", value], standalone_mode=True)
    name, _, text = value.partition("=")
    told = client().post("/api/run/start", json={"plan": plan, "set": {name: text}}).json()["error"]
    assert told
    assert told in " ".join(command.output.split())


def test_a_run_that_does_not_answer_is_killed_by_a_stop(client, door, parts, monkeypatch):
    killed = []
    monkeypatch.setattr(runs_module.os, "kill", lambda pid, number: killed.append(pid))
    door.answer = None
    parts.watch.status = Status(link="", state="ACTIVE", pid=4711)
    assert "killed" in client().post("/api/estop").json()["done"]
    assert killed == [4711]


def test_a_stop_without_a_run_is_said_to_the_rig_itself(client, door, parts, monkeypatch):
    door.answer, acts = None, []
    monkeypatch.setattr(parts.watch, "act", acts.append)
    assert client().post("/api/estop").status_code == 200
    assert acts == ["action.disable"]

    def refused(name):
        raise Refused("no authority", 6)

    monkeypatch.setattr(parts.watch, "act", refused)
    told = client().post("/api/estop")
    assert told.status_code == 409
    assert "press the button on the rig" in told.json()["error"], "nobody believes that it was stopped"


def test_hands_are_off_while_a_run_commands(client, parts, monkeypatch):
    done = []
    monkeypatch.setattr(parts.watch, "act", done.append)
    monkeypatch.setattr(parts.watch, "write", done.append)
    parts.watch.status = Status(link="", state="ACTIVE", pid=1)
    one = client()
    assert one.post("/api/reset").status_code == one.post("/api/vent").status_code == 409
    parts.watch.status = Status(link="", state="FAULT_HOLD")
    assert one.post("/api/reset").status_code == one.post("/api/vent").status_code == 200
    assert done == ["action.reset", {"air.left_mode": "vent", "air.right_mode": "vent"}]


def test_a_token_outlives_its_server_and_is_its_users_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    first = kept_token(tmp_path / "rig.toml")
    assert first == kept_token(tmp_path / "rig.toml") != kept_token(tmp_path / "other.toml")
    files = list((tmp_path / "astb").iterdir())
    assert files
    assert all(file.stat().st_mode & 0o077 == 0 for file in files)


def fed(parts: Parts, end: threading.Event) -> None:
    """Let thirty signals come at 200 Hz."""
    tick = 0
    rows = np.arange(len(parts.watch.shown))
    while not end.wait(0.02):
        times = (tick + np.repeat(np.arange(4), rows.size)) * 5_000_000
        parts.watch.envelope.take(times, np.tile(rows, 4), np.full(times.size, float(tick), np.float32))
        tick += 4


@pytest.fixture
def served(parts):
    """The panel on a real socket, with thirty signals."""
    listening = socket.create_server(("127.0.0.1", 0))
    config = uvicorn.Config(
        application(parts, host="127.0.0.1"), log_level="error", ws_per_message_deflate=False, lifespan="off"
    )
    server, end = uvicorn.Server(config), threading.Event()
    threads = [
        threading.Thread(target=server.run, kwargs={"sockets": [listening]}),
        threading.Thread(target=fed, args=(parts, end)),
    ]
    for thread in threads:
        thread.start()
    yield listening.getsockname()[1], server
    end.set()
    server.should_exit = server.force_exit = True
    for thread in threads:
        thread.join(10)
    listening.close()


def wanted(parts: Parts, traces: int, span: float) -> str:
    names = [one.name for one in parts.watch.shown]
    one = {"signals": names, "span": span, "columns": 2000}
    return msgspec.json.encode({"traces": [{"id": k, **one} for k in range(traces)]}).decode()


@pytest.mark.real_time
def test_a_page_that_does_not_read_loses_pictures_and_keeps_nobody_waiting(served, parts):
    """What waits for it is what the sockets hold; others get their pictures; they tell of the present moment."""
    port, server = served
    with connect(f"ws://127.0.0.1:{port}/api/stream?page=deaf", max_queue=1, close_timeout=0.1) as deaf:
        deaf.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.send(wanted(parts, 12, 60.0))  # half a megabyte with each picture
        with connect(f"ws://127.0.0.1:{port}/api/stream?page=good") as good:
            good.send(wanted(parts, 1, 10.0))
            pictures, deadline = [], time.monotonic() + 1.5
            while time.monotonic() < deadline:
                told = good.recv(5)
                if isinstance(told, bytes):
                    pictures.append(HEAD.unpack_from(told))
        held = [one.transport.get_write_buffer_size() for one in server.server_state.connections]
        assert len(pictures) >= 15, "ten a second for who reads"
        assert max(held) < 2_000_000
        ends = [int(first) + count for _, _, count, _, first, _ in pictures]
        assert ends == sorted(ends)
        assert ends[-1] > ends[0] + 100, "and they go on with time"


@pytest.mark.real_time
def test_what_a_page_cannot_want_is_refused(served, parts):
    port, _ = served
    for text in (
        "nonsense",
        '{"traces":[{"id":1,"signals":["no.signal"],"span":10}]}',
        wanted(parts, 99, 10.0),
    ):
        with connect(f"ws://127.0.0.1:{port}/api/stream") as one:
            one.send(text)
            for _ in range(50):
                try:
                    one.recv(5)
                except Exception as error:
                    assert "1008" in str(error)
                    break
            else:
                raise AssertionError("nobody refused it")


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ({}, ""),
        ({"rig.tripped": 0.0}, ""),
        (("left.height", 2.0, 9120.0), "left height upper limit at 91.2 mm"),
        (("left.bellows_pressure", 1.0, -1100.0), "left bellows pressure lower limit at -0.55 bar"),
        (("lateral.force", 5.0, 20.0), "lateral force timeout limit"),
    ],
)
def test_the_first_limit_that_tripped_is_told_in_words(told, words):
    if isinstance(told, tuple):
        name, kind, value = told
        told = {"rig.tripped": TABLE.trip_number(name), "rig.tripped_kind": kind, "rig.tripped_value": value}
    assert first_out(SimpleNamespace(glimpse=lambda name: told.get(name, math.nan))) == words


def test_a_rig_in_virtual_time_has_no_panel(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('name = "v"\ntime = "virtual"\n[simulation]\n')
    told = CliRunner().invoke(commands, ["panel", "--rig", str(path)])
    assert "virtual time" in told.output


def test_what_the_panel_needs_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "uvicorn", None)
    told = CliRunner().invoke(commands, ["panel"])
    assert "pip install 'astb[panel]'" in told.output


def test_records_are_served_and_nothing_beside_them(client, parts):
    (parts.out / "aw0").mkdir()
    (parts.out / "aw0" / "report.html").write_text("<p>a report")
    Path(parts.out.parent / "secret").write_text("no")
    one = client(command=False)
    assert one.get("/records/aw0/report.html").text == "<p>a report"
    for path in (
        "/records/../secret",
        "/records/%2e%2e/secret",
        "/page/../server.py",
        "/page/%2e%2e/server.py",
    ):
        assert one.get(path).status_code == 404
