"""The Modbus transport: its rules, against pymodbus' server and in memory, and what it does on bad days."""

import asyncio
import contextlib
import itertools
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from astb.acceptance.transports import Subject, check_transport
from bench_protocol.clock import RealClock, VirtualClock
from bench_protocol.modbus import answer
from drivers.errors import LinkLost, Refused, WiringError
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.modbus.transport import ModbusTransport
from drivers.wiring.transports import open_transport

HOLDING, INPUT = range(2)
SIZE = 300

PLC = {
    "kind": "modbus",
    "host": "127.0.0.1",
    "word_order": "low",
    "timeout": "200 ms",
    "patience": "300 ms",
    "stream": "20 ms",
    "groups": {"fast": {"every": "20 ms", "stale": "500 ms"}, "slow": {"every": "50 ms", "stale": "500 ms"}},
    "points": {
        "height": {"table": "input", "address": 100, "type": "int16", "scale": 0.01, "group": "fast"},
        "force": {"table": "input", "address": 101, "type": "int32", "group": "fast"},
        "broken": {"table": "input", "address": 103, "type": "int16", "null": -32768, "group": "fast"},
        "level": {"table": "input", "address": 110, "type": "float32", "group": "slow"},
        "ready": {"table": "discrete", "address": 7, "group": "slow"},
        "target": {"table": "holding", "address": 20, "type": "int16"},
        "rate": {"table": "holding", "address": 21, "type": "float32"},
        "far": {"table": "holding", "address": 30},
        "start": {"table": "holding", "address": 40, "bit": 3},
        "stop": {"table": "holding", "address": 40, "bit": 12},
        "valve": {"table": "coil", "address": 3},
        "vent": {"table": "coil", "address": 4},
        "beat": {"table": "holding", "address": 50},
        "beyond": {"table": "holding", "address": 60_000},
        "serial": {"table": "holding", "address": 60, "type": "string", "length": 4},
    },
}


class ForeignPlc:
    """pymodbus' own server in a thread; its registers are `tables` of 300 words, and it notes the requests."""

    def __init__(self) -> None:
        self.tables = [[0] * SIZE for _ in range(2)]
        self.coils: list[int] = []
        self.requests: list[tuple[int, int, int]] = []  # function, address, count
        self.refuse_writes = False
        self.lag = 0.0  # s that it takes for an answer
        self.port = 0
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._started.wait(5)

    async def _action(self, function, start, address, count, current, new):
        self.requests.append((function, address, count))
        await asyncio.sleep(self.lag)
        if new is not None and self.refuse_writes:
            return ExcCodes.DEVICE_FAILURE
        if function in (1, 2, 5, 15):  # bits are the server's own, 16 in a word
            if function != 2:
                self.coils = current
            return None
        table = self.tables[INPUT if function == 4 else HOLDING]
        if new is not None:
            table[address : address + count] = [int(value) for value in new]
        current[address - start : address - start + count] = table[address : address + count]
        return None

    def _run(self) -> None:
        with asyncio.Runner() as runner:
            self._loop = runner.get_loop()
            runner.run(self._serve())

    async def _serve(self) -> None:
        bits = [SimData(0, values=[False] * 7 + [True] + [False] * 24, datatype=DataType.BITS)]
        words = [SimData(0, count=SIZE, values=0, datatype=DataType.REGISTERS)]
        device = SimDevice(
            1, simdata=(bits, bits, words, words), action=self._action, use_bit_addressing=True
        )
        self._server = ModbusTcpServer(device, address=("127.0.0.1", 0))
        await self._server.serve_forever(background=True)
        self.port = self._server.transport.sockets[0].getsockname()[1]
        self._over = asyncio.Event()
        self._started.set()
        await self._over.wait()
        await self._server.shutdown()

    def stop(self) -> None:
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._over.set)
            self._thread.join(5)


@pytest.fixture
def plc() -> Iterator[ForeignPlc]:
    plc = ForeignPlc()
    plc.tables[INPUT][100:104] = [0xFFFF & -1234, 70000 & 0xFFFF, 70000 >> 16, 0x8000]
    plc.tables[INPUT][110:112] = [0, 0x3FC0]  # 1.5, low word first
    yield plc
    plc.stop()


