"""Modbus devices with quirks: each works, with a key if needed, or its quirk is reported."""

import contextlib
import math
import struct
import time
from collections.abc import Callable, Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.clock import RealClock, VirtualClock
from drivers.errors import BenchError, LinkLost, Refused, WiringError
from drivers.modbus_port import InMemoryModbus
from drivers.wiring.modbus.transport import ModbusTransport
from tests.foreign.quirky_modbus import Device, served

NS = 1_000_000_000
POINTS = {
    "height": {"table": "input", "address": 10, "type": "int16", "scale": 0.01, "group": "fast"},
    "force": {"table": "input", "address": 11, "type": "int32", "group": "fast"},
    "level": {"table": "input", "address": 13, "type": "float32", "null": -999.9, "group": "fast"},
    "ready": {"table": "discrete", "address": 3, "group": "fast"},
    "target": {"table": "holding", "address": 20, "type": "int16"},
    "rate": {"table": "holding", "address": 21, "type": "int16"},
    "place": {"table": "holding", "address": 30, "type": "int32"},
    "start": {"table": "holding", "address": 40, "bit": 3},
    "valve": {"table": "coil", "address": 3},
    "vent": {"table": "coil", "address": 4},
    "serial": {"table": "holding", "address": 60, "type": "string", "length": 10},
}
KEYS = {
    "kind": "modbus",
    "host": "127.0.0.1",
    "timeout": "200 ms",
    "patience": "400 ms",
    "stream": "20 ms",
    "groups": {"fast": {"every": "20 ms", "stale": "400 ms"}},
    "points": POINTS,
}
TRUTH = {"height": -12.34, "force": 70000.0, "level": 1.5, "ready": 1.0}


def device(**quirks: object) -> Device:
    one = Device(**quirks)
    one.words["input"][10:15] = [0xFFFF & -1234, 1, 70000 & 0xFFFF, 0x3FC0, 0]
    one.bits["discrete"][3] = True
    one.words["holding"][60:70] = [0x504C, 0x4320, 0x3700, *[0] * 7]
    return one


class DeviceRig:
    """A device in memory and virtual time, and a transport to it."""

    def __init__(self, far: Device, **changes: object) -> None:
        self.clock, self.far, self.lost = VirtualClock(), far, []
        self.heard: list[tuple[int, dict[str, float]]] = []
        self.transport = ModbusTransport("plc", {**KEYS, **changes}, port=lambda: InMemoryModbus(far.tcp))
        self.transport.subscribe(lambda at, points: self.heard.append((at, dict(points))))

    def __enter__(self) -> "DeviceRig":
        self.transport.connect(self.clock, self.lost.append, within=1.0)
        return self

    def __exit__(self, *_: object) -> None:
        self.transport.close()

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + round(seconds * NS))

    def values_of(self, name: str) -> list[float]:
        return [points[name] for _, points in self.heard if name in points]


# -- written values ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("writes", ["any", "single"])
def test_only_functions_5_and_6(writes):
    far = device(functions=(1, 2, 3, 4, 5, 6))
    with DeviceRig(far, writes=writes) as stand:
        for k in range(2):
            far.log.clear()
            stand.transport.write({"target": -5, "rate": 7 + k, "valve": 1, "vent": 1, "start": 1})
            assert far.words["holding"][20:22] == [0xFFFB, 7 + k]
        assert far.words["holding"][40] == 8
        assert far.bits["coil"][3:5] == [True, True]
        assert [one[0] for one in far.log] == [6, 6, 5, 5, 3, 6], "once known, nothing else is tried"


def test_a_number_of_two_registers_is_not_written_in_parts():
    far = device(functions=(1, 2, 3, 4, 5, 6))
    with DeviceRig(far) as stand, pytest.raises(Refused, match=r'2 registers in parts: .* writes = "parts"'):
        stand.transport.write({"place": 70000})
    assert far.words["holding"][30:32] == [0, 0]
    with pytest.raises(WiringError, match="place is a int32 in 2 registers, and writes = 'single'"):
        DeviceRig(far, writes="single").transport.require("place", writable=True)


