"""The CAN hub on real sockets: order, bursts, foreign clients, slow clients, and how it opens and closes."""

import contextlib
import gc
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator

import can
import numpy as np
import pytest

from bench_protocol import socketcand
from bench_protocol.clock import wall_time_ns
from bench_protocol.frames import Block, empty_block, frame, join
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.servers import serve_in_thread
from drivers.hub_bus import HubBus
from tests.refusals import refuses


class Rig:
    """The rig of the hub: stores senders, frames and closed connections."""

    def __init__(self, **options: object) -> None:
        self.heard: list[tuple[Block, str]] = []
        self.lost: list[str] = []
        self.hub = CanHub(lambda block, peer: self.heard.append((block, peer)), self.lost.append, **options)

    @property
    def frames(self) -> Block:
        return join(block for block, _ in self.heard)


@contextlib.contextmanager
def serving(**options: object) -> Iterator[tuple[Rig, int]]:
    rig = Rig(**options)
    with serve_in_thread(rig.hub) as servers:
        assert servers.can_port is not None
        yield rig, servers.can_port


@pytest.fixture
def rig_and_port() -> Iterator[tuple[Rig, int]]:
    with serving() as pair:
        yield pair


@contextlib.contextmanager
def raw_client(port: int) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), timeout=2) as sock:
        yield sock


def joined(sock: socket.socket) -> None:
    """Bring a raw client into raw mode."""
    for request, reply in ((b"", b"< hi >"), (b"< open vcan0 >", b"< ok >"), (b"< rawmode >", b"< ok >")):
        sock.sendall(request)
        assert sock.recv(100) == reply


def collected(bus: HubBus, count: int) -> Block:
    parts: list[Block] = []
    while sum(map(len, parts)) < count:
        part = bus.recv_block(2.0)
        assert len(part), f"only {sum(map(len, parts))} of {count} frames came"
        parts.append(part)
    return join(parts)


def stock_client(port: int) -> can.BusABC:
    return can.Bus(
        interface="socketcand",
        channel="vcan0",
        host="127.0.0.1",
        port=port,
        tcp_tune=True,
        ignore_config=True,
    )


# --- the protocol ------------------------------------------------------------------------------------------------


def test_greeting_and_answers_come_as_packets_of_their_own(rig_and_port) -> None:
    with raw_client(rig_and_port[1]) as sock:
        assert sock.recv(1000) == b"< hi >"
        for request, reply in (
            (b"< open vcan0 >", b"< ok >"),
            (b"< echo >", b"< echo >"),
            (b"< rawmode >", b"< ok >"),
            (b"< bcmmode >", b"< ok >"),
        ):
            sock.sendall(request)
            assert sock.recv(1000) == reply


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (b"< open can7 >", b"this hub serves vcan0, not can7"),
        (b"< rawmode >", b"'rawmode' is not supported"),  # not before open
        (b"< send 123 1 1 >", b"after < open".replace(b"< ", b"")),
        (b"< isotpmode >", b"'isotpmode' is not supported"),
        (b"< send 123 9 1 >", b"the client sent a bad line: length 9"),
        (b"GET / HTTP/1.1\r\n<html>", b"'html' is not supported"),
    ],
)
def test_a_refusal_says_why_and_the_connection_lives_on(rig_and_port, request_: bytes, why: bytes) -> None:
    with raw_client(rig_and_port[1]) as sock:
        sock.recv(1000)
        sock.sendall(request_)
        reply = sock.recv(1000)
        assert reply.startswith(b"< error ")
        assert why in reply
        sock.sendall(b"< open vcan0 >")
        assert sock.recv(1000) == b"< ok >"


def test_who_sends_only_rubbish_is_sent_away(eventually) -> None:
    with serving(bad_lines_max=10) as (rig, port), raw_client(port) as sock:
        eventually(lambda: rig.hub.clients)
        with contextlib.suppress(ConnectionError):
            for _ in range(20):
                sock.sendall(b"< rubbish >")
        eventually(lambda: rig.lost, what="the end of the connection")


def test_frames_before_raw_mode_reach_only_subscribers(rig_and_port) -> None:
    rig, port = rig_and_port
    with raw_client(port) as sock:
        sock.recv(100)
        sock.sendall(b"< open vcan0 >")
        sock.recv(100)
        rig.hub.publish(frame(1, b"x"))
        assert not select.select([sock], [], [], 0.05)[0]


