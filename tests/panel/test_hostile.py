"""Whatever is sent to the panel is answered, with the status that it deserves and without a traceback."""

import io
import logging
import os
import signal
import socket
import threading
from contextlib import suppress

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from starlette.routing import Route
from websockets.sync.client import connect

from astb.panel.access import _ALL, _EACH, _LONGEST, NotAllowed, Patience
from astb.panel.cli import _print_addresses
from astb.panel.connections import Server
from astb.panel.server import application
from bench_protocol.clock import VirtualClock
from bench_protocol.units import NS
from tests.panel.conftest import PanelProcess
from tests.refusals import refuses

JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=10,
)
KEYS = (
    "token",
    "plan",
    "set",
    "specimen",
    "operator",
    "answer",
    "to",
    "name",
    "values",
    "for",
    "traces",
    "id",
)
BODY = st.one_of(
    st.dictionaries(st.sampled_from(KEYS), JSON).map(msgspec.json.encode),
    st.binary(max_size=200),
    st.sampled_from(
        [
            b"[" * 20_000,
            b'{"token":' * 20_000,
            b'{"token":' + b"[" * 900 + b"]" * 900 + b"}",
            b'{"set":' + b'{"a":' * 50 + b"1" + b"}" * 50 + b"}",
            b'{"token":"\\ud800"}',
            b'{"token":"\xff"}',
            b'{"set":{"\\udcff":1}}',
            b'{"plan":"' + b"x" * 65_000 + b'"}',
            b"x" * 200_000,
            b'{"a":1e999,"b":' + b"9" * 5000 + b"}",
        ]
    ),
)


LONG = b"x" * 20_000


def posts(routes):
    for one in routes:
        if isinstance(one, Route) and "POST" in one.methods:
            yield one.path


def test_every_command_answers_hostile_bodies(client, parts, door):
    one = client()
    paths = list(posts(application(parts, host="127.0.0.1").routes))
    assert len(paths) > 10
    parts.runs.start = lambda *_, **__: None

    @settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    @given(st.sampled_from(paths), BODY)
    def answers(path, body):
        told = one.post(path, content=body)
        assert told.status_code in {200, 400, 403, 409, 413, 429}, (path, body[:60], told.text[:200])
        assert len(told.content) < 3000 and "Traceback" not in told.text
        if len(body) > 64 * 1024 and path != "/api/kept/note":  # which takes photos
            assert told.status_code in {413, 429}
        elif told.status_code == 200 and path == "/api/enter":
            assert parts.access.token in body.decode()

    parts.access._patience.wait = lambda client: 0.0
    answers()


def test_an_answer_does_not_repeat_all_that_was_sent(client, parts, door):
    one = client()
    parts.runs.start = lambda *_, **__: None
    parts.access._patience.wait = lambda client: 0.0
    body = LONG.join([b'{"plan":"', b'","name":"', b'","run":"', b'"}'])
    for path in posts(application(parts, host="127.0.0.1").routes):
        assert len(one.post(path, content=body).content) < 3000, path


@pytest.mark.parametrize("body", [b"[" * 20_000, b'{"token":' + b"[" * 900 + b"]" * 900 + b"}"])
def test_what_is_nested_too_deep_is_a_bad_request(client, body):
    told = client(command=False).post("/api/enter", content=body)
    assert told.status_code == 400


def test_every_view_answers_hostile_questions(client, parts):
    one = client()
    paths = [
        route.path
        for route in application(parts, host="127.0.0.1").routes
        if isinstance(route, Route) and "GET" in route.methods
    ]
    for path in paths:
        for question in ("", "?run=../../etc&of=../..&place=1e999&a=%ed%a0%80&name=%00"):
            told = one.get(path.replace("{", "").replace("}", "%00") + question)
            assert told.status_code in {200, 400, 404}, (path, question, told.text[:200])


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck), database=None)
@given(body=st.one_of(BODY, JSON.map(lambda one: msgspec.json.encode({"traces": one}))), text=st.booleans())
def test_every_message_of_a_page_is_answered(client, body, text):
    one = client(command=False)
    with one.websocket_connect("/api/stream?page=" + "x" * 300, headers={"Host": "localhost"}) as stream:
        stream.receive_text()
        if text:
            stream.send_text(body.decode("utf-8", "replace"))
        else:
            stream.send_bytes(body)
        stream.send_text("no JSON")
        closed = next(
            message for message in iter(stream.receive, None) if message["type"] == "websocket.close"
        )
        assert closed["code"] == (1008 if text else 1003) and len(closed["reason"].encode()) <= 123