@pytest.fixture
def connected() -> Iterator[Callable]:
    with contextlib.ExitStack() as stack:

        def connect(plc: ForeignPlc, **changes: object) -> tuple[ModbusTransport, list, list]:
            transport = ModbusTransport("plc", {**PLC, "port": plc.port, **changes})
            stack.callback(transport.close)
            received: list[tuple[int, dict]] = []
            lost: list[str] = []
            transport.subscribe(lambda time, points: received.append((time, dict(points))))
            transport.connect(RealClock(), lost.append, within=1.0)
            return transport, received, lost

        yield connect


def broken_rules(subject: Subject) -> list[str]:
    findings = check_transport(subject)
    assert not [finding for finding in findings if finding.skipped]
    return [str(finding) for finding in findings if finding.breach]


@pytest.mark.slow
def test_it_conforms_with_a_foreign_server(plc: ForeignPlc, dead_port: int) -> None:
    plcs = [plc]

    def make() -> ModbusTransport:
        return ModbusTransport("plc", {**PLC, "port": plcs[-1].port})

    subject = Subject(
        make=make,
        readable=("height", "force", "level", "ready", "target"),
        written={"target": "target", "rate": "rate", "start": "start", "valve": "valve"},
        streamed={"far": "far", "vent": "vent"},
        unavailable="broken",
        refused="beyond",
        nobody=lambda: ModbusTransport("plc", {**PLC, "port": dead_port}),
        cut=plc.stop,
    )
    assert broken_rules(subject) == []


def test_it_conforms_in_memory_and_in_virtual_time(bank) -> None:
    clock, silent = VirtualClock(), []
    bank.input[103] = 0x8000

    def port() -> InMemoryModbus:
        return InMemoryModbus(lambda adu: b"" if silent else answer(adu, bank))

    def make() -> ModbusTransport:
        silent.clear()
        return ModbusTransport("plc", PLC, port=port)

    def silent_transport() -> ModbusTransport:
        silent.append("nobody")
        return ModbusTransport("plc", PLC, port=port)

    subject = Subject(
        make=make,
        readable=("height", "force", "level", "ready", "target"),
        written={"target": "target", "rate": "rate", "start": "start", "valve": "valve"},
        streamed={"far": "far", "vent": "vent"},
        unavailable="broken",
        refused="beyond",
        nobody=silent_transport,
        cut=lambda: silent.append("cut"),
        clock=clock,
    )
    assert broken_rules(subject) == []


def test_numbers_of_a_foreign_server(plc: ForeignPlc, connected: Callable) -> None:
    transport, received, _ = connected(plc)
    found = transport.read(["force", "height", "broken", "level", "ready"])
    assert found.pop("broken") != found["height"]
    assert found == {"force": 70000.0, "height": -12.34, "level": 1.5, "ready": 1.0}
    plc.tables[HOLDING][60:64] = [0x504C, 0x4320, 0x3700, 0]
    assert transport.text("serial") == "PLC 7"
    with pytest.raises(WiringError, match=r"serial is a text; read it with text\('serial'\)"):
        transport.read(["serial"])
    # All that one request brings has one time: two registers of one group are never of two polls.
    assert all(
        points.keys() in ({"height", "force", "broken"}, {"level"}, {"ready"}) for _, points in received
    )


def test_few_requests_in_the_order_given(plc: ForeignPlc, connected: Callable) -> None:
    transport, _, _ = connected(plc)
    plc.tables[HOLDING][40] = 0x8001
    time.sleep(0.05)
    plc.requests.clear()
    transport.write({"far": 7, "target": -3, "rate": 1.5, "valve": 1, "vent": 1, "stop": 1, "start": 1})
    writes = [request for request in plc.requests if request[0] in (5, 15, 16)]
    assert [function for function, _, _ in writes] == [16, 16, 15, 16]
    assert [request for request in writes if request[0] == 16] == [(16, 30, 1), (16, 20, 3), (16, 40, 1)]
    assert plc.tables[HOLDING][20:23] == [0xFFFD, 0, 0x3FC0]
    assert plc.tables[HOLDING][40] == 0x8001 | 1 << 3 | 1 << 12
    assert plc.coils[0] == 1 << 3 | 1 << 4 | 1 << 7
    plc.requests.clear()
    with pytest.raises(ValueError, match="target = 40000 does not fit"):
        transport.write({"far": 8, "target": 40000})
    assert plc.tables[HOLDING][30] == 7, "nothing is sent if one does not fit"