def test_too_many_clients_are_turned_away() -> None:
    with serving(clients_max=2) as (rig, port), raw_client(port) as a, raw_client(port) as b:
        assert a.recv(10) == b.recv(10) == b"< hi >"
        with raw_client(port) as c, contextlib.suppress(ConnectionError):
            assert c.recv(10) == b""
        assert len(rig.hub.clients) == 2
        assert rig.lost == []


@pytest.mark.parametrize("wanted", [True, False])
def test_the_beacon_is_received_only_on_request(wanted: bool) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(("", 42000))
        listener.settimeout(0.2)
        with serve_in_thread(Rig().hub, beacon=wanted) as servers:
            received = b""
            with contextlib.suppress(TimeoutError):
                while True:  # other hubs on this machine may announce themselves, too
                    received += listener.recv(1000)
        assert (f"can://127.0.0.1:{servers.can_port}<".encode() in received) == wanted


# --- frames --------------------------------------------------------------------------------------------------------


def test_frames_go_to_everybody_but_their_sender(rig_and_port, eventually) -> None:
    rig, port = rig_and_port
    with HubBus(port=port) as a, HubBus(port=port) as b:
        before = wall_time_ns()
        a.send_block(join([frame(0x10, b"one"), frame(0x12345678, b"", extended=True)]))
        got = collected(b, 2)
        after = wall_time_ns()
        assert got["id"].tolist() == [0x10, 0x12345678]
        assert got["extended"].tolist() == [0, 1]
        assert got["length"].tolist() == [3, 0]
        assert all(before - 1000 <= time <= after for time in got["time"]), "stamped at ingress"
        b.send_block(frame(0x11, b"two"))
        assert collected(a, 1)["id"].tolist() == [0x11], "and not its own"
        eventually(lambda: rig.frames["id"].tolist() == [0x10, 0x12345678, 0x11])
        assert len({peer for _, peer in rig.heard}) == 2


def test_an_answer_comes_before_what_was_sent_after_the_question(eventually) -> None:
    """Question and next frame in one packet: the rig's answer to the first stands between them on the bus."""
    received: list[int] = []

    def reply(block: Block, peer: str) -> None:
        received.extend(block["id"].tolist())
        hub.publish(frame(int(block["id"][0]) + 1, b"answer"))

    hub = CanHub(reply)
    with serve_in_thread(hub) as servers, HubBus(port=servers.can_port) as bus:
        with raw_client(servers.can_port) as sock:
            joined(sock)
            sock.sendall(b"< send 10 0 >< echo >< send 20 0 >")
            assert collected(bus, 4)["id"].tolist() == [0x10, 0x11, 0x20, 0x21]
        assert received == [0x10, 0x20]