def test_a_number_of_two_registers_is_written_in_parts_if_configured():
    far = device(functions=(1, 2, 3, 4, 5, 6))
    with DeviceRig(far, writes="parts") as stand:
        stand.transport.write({"place": 70000, "valve": 1})
    assert far.words["holding"][30:32] == [1, 70000 & 0xFFFF]
    assert [one[:2] for one in far.log[-3:]] == [(6, 30), (6, 31), (5, 3)], "the last one is written last"


@pytest.mark.parametrize("writes", ["any", "multiple"])
def test_only_functions_15_and_16(writes):
    far = device(functions=(1, 2, 3, 4, 15, 16))
    with DeviceRig(far, writes=writes) as stand:
        for k in range(2):
            far.log.clear()
            stand.transport.write({"target": 5, "valve": k, "place": 70000})
            assert far.words["holding"][30:32] == [1, 70000 & 0xFFFF]
            assert far.bits["coil"][3] == bool(k)
        assert [one[0] for one in far.log] == [16, 15, 16]


@pytest.mark.parametrize("writes", ["any", "combined"])
def test_only_functions_15_and_23(writes):
    far = device(functions=(1, 2, 3, 4, 15, 23))
    with DeviceRig(far, writes=writes) as stand:
        for k in range(2):
            far.log.clear()
            stand.transport.write({"target": 5, "rate": -7, "valve": k, "place": 70000 + k, "start": 1})
            assert far.words["holding"][20:22] == [5, 0xFFFF & -7]
            assert far.words["holding"][30:32] == [1, (70000 + k) & 0xFFFF]
            assert far.words["holding"][40] == 8
            assert far.bits["coil"][3] == bool(k)
        assert [one[0] for one in far.log] == [23, 15, 23, 3, 23], "once known, nothing else is tried"


def test_set_points_that_are_neighbours_go_in_one_request_whatever_their_order():
    far = device()
    with DeviceRig(far) as stand:
        stand.transport.begin()
        far.log.clear()
        stand.transport.stream({"place": 70000, "rate": 7, "target": 5}, stand.clock.now())
        stand.wait(0.03)
    assert [one for one in far.log if one[0] == 16] == [(16, 20, 2), (16, 30, 2)]
    assert far.words["holding"][20:22] == [5, 7]


# -- sizes of requests -------------------------------------------------------------------------------------------------


def test_at_most_so_many_registers_a_request():
    far = device(request_max=2)
    with DeviceRig(far, request_max=2) as stand:
        assert stand.transport.read(list(TRUTH)) == pytest.approx(TRUTH)
        assert stand.transport.text("serial") == "PLC 7"
        stand.transport.write({"target": 1, "rate": 2, "place": 3})
    assert max(count for function, _, count in far.log if function in (3, 4, 6, 16)) == 2


@pytest.mark.parametrize("too_many", [2, 3, 0])
def test_the_number_of_runs_needed_is_computed_and_printed(too_many):
    with (
        pytest.raises(BenchError, match="the device answers requests of 3 registers; set request_max = 3"),
        DeviceRig(device(request_max=3, too_many=too_many)),
    ):
        pass
    with pytest.raises(
        WiringError, match="force is a int32 in 2 registers, and request_max = 1; increase request_max"
    ):
        DeviceRig(device(), request_max=1)


def test_a_gap_is_detected_and_reported():
    far = device(holes=frozenset([11, 12]))
    with (
        pytest.raises(Refused, match=r"the device refuses force \(input 11\), and reads the others"),
        DeviceRig(far),
    ):
        pass
    points = {**POINTS, "far": {"table": "input", "address": 18, "group": "fast"}}
    far = device(holes=frozenset([16]))
    with DeviceRig(far, points=points) as stand:
        assert stand.transport.read(list(TRUTH)) == pytest.approx(TRUTH)
    groups = {"fast": {**KEYS["groups"]["fast"], "gap": 5}}
    with (
        pytest.raises(Refused, match="gap = 0, if there are unused addresses"),
        DeviceRig(far, points=points, groups=groups),
    ):
        pass


# -- busy, slow, refusing ----------------------------------------------------------------------------------------------