def test_a_refusal_is_the_rigs_and_the_connection_lives(plc: ForeignPlc, connected: Callable) -> None:
    transport, _, lost = connected(plc)
    plc.refuse_writes = True
    with pytest.raises(Refused, match=r"writing holding registers 30 of .* was refused"):
        transport.write({"far": 7})
    transport.stream({"far": 7}, 0)
    time.sleep(0.1)
    assert transport.counts["refused"] == 1
    plc.refuse_writes = False
    transport.write({"far": 8})
    assert plc.tables[HOLDING][30] == 8
    assert lost == []


def test_a_group_outside_the_map_is_reported_on_connection(plc: ForeignPlc, connected: Callable) -> None:
    points = {**PLC["points"], "height": {"table": "input", "address": SIZE, "group": "fast"}}
    with pytest.raises(Refused, match=f"reading input registers {SIZE} of .* outside the device's map"):
        connected(plc, points=points)


def test_a_sign_of_life_may_be_a_bit(plc: ForeignPlc, connected: Callable) -> None:
    transport, _, _ = connected(plc, alive={"point": "valve", "every": "100 ms"})
    assert transport.begin() == pytest.approx(0.3)
    seen = []
    for _ in range(50):
        seen.append(transport.read(["valve"])["valve"])
        time.sleep(0.02)
    assert 4 <= sum(a != b for a, b in itertools.pairwise(seen)) <= 12


def test_the_heartbeat_counts_while_set_points_are_streamed(plc: ForeignPlc, connected: Callable) -> None:
    transport, _, _ = connected(plc, alive={"point": "beat", "every": "20 ms"})
    time.sleep(0.1)
    assert plc.tables[HOLDING][50] == 0, "no output before the first command"
    transport.begin()
    time.sleep(0.3)
    first = plc.tables[HOLDING][50]
    assert 5 <= first <= 20, "before the first set-point it counts by itself"
    for _ in range(10):
        transport.stream({"target": 1.0, "rate": float("nan")}, transport._clock.now())
        time.sleep(0.02)
    assert plc.tables[HOLDING][50] > first
    assert plc.tables[HOLDING][20] == 1
    assert plc.tables[HOLDING][21:23] == [0, 0], "NaN keeps the old value"
    time.sleep(0.7)
    stopped = plc.tables[HOLDING][50]
    time.sleep(0.1)
    assert plc.tables[HOLDING][50] == stopped, "who streams no more does not look alive"


@pytest.mark.slow
def test_an_answer_may_take_its_time_though_the_connection_had_little(plc: ForeignPlc) -> None:
    """What an earlier connection took of the time must not shorten the patience with this one."""
    transport = ModbusTransport("plc", {**PLC, "port": plc.port, "timeout": "2 s"})
    plc.lag = 0.3
    transport.connect(RealClock(), pytest.fail, within=0.2)
    assert transport.read(["target"]) == {"target": 0.0}
    transport.close()


def test_polls_that_are_late_do_not_pile_up(bank) -> None:
    clock, slow, polls = VirtualClock(), [], []

    def respond(adu: bytes) -> bytes:
        if adu[7] == 4 and adu[9] == 100:
            polls.append(clock.now())
            if slow:
                slow.clear()
                clock._now += 1_000_000_000  # this answer takes a second
        return answer(adu, bank)

    transport = ModbusTransport("plc", PLC, port=lambda: InMemoryModbus(respond))
    transport.connect(clock, pytest.fail, within=1.0)
    clock.sleep_until(clock.now() + 200_000_000)
    slow.append(True)
    before = len(polls)
    clock.sleep_until(clock.now() + 2_000_000_000)
    after = polls[before:]
    assert len(after) <= 2_000 / 20 + 2 - 1_000 / 20 + 1
    assert min(b - a for a, b in itertools.pairwise(after)) >= 10_000_000
    transport.close()