def test_all_clients_see_one_order(rig_and_port, numbered) -> None:
    """Two senders and the rig at once: three listeners agree frame by frame."""
    rig, port = rig_and_port
    count = 1500
    with contextlib.ExitStack() as stack:
        senders = [stack.enter_context(HubBus(port=port)) for _ in range(2)]
        listeners = [stack.enter_context(HubBus(port=port)) for _ in range(3)]

        def chatter(send: Callable[[Block], None], start: int) -> None:
            for first in range(0, count, 10):
                send(numbered(10, start + first))

        threads = [
            threading.Thread(target=chatter, args=(send, 1_000_000 * (1 + which)))
            for which, send in enumerate([senders[0].send_block, senders[1].send_block, rig.hub.publish])
        ]
        for thread in threads:
            thread.start()
        seen = [collected(listener, 3 * count)["data"].tobytes() for listener in listeners]
        for thread in threads:
            thread.join()
    assert seen[0] == seen[1] == seen[2]
    values = np.frombuffer(seen[0], ">i8")
    for which in (1, 2, 3):
        mine = values[values // 1_000_000 == which] - 1_000_000 * which
        assert mine.tolist() == list(range(count)), "each sender's frames in its own order"


@pytest.mark.parametrize("foreign", [False, True], ids=["our client", "python-can's client"])
def test_a_burst_of_20_000_frames_from_the_rig(rig_and_port, numbered, numbers, foreign: bool) -> None:
    rig, port = rig_and_port
    count = 20_000
    if not foreign:
        with HubBus(port=port) as bus:
            rig.hub.publish(numbered(count))
            assert numbers(collected(bus, count)) == list(range(count))
    else:
        with stock_client(port) as bus:
            rig.hub.publish(numbered(count))
            got = [bus.recv(2.0) for _ in range(count)]
            assert [int.from_bytes(message.data, "big") for message in got] == list(range(count))
    assert rig.hub.dropped == 0


def test_a_burst_of_20_000_frames_from_a_client(rig_and_port, numbered, numbers, eventually) -> None:
    rig, port = rig_and_port
    count = 20_000
    with HubBus(port=port) as a, HubBus(port=port) as b:
        a.send_block(numbered(count))
        assert numbers(collected(b, count)) == list(range(count))
        eventually(lambda: len(rig.frames) == count)
        assert numbers(rig.frames) == list(range(count))


def test_a_flood_delays_only_its_senders(numbered, eventually) -> None:
    with serving(frames_per_second=4000.0) as (rig, port), contextlib.ExitStack() as stack:
        *floods, quiet = (stack.enter_context(HubBus(port=port)) for _ in range(3))
        for flood in floods:
            flood.send_block(numbered(1000))
        time.sleep(0.05)
        quiet.send_block(frame(0x42, b"quiet"))
        eventually(lambda: 0x42 in rig.frames["id"], within=0.2, what="the quiet client's frame")
        assert len(rig.frames) < 1700
        eventually(lambda: len(rig.frames) == 2001, what="all the others, in the end")


def test_publishing_without_subscribers_is_harmless(rig_and_port, numbered) -> None:
    rig, _ = rig_and_port
    rig.hub.publish(empty_block())
    rig.hub.publish(numbered(10))
    with refuses(TypeError, "frame"):
        rig.hub.publish(np.zeros(1))
    Rig().hub.publish(numbered(10))


def test_foreign_clients_receive_each_other(rig_and_port) -> None:
    _, port = rig_and_port
    with stock_client(port) as a, stock_client(port) as b, HubBus(port=port) as ours:
        a.send(can.Message(arbitration_id=0x123, data=b"\x01\xff", is_extended_id=False))
        b.send(can.Message(arbitration_id=0x1234567, data=b"", is_extended_id=True))
        first = b.recv(2.0)
        assert (first.arbitration_id, bytes(first.data), first.is_extended_id) == (0x123, b"\x01\xff", False)
        second = a.recv(2.0)
        assert (second.arbitration_id, bytes(second.data), second.is_extended_id) == (0x1234567, b"", True)
        assert collected(ours, 2)["id"].tolist() == [0x123, 0x1234567]


@contextlib.contextmanager
def busy(rig: Rig, numbered: Callable[..., Block]) -> Iterator[None]:
    """3330 numbered frames/s, 90 % of what fits on 500 kbit/s."""
    stop = threading.Event()

    def run() -> None:
        start, cycle = time.monotonic(), 0
        while not stop.is_set():
            rig.hub.publish(numbered(10, 10 * cycle))
            cycle += 1
            stop.wait(max(0.0, start + cycle * 0.003 - time.monotonic()))

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize("times", [25, pytest.param(100, marks=pytest.mark.slow)])
def test_opening_on_a_busy_bus_many_times(rig_and_port, numbered, numbers, times: int) -> None:
    rig, port = rig_and_port
    with busy(rig, numbered):
        for _ in range(times):
            with HubBus(port=port) as bus:
                got = numbers(collected(bus, 20))
                assert got == list(range(got[0], got[0] + len(got))), "no frame lost since the first"


@pytest.mark.slow
def test_python_cans_client_opens_on_a_busy_bus_100_times(rig_and_port, numbered) -> None:
    rig, port = rig_and_port
    with busy(rig, numbered):
        for _ in range(100):
            with stock_client(port) as bus:
                got = [int.from_bytes(bus.recv(2.0).data, "big") for _ in range(20)]
                assert got == list(range(got[0], got[0] + 20))


# --- slow and dead clients -------------------------------------------------------------------------------------------


def test_a_slow_client_loses_its_oldest_frames_then_its_connection(
    numbered, numbers, eventually, addresses
) -> None:
    with serving(queue_max=5000, slow_limit=0.3) as (rig, port), HubBus(port=port) as fast:
        with socket.socket() as slow:
            slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            slow.settimeout(2)
            slow.connect(("127.0.0.1", port))
            joined(slow)
            eventually(lambda: len(rig.hub.clients) == 2)
            sent = 0
            while not rig.hub.dropped:
                rig.hub.publish(numbered(1000, sent))
                assert numbers(collected(fast, 1000)) == list(range(sent, sent + 1000)), (
                    "the fast one loses nothing"
                )
                sent += 1000
                assert sent <= 200_000, "more than any socket buffer holds"
            name = f"can:127.0.0.1:{slow.getsockname()[1]}"
            eventually(lambda: addresses(rig.lost) == [name], what="the end of the slow connection")
        rig.hub.publish(numbered(10, sent))
        assert numbers(collected(fast, 10)) == list(range(sent, sent + 10))


def test_a_client_that_catches_up_has_lost_the_oldest_and_whole_frames_only(
    numbered, numbers, eventually
) -> None:
    with serving(queue_max=3000, slow_limit=30.0) as (rig, port), socket.socket() as slow:
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.settimeout(2)
        slow.connect(("127.0.0.1", port))
        joined(slow)
        sent = 0
        while not rig.hub.dropped:
            rig.hub.publish(numbered(1000, sent))
            sent += 1000
            time.sleep(0.001)
            assert sent <= 200_000
        time.sleep(0.1)
        parser, parts, got = socketcand.Parser(), [], 0
        while not got or numbers(parts[-1])[-1] != sent - 1:
            for event in parser.feed(slow.recv(1 << 16)):
                assert isinstance(event, socketcand.Received), event
                parts.append(event.block)
                got += len(event.block)
        values = numbers(join(parts))
        assert values == sorted(set(values)), "the received values are in order, without duplicates"
        assert got + rig.hub.dropped == sent, "and what did not come was counted"
        assert values[-3000:] == list(range(sent - 3000, sent)), "the newest are all there"
        assert rig.lost == []
        rig.hub.publish(frame(0x42, b"live"))
        assert b"< frame 042 " in slow.recv(1000)


def test_who_hangs_up_is_reported_once(rig_and_port, eventually, addresses) -> None:
    rig, port = rig_and_port
    with raw_client(port) as sock:
        joined(sock)
        name = f"can:127.0.0.1:{sock.getsockname()[1]}"
        assert addresses(rig.hub.clients) == [name]
    eventually(lambda: addresses(rig.lost) == [name])
    # A reset instead of a good-bye.
    with raw_client(port) as sock:
        joined(sock)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
    eventually(lambda: len(rig.lost) == 2)
    assert rig.hub.clients == ()


# --- opening and closing ---------------------------------------------------------------------------------------------


def test_stopping_leaves_no_threads(numbered) -> None:
    before = threading.active_count()
    rig = Rig()
    servers = serve_in_thread(rig.hub)
    port = servers.can_port
    with HubBus(port=port) as bus:
        rig.hub.publish(numbered(1000))
        start = time.monotonic()
        servers.stop()
        assert time.monotonic() - start < 1.0
        assert threading.active_count() == before
        with refuses(can.CanOperationError, "lost"):
            while True:
                bus.recv_block(1.0)
    assert len(rig.lost) == 1
    rig.hub.publish(numbered(10))
    servers.stop()
    # The port is free again at once.
    with serve_in_thread(Rig().hub, can_port=port) as again:
        assert again.can_port == port


def test_stopping_while_clients_connect_leaves_no_threads() -> None:
    """A socket that is forgotten half accepted would be reported by the garbage collector, which is an error here."""
    for _ in range(30):
        servers = serve_in_thread(Rig().hub)
        with contextlib.ExitStack() as stack:
            clients = [stack.enter_context(raw_client(servers.can_port)) for _ in range(5)]
            servers.stop()
            for sock in clients:
                with contextlib.suppress(ConnectionError):
                    assert sock.recv(100) in (b"< hi >", b"")
        assert not servers._thread.is_alive()
    gc.collect()


def test_a_port_in_use_is_reported(rig_and_port) -> None:
    _, port = rig_and_port
    with pytest.raises(OSError, match=f"CAN port {port} on 127.0.0.1 cannot be opened: .*in use"):
        serve_in_thread(Rig().hub, can_port=port)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.1", "::", "example.org"])
def test_the_network_is_open_only_on_purpose(host: str) -> None:
    with refuses(ValueError, "password"):
        serve_in_thread(Rig().hub, host=host)
