"""Third-party clients at the panel's port: with any number of them, the token holder stops the bench at once."""

import multiprocessing
import resource
import selectors
import socket
import time
from contextlib import ExitStack, closing, suppress
from functools import partial
from http.client import HTTPConnection

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from astb.panel import connections
from astb.panel.connections import STRANGERS, WATCHING_PAGES, Room
from tests.refusals import refuses

pytestmark = pytest.mark.real_time

WITHIN = 0.2  # s
CROWD = 1000
HALF_SENT = b"GET /api/rig HTTP/1.1\r\nHost: 127.0.0.1\r\n"
HALF_BODY = b"POST /api/enter HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 90\r\n\r\n{"
PAGE = (
    b"GET /api/stream HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
)
KINDS = {
    "idle pages": [PAGE],
    "half a request": [HALF_SENT],
    "half a body": [HALF_BODY],
    "silence": [b""],
    "all of it": [PAGE, HALF_SENT, HALF_BODY, b""],
}


def crowd(port, kinds, addresses, again, there):
    """Keep ``CROWD`` connections, from so many addresses; ``again`` reconnects the closed ones."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
    inside = selectors.DefaultSelector()

    def come(number):
        one = socket.socket()
        with suppress(OSError):
            one.bind((f"127.0.1.{1 + number % addresses}", 0))
            one.settimeout(5)
            one.connect(("127.0.0.1", port))
            one.sendall(kinds[number % len(kinds)])
            one.setblocking(False)
            return inside.register(one, selectors.EVENT_READ, number)
        one.close()

    for number in range(CROWD):
        come(number)
    there.set()
    end = time.monotonic() + 20
    while time.monotonic() < end:
        for key, _ in inside.select(0.1):
            data = b""
            with suppress(OSError):
                data = key.fileobj.recv(1 << 16)
            if not data:
                inside.unregister(key.fileobj)
                key.fileobj.close()
                if again:
                    come(key.data)


def stopped(access, connection):
    """Press STOP; return the status and how long the answer took, in s."""
    began = time.monotonic()
    headers = {"Cookie": f"{access.cookie}={access.token}"}
    connection.request("POST", "/api/estop", body="{}", headers=headers)
    answer = connection.getresponse()
    answer.read()
    return answer.status, time.monotonic() - began


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "again", "addresses"),
    [(kind, False, addresses) for kind, addresses in zip(KINDS, (1, 250, 1, 250, 250), strict=True)]
    + [("all of it", True, 1), ("all of it", True, 250)],
)
def test_a_thousand_strangers_do_not_delay_a_stop(served, parts, door, kind, again, addresses):
    """On the connection that a page keeps open; and, where the strangers do not reconnect, on a new one."""
    port, server = served
    page = HTTPConnection("127.0.0.1", port, timeout=5)
    assert stopped(parts.access, page)[0] == 200
    context = multiprocessing.get_context("spawn")
    there = context.Event()
    strangers = context.Process(target=crowd, args=(port, KINDS[kind], addresses, again, there), daemon=True)
    strangers.start()
    try:
        assert there.wait(30)
        stops = [stopped(parts.access, page) for _ in range(10)]
        if not again:
            time.sleep(1.0)
            for _ in range(10):
                with closing(HTTPConnection("127.0.0.1", port, timeout=5)) as fresh:
                    stops.append(stopped(parts.access, fresh))
        held = len(server.server_state.connections)
    finally:
        strangers.kill()
        strangers.join()
        page.close()
    assert {status for status, _ in stops} == {200}
    assert max(took for _, took in stops) < WITHIN
    assert held <= STRANGERS[0] + WATCHING_PAGES[0] + len(stops) + 1
    assert [order["do"] for order in door.orders] == ["safe"] * (len(stops) + 1)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.booleans(), st.integers(0, 30), st.sampled_from("abc"))),
    st.integers(1, 6),
    st.integers(1, 4),
)
def test_a_room_is_never_overfull_and_the_oldest_goes(moves, most, each):
    room, inside = Room(most, each), []  # (connection, address), the oldest first

    def dropped(one):
        same = [address for _, address in inside].count(one[1]) >= each
        assert one == next(other for other in inside if other[1] == one[1] or not same)
        inside.remove(one)

    for comes, number, address in moves:
        one = (number, address)
        if comes and one not in inside:
            room.enter(one, address, partial(dropped, one))
            inside.append(one)
        elif not comes:
            room.leave(one)
            inside[:] = [other for other in inside if other != one]
        assert len(inside) <= most
        of = [each_address for _, each_address in inside]
        assert all(of.count(name) <= each for name in "abc")
        assert all(room.full(name) == (len(inside) == most or of.count(name) == each) for name in "abc")


@pytest.mark.parametrize("sent", [b"", HALF_SENT, HALF_BODY])
def test_a_stranger_has_little_time_for_a_request(served, monkeypatch, sent):
    monkeypatch.setattr(connections, "REQUEST_WITHIN", 0.3)
    with socket.create_connection(("127.0.0.1", served[0]), timeout=2) as one:
        one.sendall(sent)
        with suppress(ConnectionResetError):
            assert one.recv(1000) == b""


def test_pages_without_the_token_have_few_places_and_say_so(served, parts):
    port, _ = served
    url, cookie = f"ws://127.0.0.1:{port}/api/stream", f"{parts.access.cookie}={parts.access.token}"
    with ExitStack() as pages:
        for _ in range(WATCHING_PAGES[1]):
            pages.enter_context(connect(url)).recv(5)
        with connect(url) as late, refuses(ConnectionClosed):
            late.recv(5)
        with connect(url, additional_headers={"Cookie": cookie}) as known:
            assert '"token":true' in known.recv(5)
    for _ in range(50):
        with connect(url) as again, suppress(ConnectionClosed):
            again.recv(5)
            return
        time.sleep(0.05)
    raise AssertionError("the places were not given free")