def test_a_short_silence_is_no_loss(bank) -> None:
    clock, silent, lost = VirtualClock(), [], []
    transport = ModbusTransport(
        "plc", PLC, port=lambda: InMemoryModbus(lambda adu: b"" if silent else answer(adu, bank))
    )
    transport.connect(clock, lost.append, within=1.0)
    silent.append(True)
    clock.sleep_until(clock.now() + 200_000_000)
    with pytest.raises(LinkLost, match="does not answer"):
        transport.read(["target"])
    silent.clear()
    clock.sleep_until(clock.now() + 1_000_000_000)
    assert transport.read(["target"]) == {"target": 0.0}
    assert lost == []
    silent.append(True)
    clock.sleep_until(clock.now() + 1_000_000_000)
    assert len(lost) == 1
    assert "the device does not answer" in lost[0]
    transport.close()


def test_a_failing_listener_is_reported(bank) -> None:
    clock, lost = VirtualClock(), []
    transport = ModbusTransport("plc", PLC, port=lambda: InMemoryModbus(lambda adu: answer(adu, bank)))
    transport.connect(clock, lost.append, within=1.0)
    transport.subscribe(lambda time, points: 1 / 0)
    clock.sleep_until(clock.now() + 100_000_000)
    assert lost == ["a subscriber of plc at 127.0.0.1:502 failed: ZeroDivisionError: division by zero"]
    transport.close()


def changed(**keys: object) -> dict:
    return {**PLC, **keys}


@pytest.mark.parametrize(
    ("table", "words"),
    [
        (changed(hosts="x"), "transports.plc: there is no key 'hosts' here; did you mean 'host'"),
        ({k: v for k, v in PLC.items() if k != "host"}, "transports.plc: the key host is missing"),
        (changed(port=70000), "transports.plc: port = 70000; use a whole number <= 65535"),
        (changed(unit=-1), "unit = -1"),
        (changed(timeout="fast"), "transports.plc: timeout = 'fast' is not a time .* like \"100 ms\""),
        (changed(timeout="0 s"), "timeout = '0 s' is not a time above 0"),
        (changed(groups={}), r"points: height: group = 'fast' is not among \[groups\]"),
        (
            changed(groups={**PLC["groups"], "idle": {"every": "1 s"}}),
            "groups.idle: no point has group = 'idle'",
        ),
        (
            changed(groups={**PLC["groups"], "fast": {"every": "1 s", "stale": "1 s"}}),
            "groups.fast: stale = '1 s' is not longer than every = '1 s'",
        ),
        (
            changed(alive={"point": "beet", "every": "1 s"}),
            "no point 'beet'; did you mean 'beat'",
        ),
        (
            changed(points={"height": {"table": "inputs", "address": 1}}),
            "height: table = 'inputs' is unknown; did you mean 'input'",
        ),
        (
            changed(points={"height": {"table": "input", "address": 1, "type": "word"}}),
            "height: type = 'word' is unknown; use one of int16",
        ),
        (
            changed(alive={"point": "height", "every": "1 s"}),
            "height is a int16 in the table 'input', which cannot be written",
        ),
        (changed(kind="modbuss"), "kind = 'modbuss' is not a transport; did you mean 'modbus'"),
        (changed(kind=None), "kind = None is not a transport"),
        (changed(kind="nowhere.at_all:factory"), "cannot be imported: No module named 'nowhere'"),
        (changed(kind="json:factory"), "json has no function 'factory'; add it"),
        (changed(kind="types:SimpleNamespace.mro"), "types has no function 'SimpleNamespace.mro'; add it"),
        (
            changed(kind="own.py:make"),
            "own.py:make' returns a dict, .*Transport",
        ),
        (changed(kind="gone.py:make"), "kind = 'gone.py:make' cannot be imported: .*No such file"),
    ],
)
def test_a_description_that_cannot_be(table: dict, words: str, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text("def make(name, table, where):\n    return dict(table)\n")
    with pytest.raises(WiringError, match=words):
        open_transport("plc", table, tmp_path)
