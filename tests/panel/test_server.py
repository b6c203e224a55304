"""The panel's server: access rights, refusals, and a page that does not read."""

import math
import socket
import time
from http.client import HTTPConnection
from types import SimpleNamespace

import msgspec
import pytest
from click.testing import CliRunner
from starlette.websockets import WebSocketDisconnect
from websockets.sync.client import connect

from astb.cli import commands
from astb.panel import runs as runs_module
from astb.panel.access import SEAT_KEPT, Access, kept_token
from astb.panel.answers import Parts
from astb.panel.stream import HEAD
from astb.panel.watch import BLIND, Status, first_out
from bench_protocol.clock import VirtualClock
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from tests.refusals import refuses


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
        assert "can only watch" in refused.json()["error"]
    assert viewer.post("/api/enter", json={"token": "guessed"}).status_code == 403
    assert not viewer.cookies
    assert door.orders == []


def test_the_cookie_is_for_no_script_and_for_no_other_page(client, parts):
    cookie = (
        client(command=False)
        .post("/api/enter", json={"token": parts.access.token})
        .headers["set-cookie"]
        .lower()
    )
    assert "httponly" in cookie
    assert "samesite=strict" in cookie


@pytest.mark.parametrize("host", ["rebound.example", "rebound.example:8137", "127.0.0.1.rebound.example", ""])
def test_a_name_that_is_not_this_machines_is_refused(client, host):
    """DNS rebinding: a third-party page whose name suddenly points here."""
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
    assert (refused.status_code, refused.json()["error"]) == (
        409,
        "another page commands the rig; take over first",
    )
    assert two.post("/api/estop").status_code == 200, "every viewer can stop"
    assert two.post("/api/seat").status_code == 200
    assert two.post("/api/run/resume").status_code == 200
    assert one.post("/api/run/resume").status_code == 409
    clock.sleep_until(clock.now() + round((SEAT_KEPT + 1) * NS))
    assert one.post("/api/run/stop").status_code == 200, "an unused seat is free"
    assert [order["do"] for order in door.orders] == ["hold", "safe", "resume", "stop"]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"plan": "nothing"}, "there is no plan 'nothing'"),
        ({"plan": "axial_stiffness", "set": {"nothing": "1"}}, "has no parameter nothing"),
        ({"plan": 3}, "is not a text"),
        ({"plan": "aw0", "set": [1]}, "is not a table"),
    ],
)
def test_an_impossible_start_is_reported_and_no_process_starts(client, body, words, monkeypatch):
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


def test_a_token_outlives_its_server_and_is_private(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    first = kept_token(tmp_path / "rig.toml")
    assert first == kept_token(tmp_path / "rig.toml") != kept_token(tmp_path / "other.toml")
    (path,) = (file for file in (tmp_path / "astb").iterdir() if file.read_text() == first)
    path.write_text("")  # a server that was killed in the midst of writing it
    assert len(kept_token(tmp_path / "rig.toml")) >= 32, "an empty one would be everybody's"
    with refuses(ValueError, "token"):
        Access("", 1, VirtualClock())
    files = list((tmp_path / "astb").iterdir())
    assert files
    assert all(file.stat().st_mode & 0o077 == 0 for file in files)


def wanted(parts: Parts, traces: int, span: float) -> str:
    names = [one.name for one in parts.watch.shown]
    one = {"signals": names, "span": span, "columns": 2000}
    return msgspec.json.encode({"traces": [{"id": k, **one} for k in range(traces)]}).decode()


@pytest.mark.slow
@pytest.mark.real_time
def test_a_page_that_does_not_read_loses_pictures_and_blocks_no_other(served, parts):
    """Only the sockets buffer; others get their pictures, which show the present moment."""
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
def test_invalid_requests_of_a_page_are_refused(served, parts):
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
        (("left.height", 2.0, 9120.0), "left height above its upper limit, at 91.2 mm"),
        (
            ("left.bellows_pressure", 1.0, -1100.0),
            "left bellows pressure below its lower limit, at -0.55 bar",
        ),
        (("lateral.force", 5.0, 20.0), "lateral force timeout limit"),
    ],
)
def test_the_first_tripped_limit_is_named(told, words):
    if isinstance(told, tuple):
        name, kind, value = told
        told = {"rig.tripped": TABLE.trip_number(name), "rig.tripped_kind": kind, "rig.tripped_value": value}
    assert first_out(SimpleNamespace(glimpse=lambda name: told.get(name, math.nan))) == words


def test_a_rig_in_virtual_time_has_no_panel(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('name = "v"\ntime = "virtual"\n[simulation]\n')
    told = CliRunner().invoke(commands, ["panel", "--rig", str(path)])
    assert "virtual time" in told.output


def test_only_the_page_is_served(client, parts):
    """Least of all what lies among the records: a page there would command as this one does."""
    (parts.out / "aw0").mkdir()
    (parts.out / "aw0" / "report.html").write_text("<script>fetch('/api/vent', {method: 'POST'})</script>")
    one = client(command=False)
    assert one.get("/page/main.js").status_code == 200
    for path in (
        "/records/aw0/report.html",
        "/page/../server.py",
        "/page/%2e%2e/server.py",
    ):
        assert one.get(path).status_code == 404


@pytest.mark.real_time
def test_no_request_is_read_without_end(served):
    """Nor one without a length."""
    port, _ = served
    connection = HTTPConnection("127.0.0.1", port, timeout=5)
    endless = (b"x" * 4096 for _ in range(64))
    connection.request("POST", "/api/enter", body=endless, encode_chunked=True)
    assert connection.getresponse().status == 413
    connection.close()


def test_an_unattended_status_is_not_reported_as_current(parts):
    watch = parts.watch
    watch._looks = watch.clock.now() - round(1.1 * BLIND * NS)
    assert "the panel has not read the rig for" in watch.present().link
    watch._looks = watch.clock.now()
    assert watch.present().link == ""


def test_a_watch_that_fails_in_an_unforeseen_way_says_so_and_looks_again(parts, monkeypatch):
    watch, looks = parts.watch, []

    def listen():
        looks.append(watch.status.link)
        return follows

    def failed():
        raise KeyError("a number that nobody knows")

    follows = SimpleNamespace(receiver=SimpleNamespace(), lost="", settings=SimpleNamespace(contacts=failed))
    follows.close = lambda: watch._end.wait(0.01)
    monkeypatch.setattr(watch, "_listen", listen)
    watch.start()
    deadline = time.monotonic() + 5
    while len(looks) < 3 and time.monotonic() < deadline:
        time.sleep(0.01)
    watch.close()
    assert "a number that nobody knows" in looks[2]
