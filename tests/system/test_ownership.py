"""A bench that one commander owns, over real sockets: ports that strangers fill, a connection that goes silent."""

import contextlib
import selectors
import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from bench_protocol.can_codec import Encoder
from bench_protocol.clock import RealClock
from bench_protocol.registers import LEASE_ADDRESS
from bench_protocol.table import TABLE
from bench_protocol.units import ms, s
from drivers.bench import Bench
from drivers.can_port import open_can
from drivers.commander import CYCLE
from drivers.errors import BenchError, LinkLost, NotCommander
from drivers.modbus_port import open_modbus
from drivers.wiring.own import own_wiring
from tests.refusals import refuses

MODBUS_PLACES, CAN_PLACES = 64, 32
on_tcp = pytest.mark.parametrize("site", ["tcp"], indirect=True)


class Proxy:
    """A TCP proxy in front of ``port`` whose cable can be cut without anybody hearing of it."""

    def __init__(self, port: int) -> None:
        self._target = port
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.cut = threading.Event()
        self._closed = threading.Event()
        self._sockets: list[socket.socket] = []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        client, _ = self.listener.accept()
        server = socket.create_connection(("127.0.0.1", self._target))
        self._sockets = [client, server]
        with selectors.DefaultSelector() as selector:
            selector.register(client, selectors.EVENT_READ, server)
            selector.register(server, selectors.EVENT_READ, client)
            while not (self.cut.is_set() or self._closed.is_set()):
                for key, _ in selector.select(0.02):
                    key.data.sendall(key.fileobj.recv(4096))
        self._closed.wait(30)

    def close(self) -> None:
        self._closed.set()
        self._thread.join()
        for each in (self.listener, *self._sockets):
            each.close()


@pytest.fixture
def proxied(site) -> Iterator[tuple[Bench, Proxy]]:
    """A bench whose Modbus goes through a proxy."""
    site.close_shared()
    proxy = Proxy(site.rig.modbus_port)
    modbus = open_modbus("127.0.0.1", proxy.port, timeout=0.5)
    bench = Bench(own_wiring(site.can(), modbus), site.clock)
    try:
        bench.connect()
        yield bench, proxy
    finally:
        bench.close()
        proxy.close()


@pytest.mark.slow
@on_tcp
def test_a_black_holed_plc_connection_leads_to_hold_while_can_goes_on(site, proxied):
    """The watchdog's second, the tick, and what the machine adds; today's keep-alive would need ten seconds."""
    bench, proxy = proxied
    bench.arm()
    with site.listening() as received:
        site.wait(1.5 * s)
        assert received.states() == ["ACTIVE"], "fed, it holds nothing"
        proxy.cut.set()
        start = time.monotonic()
        while "FAULT_HOLD" not in received.states():
            assert time.monotonic() - start < 1.6
            time.sleep(0.01)
        controls = received.positions("Control").size
        with refuses(LinkLost, "watchdog"):
            bench.wait(2 * s)
        site.wait(200 * ms)
        assert received.positions("Control").size > controls + 5
        assert received.states() == ["ACTIVE", "FAULT_HOLD"], "commands arrive: the air stays shut in"
    assert bench.rig.reason == "commander disconnected"
    bench.disarm()
    assert bench.rig.state == "FAULT_DISABLED", "by CAN alone"


@contextlib.contextmanager
def crowd(port: int, count: int) -> Iterator[list[socket.socket]]:
    with contextlib.ExitStack() as stack:
        yield [
            stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5))
            for _ in range(count)
        ]


