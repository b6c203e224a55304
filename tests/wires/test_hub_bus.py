"""Our python-can plugin against servers that are busy, dead, dumb, or cut their words."""

import contextlib
import importlib.metadata
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import can
import pytest

from bench_protocol.frames import frame, join
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.servers import serve_in_thread
from drivers.can_port import PythonCanPort
from drivers.hub_bus import HubBus
from tests.refusals import refuses

HANDSHAKE = ((b"", b"< hi >"), (b"< open vcan0 >", b"< ok >"), (b"< rawmode >", b"< ok >"))


@contextlib.contextmanager
def scripted(*script: tuple[bytes, bytes], cut: int = 0, linger: bool = True) -> Iterator[int]:
    """A server for one client that waits for ``script``'s requests and sends its replies, ``cut`` bytes at a time."""
    listener = socket.create_server(("127.0.0.1", 0))
    listener.settimeout(5)
    done = threading.Event()

    def run() -> None:
        connection, _ = listener.accept()
        with connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.settimeout(2)
            for request, reply in script:
                got = b""
                while len(got) < len(request):
                    got += connection.recv(1)
                assert got == request
                step = cut or len(reply) or 1
                for start in range(0, len(reply), step):
                    connection.sendall(reply[start : start + step])
            if linger:
                done.wait(5)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield listener.getsockname()[1]
    finally:
        done.set()
        thread.join()
        listener.close()


@pytest.fixture
def hub_port() -> Iterator[int]:
    with serve_in_thread(CanHub(lambda block, peer: None)) as servers:
        yield servers.can_port


@pytest.mark.parametrize("cut", [0, 1, 7])
def test_frames_behind_the_last_ok_are_not_lost(cut: int) -> None:
    frames = b"< frame 123 1.5 1122 >< frame 124 1.6  >"
    *first, (request, reply) = HANDSHAKE
    with scripted(*first, (request, reply + frames), cut=cut) as port, HubBus(port=port) as bus:
        a, b = bus.recv(1), bus.recv(1)
        assert (a.arbitration_id, bytes(a.data), a.timestamp) == (0x123, b"\x11\x22", 1.5)
        assert (b.arbitration_id, bytes(b.data), b.is_extended_id) == (0x124, b"", False)
        assert bus.recv(0) is None


@pytest.mark.parametrize(
    ("script", "why"),
    [
        ([(b"", b"SSH-2.0-OpenSSH_9.2\r\n<no>")], "'< >' '< >'"),
        ([HANDSHAKE[0], (b"< open vcan0 >", b"< error this hub serves can7 >")], "can7"),
        ([HANDSHAKE[0]], "timed"),
    ],
)
def test_a_server_that_is_none_of_ours_is_named(script: list[tuple[bytes, bytes]], why: str) -> None:
    with scripted(*script) as port, refuses(can.CanInitializationError, why):
        HubBus(port=port, timeout=0.2)


def test_a_server_that_hangs_up_while_opening() -> None:
    with (
        scripted(HANDSHAKE[0], linger=False) as port,
        refuses(can.CanInitializationError),
    ):
        HubBus(port=port)


def test_a_refused_connection_fails_at_once(dead_port: int) -> None:
    start = time.monotonic()
    with pytest.raises(can.CanInitializationError, match=f"127.0.0.1:{dead_port}"):
        HubBus(port=dead_port)
    assert time.monotonic() - start < 0.5


def test_a_bus_name_that_cannot_be_is_refused(hub_port: int) -> None:
    with refuses(can.CanInitializationError, "CAN"):
        HubBus("no such > bus", port=hub_port)


def test_python_can_finds_the_plugin(hub_port: int) -> None:
    if "astb-hub" not in {each.name for each in importlib.metadata.entry_points(group="can.interface")}:
        pytest.skip("the project is not installed in this environment (pip install -e .)")
    options = {"interface": "astb-hub", "channel": "vcan0", "port": hub_port, "ignore_config": True}
    with can.Bus(**options) as a, can.Bus(**options) as b:
        a.send(can.Message(arbitration_id=0x77, data=b"plug", is_extended_id=False))
        assert bytes(b.recv(1).data) == b"plug"


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (can.Message(arbitration_id=0x123, is_remote_frame=True, dlc=4), "(RTR)"),
        (can.Message(arbitration_id=0x123, is_error_frame=True), "error"),
        (can.Message(arbitration_id=0x123, is_fd=True, data=bytes(12)), "CAN FD"),
    ],
)
def test_what_the_protocol_cannot_carry_is_refused(hub_port: int, message: can.Message, why: str) -> None:
    with HubBus(port=hub_port) as bus:
        with refuses(can.CanOperationError, why):
            bus.send(message)
        bus.send(can.Message(arbitration_id=0x123, data=b""))


