"""The Modbus/TCP server on real sockets: pipelines, pieces, rubbish, slow and half-open clients, foreign clients."""

import contextlib
import gc
import logging
import re
import shutil
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator

import pytest
from pymodbus.client import ModbusTcpClient

from bench_protocol.modbus import answer
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.servers import serve_in_thread


def request(transaction: int, function: int, *numbers: int, unit: int = 1) -> bytes:
    pdu = struct.pack(f">B{len(numbers)}H", function, *numbers)
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


@contextlib.contextmanager
def client(port: int) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), timeout=2) as sock:
        yield sock


def response(sock: socket.socket) -> tuple[int, bytes]:
    """Return the transaction and the PDU of the next response."""
    header = exactly(sock, 7)
    transaction, protocol, length, _ = struct.unpack(">HHHB", header)
    assert protocol == 0
    return transaction, exactly(sock, length - 1)


def exactly(sock: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        part = sock.recv(count - len(data))
        assert part, "the server closed the connection"
        data += part
    return data


def closed(sock: socket.socket) -> bool:
    with contextlib.suppress(ConnectionError):
        return sock.recv(1000) == b""
    return True


@contextlib.contextmanager
def serving(bank, **options) -> Iterator[tuple[int, list[str]]]:
    lost: list[str] = []
    server = ModbusTcpServer(lambda adu, peer: answer(adu, bank), lost.append, **options)
    with serve_in_thread(modbus_server=server) as servers:
        yield servers.modbus_port, lost


def test_pipelined_requests_are_all_answered_in_order(modbus_port: int) -> None:
    with client(modbus_port) as sock:
        sock.sendall(b"".join(request(number, 4, number, 2) for number in range(200)))
        for number in range(200):
            expected = struct.pack(">BBHH", 4, 4, 7 * number + 1, 7 * number + 8)
            assert response(sock) == (number, expected)


def test_a_request_may_come_byte_by_byte(modbus_port: int) -> None:
    with client(modbus_port) as sock:
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in request(9, 4, 10, 1) + request(10, 4, 11, 1):
            sock.send(bytes([byte]))
            time.sleep(0.001)
        assert response(sock) == (9, struct.pack(">BBH", 4, 2, 71))
        assert response(sock) == (10, struct.pack(">BBH", 4, 2, 78))


@pytest.mark.parametrize("rubbish", [b"GET / HTTP/1.1\r\n\r\n", bytes(100), b"\xff" * 300, b"\0\1\0\0\0\0\1"])
def test_rubbish_ends_the_connection_after_what_was_understood(modbus_port: int, rubbish: bytes) -> None:
    with client(modbus_port) as sock, client(modbus_port) as other:
        sock.sendall(request(1, 4, 0, 1) + rubbish)
        assert response(sock) == (1, b"\x04\x02\x00\x01")
        assert closed(sock)
        other.sendall(request(2, 4, 0, 1))
        assert response(other)[0] == 2


def test_the_exceptions_on_the_wire(modbus_port: int) -> None:
    with client(modbus_port) as sock:
        for number, (pdu, code) in enumerate(
            [
                ((0x63,), b"\xe3\x01"),
                ((4, 999, 2), b"\x84\x02"),
                ((4, 0, 126), b"\x84\x03"),
                ((5, 0, 1), b"\x85\x03"),
            ]
        ):
            sock.sendall(request(number, *pdu))
            assert response(sock) == (number, code)
        sock.sendall(request(5, 4, 0, 1, unit=17))
        assert response(sock) == (5, b"\x84\x0b")


def test_a_half_request_is_not_waited_for_for_ever(bank, eventually) -> None:
    with serving(bank, split_limit=0.1) as (port, lost), client(port) as sock, client(port) as patient:
        sock.sendall(request(1, 4, 0, 1)[:-1])
        start = time.monotonic()
        assert closed(sock)
        assert 0.05 < time.monotonic() - start < 1.0
        eventually(lambda: len(lost) == 1)
        patient.sendall(request(2, 4, 0, 1))
        assert response(patient)[0] == 2


def test_silence_ends_the_connection_in_the_end(bank, eventually, addresses) -> None:
    with serving(bank, idle_limit=0.15) as (port, lost), client(port) as sock:
        for number in range(5):  # each request starts the time afresh
            time.sleep(0.08)
            sock.sendall(request(number, 4, 0, 1))
            assert response(sock)[0] == number
        assert closed(sock)
        eventually(lambda: addresses(lost) == [f"modbus:127.0.0.1:{sock.getsockname()[1]}"])


def test_a_client_that_reads_no_answers_is_dropped(bank, eventually, addresses) -> None:
    with serving(bank, split_limit=0.3) as (port, lost), socket.socket() as greedy, client(port) as other:
        greedy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        greedy.settimeout(0.2)
        greedy.connect(("127.0.0.1", port))
        name = f"modbus:127.0.0.1:{greedy.getsockname()[1]}"
        flood = b"".join(request(number, 4, 0, 125) for number in range(500))
        slowest = 0.0
        with contextlib.suppress(TimeoutError, ConnectionError):
            for number in range(1000):
                greedy.sendall(flood)
                start = time.monotonic()
                other.sendall(request(number, 4, 0, 1))
                assert response(other)[0] == number
                slowest = max(slowest, time.monotonic() - start)
        eventually(lambda: addresses(lost) == [name], what="the end of the greedy client")
        assert slowest < 0.2, "one client's flood must not keep the others waiting"
        other.sendall(request(1, 4, 0, 1))
        assert response(other)[0] == 1


def test_a_flood_that_is_fetched_is_answered_to_the_last(modbus_port: int) -> None:
    count = 5000
    with client(modbus_port) as sock:
        flood = b"".join(request(number, 4, 0, 1) for number in range(count))
        sender = threading.Thread(target=sock.sendall, args=(flood,))
        sender.start()
        data = exactly(sock, 11 * count)
        sender.join()
    assert [int.from_bytes(data[11 * n : 11 * n + 2], "big") for n in range(count)] == list(range(count))


def test_a_fault_behind_the_server_is_exception_4_and_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    def fail(adu: bytes, peer: str) -> bytes:
        raise ZeroDivisionError("in the rig")

    with serve_in_thread(modbus_server=ModbusTcpServer(fail)) as servers, client(servers.modbus_port) as sock:
        with caplog.at_level(logging.ERROR, logger="asyncio"):
            sock.sendall(request(1, 4, 0, 1))
            assert response(sock) == (1, b"\x84\x04")
        assert "in the rig" in caplog.text


def test_no_answer_is_silence(bank) -> None:
    server = ModbusTcpServer(lambda adu, peer: None if adu[6] == 9 else answer(adu, bank))
    with serve_in_thread(modbus_server=server) as servers, client(servers.modbus_port) as sock:
        sock.sendall(request(1, 4, 0, 1, unit=9) + request(2, 4, 0, 1))
        assert response(sock)[0] == 2


def test_too_many_clients_are_turned_away(bank) -> None:
    with serving(bank, clients_max=2) as (port, lost), client(port) as a, client(port) as b:
        for sock in (a, b):
            sock.sendall(request(1, 4, 0, 1))
            response(sock)
        with client(port) as c:
            assert closed(c)
        assert lost == []


def test_a_port_in_use_is_reported(bank, modbus_port: int) -> None:
    with pytest.raises(OSError, match=f"Modbus port {modbus_port} on 127.0.0.1 cannot be opened"):
        serve_in_thread(modbus_server=ModbusTcpServer(lambda adu, peer: b""), modbus_port=modbus_port)


# --- foreign clients -------------------------------------------------------------------------------------------------


def test_eight_pymodbus_clients_at_once(bank, modbus_port: int) -> None:
    failures: list[object] = []

    def work(which: int) -> None:
        with ModbusTcpClient("127.0.0.1", port=modbus_port, timeout=2, retries=0) as device:
            for number in range(40):
                address = 10 * which
                device.write_registers(address, [which, number])
                back = device.read_holding_registers(address, count=2).registers
                if back != [which, number]:
                    failures.append((which, number, back))

    threads = [threading.Thread(target=work, args=(which,)) for which in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert [bank.holding[10 * which : 10 * which + 2] for which in range(8)] == [[w, 39] for w in range(8)]


needs_mbpoll = pytest.mark.skipif(
    not shutil.which("mbpoll"), reason="mbpoll is not installed (apt install mbpoll)"
)


def mbpoll(port: int, *arguments: str) -> str:
    command = [
        "mbpoll",
        "-m",
        "tcp",
        "-p",
        str(port),
        "-a",
        "1",
        "-0",
        "-1",
        "-o",
        "1",
        *arguments[:-1],
        "127.0.0.1",
    ]
    done = subprocess.run(
        command + arguments[-1].split(), capture_output=True, text=True, timeout=20, check=False
    )
    return done.stdout + done.stderr


def values_of(output: str) -> list[int]:
    return [int(value) for value in re.findall(r"^\[\d+\]:\s+(\d+)", output, re.MULTILINE)]


@needs_mbpoll
def test_mbpoll_reads_all_four_tables(bank, modbus_port: int) -> None:
    bank.coils[3], bank.holding[7] = True, 4711
    assert values_of(mbpoll(modbus_port, "-t", "0", "-r", "0", "-c", "5", "")) == [0, 0, 0, 1, 0]
    assert values_of(mbpoll(modbus_port, "-t", "1", "-r", "0", "-c", "5", "")) == [1, 0, 0, 1, 0]
    assert values_of(mbpoll(modbus_port, "-t", "3", "-r", "2", "-c", "3", "")) == [15, 22, 29]
    assert values_of(mbpoll(modbus_port, "-t", "4", "-r", "6", "-c", "3", "")) == [0, 4711, 0]


@needs_mbpoll
def test_mbpoll_writes(bank, modbus_port: int) -> None:
    mbpoll(modbus_port, "-t", "4", "-r", "20", "11 22 33")
    assert bank.holding[20:23] == [11, 22, 33]
    mbpoll(modbus_port, "-t", "0", "-r", "5", "1")
    assert bank.coils[5]


@needs_mbpoll
def test_mbpoll_understands_our_refusals(modbus_port: int) -> None:
    assert "Illegal data address" in mbpoll(modbus_port, "-t", "3", "-r", "999", "-c", "2", "")


def test_closed_connections_leave_no_objects_without_the_collector(modbus_port) -> None:
    """In the rig's process it does: 2000 clients that came and went would have cost it 14 000 objects."""

    def visits(count: int) -> None:
        for _ in range(count):
            with socket.create_connection(("127.0.0.1", modbus_port), timeout=2) as client:
                client.sendall(b"\xff" * 20)
                with contextlib.suppress(ConnectionError):
                    client.recv(10)

    gc.disable()
    try:
        visits(100)
        before = len(gc.get_objects())
        visits(500)
        assert len(gc.get_objects()) - before < 7 * 150, "seven for each since the last collection"
    finally:
        gc.enable()