@pytest.mark.slow
def test_the_commander_gets_in_though_idle_connections_fill_both_doors(start_rig):
    """A separate rig, because clients of the shared one use its ports."""
    rig = start_rig()
    clock = RealClock()

    def connected() -> Bench:
        modbus = open_modbus("127.0.0.1", rig.modbus_port, timeout=2.0)
        return Bench(own_wiring(open_can("tcp", port=rig.can_port), modbus), clock)

    with crowd(rig.modbus_port, MODBUS_PLACES), crowd(rig.can_port, CAN_PLACES):
        bench = connected()
        bench.connect()
        bench.arm()
        bench.wait(2.5 * s)
        assert bench.rig.state == "ACTIVE", "beyond the time of the trial"
        second = connected()
        with pytest.raises(NotCommander, match=f"token {bench.rig.lease:.0f}, at TCP port"):
            second.connect()
        bench.wait(100 * ms)
        bench.close()


@on_tcp
def test_the_holder_and_other_clients_are_reported_with_ports(site, armed):
    second, encoder = site.bench(), Encoder(TABLE)
    holder = armed.rig.holder
    with pytest.raises(NotCommander, match=f"held by the commander .*TCP port {holder:.0f}; `ss -tnp`"):
        second.connect()
    armed.wait(150 * ms)
    assert "a Modbus request from TCP port" in armed.describe()
    intruder = site.can()
    for _ in range(20):
        intruder.send(encoder.encode(np.zeros(len(TABLE.signals)), encoder.rows(["Control"]), 0))
        armed.wait(20 * ms)
    armed.wait(150 * ms)
    assert armed.rig.state == "ACTIVE"
    port = intruder._bus._socket.getsockname()[1] if hasattr(intruder._bus, "_socket") else armed.rig.stranger
    assert f"the last CAN frame 0x201 from TCP port {port:.0f}" in armed.strangers()
    intruder.close()


def from_another_address(target: int, port: int) -> socket.socket:
    """Return a connection to ``target`` from this ``port`` of another address of the loopback."""
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind(("127.0.0.2", port))
    sock.settimeout(5)
    sock.connect(("127.0.0.1", target))
    return sock


@on_tcp
def test_the_commanders_port_at_another_address_has_no_effect(site, armed):
    """It connects and closes, and it sends what would move the platform, with the token that all can read."""
    ports = armed.wiring.carrier
    (can_port,), (modbus_port,) = ports.can.local_ports, ports.modbus.local_ports
    from_another_address(site.rig.can_port, can_port).close()
    from_another_address(site.rig.modbus_port, modbus_port).close()
    armed.wait(200 * ms)
    assert armed.rig.state == "ACTIVE"
    encoder, values = Encoder(TABLE), np.zeros(len(TABLE.signals))
    values[TABLE.index["control.token"]] = token = int(armed.rig.lease)
    values[TABLE.index["platform.vertical_setpoint"]] = 0.03
    encoder.bind(token)
    before, place = armed.rig.strangers, armed.platform.vertical
    with from_another_address(site.rig.can_port, can_port) as sock:
        for request in (b"< open vcan0 >", b"< rawmode >"):
            sock.sendall(request)
        for _ in range(30):
            block = encoder.encode(values, encoder.rows(["Control", "PlatformSetpoints"]), 0)
            lines = (
                f"< send {one['id']:x} {one['length']} {' '.join(f'{byte:02x}' for byte in one['data'])} >"
                for one in block
            )
            sock.sendall("".join(lines).encode())
            armed.wait(20 * ms)
        armed.wait(150 * ms)
    armed.wait(100 * ms)
    assert armed.rig.state == "ACTIVE"
    assert abs(armed.platform.vertical - place) < 1e-3
    assert armed.rig.strangers - before >= 30
    assert "another client tries to command the bench" in armed.strangers()