def test_there_is_no_descriptor_to_wait_on(hub_port: int) -> None:
    with HubBus(port=hub_port) as bus, pytest.raises(NotImplementedError):
        bus.fileno()


def test_messages_and_blocks_come_from_one_queue(hub_port: int) -> None:
    with HubBus(port=hub_port) as a, HubBus(port=hub_port) as b:
        a.send_block(join([frame(number, bytes([number])) for number in range(10)]))
        assert [b.recv(1).arbitration_id for _ in range(4)] == [0, 1, 2, 3]
        assert b.recv_block(1)["id"].tolist() == [4, 5, 6, 7, 8, 9]


def test_filters_and_the_notifier_of_python_can_work(hub_port: int) -> None:
    with (
        HubBus(port=hub_port) as a,
        HubBus(port=hub_port, can_filters=[{"can_id": 5, "can_mask": 0x7FF}]) as b,
    ):
        reader = can.BufferedReader()
        notifier = can.Notifier(b, [reader], timeout=0.05)
        a.send_block(join([frame(number, b"") for number in range(10)]))
        message = reader.get_message(1.0)
        assert message is not None
        assert message.arbitration_id == 5
        assert reader.get_message(0.05) is None
        notifier.stop()


def test_error_frames_are_counted_and_refusals_logged(caplog: pytest.LogCaptureFixture) -> None:
    tail = b"< error 20000004 1.5 >< error you may not >< frame 123 1.5 1 >< frame 123 1.5 11 >"
    *first, (request, reply) = HANDSHAKE
    with scripted(*first, (request, reply + tail)) as port, HubBus(port=port) as bus:
        assert bytes(bus.recv(1).data) == b"\x11"
        assert (bus.error_frames, bus.bad_lines) == (1, 2)
    assert "refused a line: you may not" in caplog.text
    assert "is not pairs of hexadecimal digits" in caplog.text


def test_last_frames_of_a_dead_server_are_delivered_then_every_call_says_it() -> None:
    *first, (request, reply) = HANDSHAKE
    with scripted(*first, (request, reply + b"< frame 1 1.0 AA >"), linger=False) as port:
        bus = HubBus(port=port)
        assert bytes(bus.recv(1).data) == b"\xaa"
        for _ in range(2):
            with refuses(can.CanOperationError, "lost"):
                bus.recv(1)
        with refuses(can.CanOperationError, "lost"):
            bus.send(can.Message(arbitration_id=1))
        bus.shutdown()


def test_a_server_that_reads_no_data_does_not_block_the_sender(numbered) -> None:
    with scripted(*HANDSHAKE) as port, HubBus(port=port, timeout=0.2) as bus:
        start = time.monotonic()
        with refuses(can.CanOperationError, "frames"):
            for first in range(0, 1_000_000, 50_000):
                bus.send_block(numbered(50_000, first))
        assert time.monotonic() - start < 5


def test_closing_wakes_the_thread_that_waits(hub_port: int) -> None:
    bus = HubBus(port=hub_port)
    raised: list[BaseException] = []

    def wait() -> None:
        try:
            while True:
                bus.recv_block(None)
        except can.CanOperationError as error:
            raised.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    time.sleep(0.05)
    bus.shutdown()
    bus.shutdown()
    thread.join(1)
    assert not thread.is_alive()
    assert "closed" in str(raised[0])


HUB_PROCESS = """
import sys, threading
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.servers import serve_in_thread
servers = serve_in_thread(CanHub(lambda block, peer: None))
print(servers.can_port, flush=True)
threading.Event().wait()
"""


def test_a_killed_hub_is_known_within_50_ms() -> None:
    process = subprocess.Popen([sys.executable, "-c", HUB_PROCESS], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        port = PythonCanPort(HubBus(port=int(process.stdout.readline())))
        told = threading.Event()
        reasons: list[str] = []

        def lost(reason: str) -> None:
            reasons.append(f"{time.monotonic():.6f} {reason}")
            told.set()

        port.on_lost(lost)
        time.sleep(0.05)
        assert not reasons
        start = time.monotonic()
        os.kill(process.pid, signal.SIGKILL)
        assert told.wait(2)
        when, reason = reasons[0].split(" ", 1)
        assert float(when) - start < 0.050
        assert "is lost" in reason
        port.close()
        assert len(reasons) == 1
    finally:
        process.kill()
        process.communicate()
