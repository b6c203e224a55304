"""Ports filled by third-party clients: one place is kept for the holder of the bench, even if it is silent."""

import contextlib
import socket
import time
from collections.abc import Callable, Iterator

import pytest

from bench_protocol.modbus import answer as modbus_answer
from bench_sim.rig.can_hub import CanHub
from bench_sim.rig.modbus_server import ModbusTcpServer
from bench_sim.rig.peers import PORT_MASK, sender_of
from bench_sim.rig.servers import Servers, serve_in_thread

READ = b"\0\1\0\0\0\6\1\4\0\0\0\1"
TRIAL = 0.5


class Port:
    """A port with two places, and what the rig says of its peers."""

    def __init__(self, kind: str, bank) -> None:
        self.kind = kind
        self.holder = self.commanding = 0
        hub = CanHub(lambda block, peer: None, clients_max=2, holds=self.holds) if kind == "can" else None
        server = ModbusTcpServer(
            lambda adu, peer: modbus_answer(adu, bank),
            clients_max=2,
            holds=self.holds,
            commands=lambda peer: sender_of(peer) & PORT_MASK == self.commanding,
            idle_limit=0.5,
        )
        self.clients: Callable[[], tuple[str, ...]] = lambda: (hub or server).clients
        self.servers: Servers = serve_in_thread(hub, None if hub else server)
        self.port = self.servers.can_port or self.servers.modbus_port

    def holds(self, peer: str) -> bool:
        return sender_of(peer) & PORT_MASK == self.holder

    def open(self) -> socket.socket:
        return socket.create_connection(("127.0.0.1", self.port), timeout=5)

    def serves(self, client: socket.socket) -> bool:
        """Whether the client gets something to read; False if the port closes the connection."""
        try:
            if self.kind == "modbus":
                client.sendall(READ)
                return client.recv(100)[:2] == READ[:2]
            client.sendall(b"< echo >")
            return b"< echo >" in client.recv(100) or b"< echo >" in client.recv(100)
        except ConnectionError:
            return False


@pytest.fixture(params=["can", "modbus"])
def port(request, bank, monkeypatch) -> Iterator[Port]:
    monkeypatch.setattr("bench_sim.rig.places._TRIAL", TRIAL)
    port = Port(request.param, bank)
    with port.servers:
        yield port


def closed_after(client: socket.socket) -> float:
    """Return how long the port keeps the connection open (s)."""
    start = time.monotonic()
    with contextlib.suppress(ConnectionError):
        while client.recv(1000):
            pass
    return time.monotonic() - start


def keep_busy(port: Port, *clients: socket.socket) -> bool:
    return all(port.serves(client) for client in clients)


def test_the_holder_gets_in_where_all_places_are_taken(port: Port) -> None:
    with port.open() as a, port.open() as b:
        assert keep_busy(port, a, b)
        with port.open() as commander:
            assert port.serves(commander)
            port.holder = commander.getsockname()[1]
            end = time.monotonic() + TRIAL + 0.4
            while time.monotonic() < end:
                assert keep_busy(port, a, b, commander)
                time.sleep(0.1)
            assert len(port.clients()) == 3


def test_who_does_not_hold_the_bench_is_dropped_after_his_trial(port: Port) -> None:
    with port.open() as a, port.open() as b:
        assert keep_busy(port, a, b)
        with port.open() as stranger, port.open() as another:
            assert closed_after(another) < 0.5, "one at a time"
            end = time.monotonic() + 3 * TRIAL
            while port.serves(stranger) and time.monotonic() < end:
                keep_busy(port, a, b)
                time.sleep(0.05)
            assert TRIAL - 0.1 < time.monotonic() - end + 3 * TRIAL < TRIAL + 0.5
        assert keep_busy(port, a, b)


def test_a_holder_takes_no_place_from_the_others(port: Port) -> None:
    with port.open() as commander:
        assert port.serves(commander)
        port.holder = commander.getsockname()[1]
        with port.open() as a, port.open() as b:
            assert keep_busy(port, a, b, commander)
            time.sleep(0.2)
            assert keep_busy(port, a, b, commander)


@pytest.mark.slow
@pytest.mark.parametrize("port", ["modbus"], indirect=True)
def test_a_holder_who_commands_on_can_may_be_silent_on_modbus(port: Port) -> None:
    with port.open() as commander, port.open() as idle:
        port.commanding = commander.getsockname()[1]
        assert closed_after(idle) < 1.0
        time.sleep(0.8)
        assert port.serves(commander)
        port.commanding = 0
        assert closed_after(commander) < 2.0