@pytest.mark.slow
@on_tcp
def test_a_flood_of_strangers_does_not_stop_the_commander(site, armed):
    """Eight clients send as fast as they can for 3 s: far more than the hub takes of them."""
    stop, lines = threading.Event(), b"< send 7ff 8 01 02 03 04 05 06 07 08 >" * 500

    def flood() -> None:
        with socket.create_connection(("127.0.0.1", site.rig.can_port), timeout=0.2) as sock:
            sock.sendall(b"< open vcan0 >")
            rest = lines
            while not stop.is_set():
                with contextlib.suppress(TimeoutError):
                    rest = rest[sock.send(rest) :] or lines

    threads = [threading.Thread(target=flood) for _ in range(8)]
    try:
        for thread in threads:
            thread.start()
        armed.wait(3 * s)
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert armed.rig.state == "ACTIVE"


@pytest.mark.slow
def test_a_third_party_command_does_not_prevent_arming(site):
    """He streams sound commands before anybody else is there, and goes on all the time."""
    site.close_shared()
    encoder, values, stranger = Encoder(TABLE), np.zeros(len(TABLE.signals)), site.can()
    values[TABLE.index["control.enable"]] = 1
    rows = encoder.rows(["Control", "DisplacementSetpoints"])
    task = site.clock.every(CYCLE, lambda: stranger.send(encoder.encode(values, rows, 0)))
    try:
        # What the test before has left comes to rest: a bolster that swings sideways trips a limit when it is held.
        site.wait(4 * s)
        with site.bench() as bench:
            bench.arm()
            bench.wait(300 * ms)
            assert bench.rig.state == "ACTIVE"
            assert "another client tries to command the bench" in bench.describe()
            assert "frames or requests refused, the last CAN frame 0x203" in bench.strangers()
    finally:
        task.cancel()
        stranger.close()


@pytest.mark.slow
def test_a_lease_is_taken_on_can_and_joined_on_modbus(site):
    """On every wire: ask with a nonce, command with the token of the answer, send the key of a Modbus connection."""
    site.close_shared()
    encoder, values, modbus = Encoder(TABLE), np.zeros(len(TABLE.signals)), site.modbus()

    def send(message: str, **fields: int) -> None:
        for name, value in fields.items():
            values[TABLE.index[name.replace("_", ".", 1)]] = value
        port.send(encoder.encode(values, encoder.rows([message]), 0))

    port = site.can()
    with site.listening() as received:
        send("LeaseRequest", lease_nonce=0xBEE, lease_token=0)
        site.wait(150 * ms)
        assert received.series("lease.nonce")[-1] == 0xBEE
        token = int(received.series("rig.lease")[-1])
        assert modbus.read_holding(LEASE_ADDRESS, 1)[0] not in (0, token), "a key of this connection's own"
        for _ in range(60):
            send("Control", control_token=token, control_enable=1)
            site.wait(20 * ms)
        send("LeaseRequest", lease_token=modbus.read_holding(LEASE_ADDRESS, 1)[0])
        site.wait(20 * ms)
        assert modbus.read_holding(LEASE_ADDRESS, 1) == [token], "it has joined"
        modbus.write_registers(LEASE_ADDRESS, [0])
        site.wait(20 * ms)
        assert modbus.read_holding(LEASE_ADDRESS, 1) == [0]
    port.close()
    modbus.close()


def test_a_run_that_is_kept_out_says_by_whom(site, astb_here, tmp_path):
    if site.transport == "memory":
        pytest.skip("`astb run` needs a rig behind sockets")
    bench = site.shared()
    bench.wait(100 * ms)
    can = (
        f'bus = "{site.rig.can}"' if site.rig.can_port is None else f'bus = "tcp"\nport = {site.rig.can_port}'
    )
    (tmp_path / "rig.toml").write_text(
        f'name = "test"\n[can]\n{can}\n[modbus]\nport = {site.rig.modbus_port}\n'
    )
    code, out, err = astb_here(tmp_path, "run", "aw0", "--rig", "rig.toml")
    assert code == 3
    text = " ".join((out + err).split())
    assert f"the bench is held by the commander with token {bench.rig.lease:.0f}, at TCP port" in text
    assert "that client releases the bench" in text
    with contextlib.suppress(BenchError):
        bench.wait(50 * ms)