def test_what_is_no_utf8_closes_a_page_and_fills_no_terminal(parts):
    received = io.StringIO()
    handler = logging.StreamHandler(received)
    logging.getLogger("uvicorn.error").addHandler(handler)
    listening = socket.create_server(("127.0.0.1", 0))
    server = Server(application(parts, host="127.0.0.1"), parts.access)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    try:
        with connect(f"ws://127.0.0.1:{listening.getsockname()[1]}/api/stream") as page:
            page.recv(5)
            with page.protocol_mutex:
                page.protocol.send_text(b"\xff\xfe" + os.urandom(8) + b"\xff")
                page.send_data()
            with refuses(Exception, "1007"):
                for _ in range(100):
                    page.recv(5)
    finally:
        server.should_exit = server.force_exit = True
        thread.join(10)
        listening.close()
        logging.getLogger("uvicorn.error").removeHandler(handler)
    assert "Traceback" not in received.getvalue()


def tries(patience, clock, client, seconds):
    """Try as fast as possible for so long; return how many tries had their turn, as one after the other and at once."""
    end, count = clock.now() + round(seconds * NS), 0
    while clock.now() < end:
        try:
            wait = patience.wait(client)
        except NotAllowed as error:
            assert error.status == 429
            wait = 0.01
        else:
            count += 1
        clock.sleep_until(clock.now() + round((wait + 1e-3) * NS))
    return count


def test_wrong_tokens_are_slowed_by_client_and_in_all():
    clock = VirtualClock()
    patience = Patience(clock)
    assert tries(patience, clock, "one", 60.0) <= 60.0 / _EACH[0] + _EACH[1] + 1
    clock, count = VirtualClock(), 0
    patience = Patience(clock)
    for number in range(20_000):  # each from another address, 2000 a second
        try:
            patience.wait(f"client {number}")
            count += 1
        except NotAllowed:
            pass
        clock.sleep_until(clock.now() + NS // 2000)
    assert count <= (10.0 + _LONGEST) / _ALL[0] + _ALL[1] + 1
    assert len(patience._due) <= 1025


def test_the_right_token_has_its_turn_within_seconds(client, parts):
    clock = VirtualClock()
    patience = Patience(clock)
    for _ in range(1000):
        with suppress(NotAllowed):
            patience.wait("one")
    asked = clock.now()
    while True:
        try:
            wait = patience.wait("one")
            break
        except NotAllowed:
            clock.sleep_until(clock.now() + NS // 10)
    assert (clock.now() - asked) / NS + wait <= _LONGEST + _EACH[0] + 0.1
    patience.forgive("one")
    assert patience.wait("one") == 0.0


def test_many_wrong_tokens_are_refused_and_do_not_stop_the_commander(client, parts, door):
    owner, stranger = client(), client(command=False)
    parts.access.wait = _impatient(parts.access)
    codes = [stranger.post("/api/enter", json={"token": str(n)}).status_code for n in range(60)]
    assert codes.count(403) <= _EACH[1] + _LONGEST / _EACH[0] + 1
    assert codes.count(429) == 60 - codes.count(403)
    stranger.cookies.set(parts.access.cookie, "guessed")
    assert stranger.post("/api/run/hold").status_code == 429
    assert owner.post("/api/run/hold").status_code == 200


def _impatient(access):
    async def wait(connection):
        access._patience.wait(connection.client.host)

    return wait


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.parametrize("how", [signal.SIGHUP, signal.SIGQUIT])
def test_a_panel_that_is_ended_unawares_says_so_and_leaves_no_socket(tmp_path, monkeypatch, how):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    before = signal.signal(
        signal.SIGHUP, signal.SIG_DFL
    )  # a suite under nohup would hand on that it is ignored
    panel = PanelProcess(tmp_path)
    signal.signal(signal.SIGHUP, before)
    assert list((tmp_path / "astb").glob("*.sock"))  # its rig is there
    panel.process.send_signal(how)
    text = panel.process.communicate(timeout=30)[0].decode()
    assert panel.process.returncode == 0
    assert text == f"astb: the panel was ended by {how.name}\n"
    assert not list((tmp_path / "astb").glob("*.sock"))


def test_the_printed_address_is_one_that_works(parts, capsys):
    from starlette.testclient import TestClient

    for names in ((), ("hall.example.org", "Bench")):
        _print_addresses("0.0.0.0", 8137, "token", names)
        printed = capsys.readouterr().out.split("to watch:")[1].split()[0]
        assert not names or "hall.example.org" in printed
        app = application(parts, host="0.0.0.0", names=names)
        for address in (printed, *(f"http://{name}:8137" for name in names)):
            assert TestClient(app, base_url=address).get("/api/rig").status_code == 200
    assert TestClient(app, base_url="http://elsewhere.example").get("/api/rig").status_code == 403