def test_busy_now_and_then_is_no_reading_lost():
    far = device(busy=lambda count: count % 4 != 0)
    with DeviceRig(far) as stand:
        stand.wait(2.0)
        assert set(stand.values_of("height")) == {-12.34}, "not NaN before it is stale"
        far.log.clear()
        assert stand.transport.read(["target", "height"]) == {"target": 0.0, "height": -12.34}
        stand.transport.write({"target": 3, "place": 4})
        assert far.words["holding"][20] == 3
        assert stand.lost == []
        (remark,) = stand.transport.remarks()
    assert "requests met a busy device" in remark.text
    assert not remark.doubtful


def test_a_permanently_busy_server_is_reported_as_busy():
    with (
        pytest.raises(Refused, match=r"was refused: the device is busy \(Modbus exception 6\)"),
        DeviceRig(device(busy=lambda count: True)),
    ):
        pass


def test_a_group_that_is_refused_for_good_has_no_value():
    far = device()
    with DeviceRig(far) as stand:
        stand.wait(0.1)
        far.holes = frozenset([12])
        stand.wait(0.1)
        assert math.isnan(stand.values_of("height")[-1])
        assert [one.text for one in stand.transport.remarks() if one.doubtful]


def test_a_refused_stream_is_reported_with_time_and_reason():
    far = device(refuses=lambda function, address: 4 if function in (6, 16) else 0)
    with DeviceRig(far) as stand:
        for _ in range(5):
            stand.transport.stream({"target": 1.0}, stand.clock.now())
            stand.wait(0.02)
        since, error = stand.transport.refusal
        assert since < stand.clock.now() - 50_000_000
        assert "writing holding registers 20" in str(error)
        far.refuses = lambda function, address: 0
        stand.transport.stream({"target": 2.0}, stand.clock.now())
        stand.wait(0.05)
        assert stand.transport.refusal is None
        assert far.words["holding"][20] == 2


def test_no_value_is_recognised_as_the_device_has_it():
    far = device()
    far.words["input"][13:15] = struct.unpack(">2H", struct.pack(">f", -999.9))
    with DeviceRig(far) as stand:
        assert math.isnan(stand.transport.read(["level"])["level"])
        assert math.isnan(stand.values_of("level")[-1])


# -- connections, on sockets -------------------------------------------------------------------------------------------


@pytest.fixture
def connected() -> Iterator[Callable]:
    with contextlib.ExitStack() as stack:

        def connect(**changes: object) -> tuple[ModbusTransport, list, list]:
            transport = ModbusTransport("plc", {**KEYS, "timeout": "2 s", "patience": "3 s", **changes})
            stack.callback(transport.close)
            received: list[dict] = []
            lost: list[str] = []
            transport.subscribe(lambda at, points: received.append(dict(points)))
            transport.connect(RealClock(), lost.append, within=1.0)
            return transport, received, lost

        yield connect


@pytest.mark.parametrize("connection", ["kept", "each"])
def test_a_device_that_closes_after_each_answer_is_supported(connected: Callable, connection: str) -> None:
    far = device()
    with served(far, hangs_up=True) as server:
        transport, received, lost = connected(port=server.port, connection=connection)
        for k in range(8):
            transport.write({"target": k, "place": 70000 + k})
            assert transport.read(["target", "place"]) == {"target": k, "place": 70000 + k}
            time.sleep(0.03)
        assert transport.counts["silent"] == 0
        assert lost == []
        assert len(received) > 10
        assert [one.text for one in transport.remarks() if "closes" in one.text] == (
            ['the device closes the connection after an answer; set connection = "each"']
            if connection == "kept"
            else []
        )
        transport.close()


def test_one_connection_only(connected: Callable) -> None:
    far = device()
    with served(far, one=True) as server:
        first, _, _ = connected(port=server.port, connection="shared")
        groups = {"fast": {"every": "30 ms"}}
        second, _, _ = connected(port=server.port, connection="shared", groups=groups)
        assert first.read(list(TRUTH)) == second.read(list(TRUTH)) == pytest.approx(TRUTH)
        assert server.connections == 1
        with pytest.raises(
            LinkLost, match="accept only one client at a time, and another client is connected"
        ):
            connected(port=server.port)
        first.close()
        assert second.read(list(TRUTH)) == pytest.approx(TRUTH)
        second.close()


@pytest.mark.parametrize(
    ("quirk", "words"),
    [
        ({"answers_as": 255}, "the answer is from unit 255 instead of 1; correct unit, or set echo = false"),
        (
            {"number": lambda asked: asked + 7},
            "the answer has the request number 8 instead of 1; set echo = false",
        ),
    ],
)
def test_answers_with_another_unit_or_number(connected: Callable, quirk: dict, words: str) -> None:
    far = device(**quirk)
    with served(far) as server:
        with pytest.raises(LinkLost, match=words):
            connected(port=server.port, timeout="200 ms")
        transport, _, _ = connected(port=server.port, echo=False)
        transport.write({"target": 3, "valve": 1})
        assert transport.read(list(TRUTH)) == pytest.approx(TRUTH)
        assert far.words["holding"][20] == 3
        transport.close()


def test_a_slow_device(connected: Callable) -> None:
    far = device(delay=0.3)
    with served(far) as server:
        with pytest.raises(LinkLost, match=r"the device does not answer in 0\.2 s"):
            connected(port=server.port, timeout="200 ms")
        groups = {"fast": {"every": "20 ms", "stale": "2 s"}}
        transport, _, lost = connected(port=server.port, timeout="1 s", groups=groups)
        assert transport.read(["height"]) == {"height": -12.34}
        assert lost == []
        assert any("s to read, longer than every = 0.02 s" in one.text for one in transport.remarks())
        transport.close()


# -- whatever the quirk ------------------------------------------------------------------------------------------------

FORMATS = {
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "float32": "f",
    "int64": "q",
    "float64": "d",
}


@st.composite
def points_and_truth(draw: st.DrawFn) -> tuple[dict, dict, Device]:
    """Points of any type in the tables, with gaps between them, and their values by Python's own struct."""
    far, points, truth, address = Device(), {}, {}, draw(st.integers(0, 20))
    for k in range(draw(st.integers(1, 12))):
        kind = draw(st.sampled_from(list(FORMATS)))
        low, swapped = draw(st.booleans()), draw(st.booleans())
        size = struct.calcsize(FORMATS[kind]) // 2
        data = draw(st.binary(min_size=2 * size, max_size=2 * size))
        (value,) = struct.unpack(f">{FORMATS[kind]}", data)
        words = [data[2 * k : 2 * k + 2] for k in range(size)]
        words = words[::-1] if low else words
        far.words["input"][address : address + size] = [
            int.from_bytes(word, "little" if swapped else "big") for word in words
        ]
        null = draw(st.sampled_from([None, value])) if not math.isnan(value) and abs(value) < 1e300 else None
        points[f"p{k}"] = {
            "table": "input",
            "address": address,
            "type": kind,
            "group": "fast",
            "word_order": "low" if low else "high",
            "byte_order": "little" if swapped else "big",
            **({} if null is None else {"null": null}),
        }
        truth[f"p{k}"] = math.nan if null is not None else float(value)
        address += size + draw(st.integers(0, 2))
    return points, truth, far


@settings(max_examples=60, deadline=None)
@given(
    made=points_and_truth(),
    request_max=st.sampled_from([125, 16, 4, 2, 1]),
    said=st.sampled_from([125, 16, 4]),
    too_many=st.sampled_from([2, 3, 0]),
    gap=st.integers(0, 2),
    hole=st.integers(0, 60),
    busy=st.sampled_from([0, 2, 3]),
    other=st.booleans(),
    echo=st.booleans(),
)
def test_every_reading_is_the_truth_or_no_reading(
    made, request_max, said, too_many, gap, hole, busy, other, echo
) -> None:
    points, truth, far = made
    far.request_max, far.too_many, far.holes = request_max, too_many, frozenset([hole])
    far.busy = (lambda count: count % busy == 0) if busy else (lambda count: False)
    far.number = (lambda asked: asked + 1) if other else (lambda asked: asked)
    groups = {"fast": {"every": "20 ms", "stale": "400 ms", "gap": gap}}
    try:
        stand = DeviceRig(far, points=points, groups=groups, request_max=said, echo=echo)
        with stand:
            stand.wait(0.2)
            read = stand.transport.read(list(points))
    except (BenchError, WiringError) as error:
        assert len(str(error)) > 20
        return
    for found in (read, *(received for _, received in stand.heard)):
        for name, value in found.items():
            assert value == truth[name] or (math.isnan(value) and math.isnan(truth[name])), name
