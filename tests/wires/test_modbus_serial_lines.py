"""Modbus over serial lines: frames of RTU over TCP, two devices on one line, and lines that cannot be."""

import contextlib
from collections.abc import Callable

import pytest

from bench_protocol.clock import RealClock
from drivers.errors import LinkLost, WiringError
from drivers.wiring.modbus.transport import ModbusTransport
from tests.foreign.quirky_modbus import on_a_line, served
from tests.refusals import refuses
from tests.wires.test_quirky_modbus import KEYS, TRUTH, device

RTU = {key: said for key, said in KEYS.items() if key != "host"} | {
    "kind": "modbus_rtu",
    "timeout": "1 s",
    "patience": "2 s",
}


def rtu(**changes: object) -> ModbusTransport:
    return ModbusTransport("drive", {**RTU, **changes})


def test_frames_of_a_serial_line_over_tcp() -> None:
    far = device(unit=7)
    with served(far, rtu=True) as server:
        transport = rtu(host="127.0.0.1", port=server.port, unit=7)
        transport.connect(RealClock(), pytest.fail, within=1.0)
        transport.write({"target": 3, "place": -70000, "valve": 1})
        assert transport.read(list(TRUTH)) == pytest.approx(TRUTH)
        assert transport.read(["place"]) == {"place": -70000}
        transport.close()
        with refuses(LinkLost, "answer"):
            rtu(host="127.0.0.1", port=server.port, unit=8, timeout="100 ms").connect(
                RealClock(), pytest.fail, within=1.0
            )


@pytest.mark.parametrize("medium", ["line", "raw stream", "numbered"])
@pytest.mark.parametrize(
    "late", [1.3, *(pytest.param(late, marks=pytest.mark.slow) for late in (1.9, 2.4, 3.5))]
)
def test_a_late_answer_is_never_taken_for_another_one(
    medium: str, late: float, eventually: Callable[..., object]
) -> None:
    """One request, one answer, and nothing in it but a number of registers: every fourth comes after its time-out."""
    pytest.importorskip("serial")
    timeout = 0.06
    far = device(late=lambda count: late * timeout if count > 8 and count % 4 == 0 else 0.0)
    truth = {f"at_{at}": 1000.0 + at for at in (100, 200, 300)}
    for name, value in truth.items():
        far.words["input"][int(name[3:])] = int(value)
    points = {
        name: {"table": "input", "address": int(name[3:]), "type": "uint16", "group": "fast"}
        for name in truth
    }
    keys = {"timeout": "60 ms", "patience": "5 s", "groups": {"fast": {"every": "5 ms"}}, "points": points}
    with contextlib.ExitStack() as stack:
        if medium == "line":
            keys["line"] = stack.enter_context(on_a_line(far))
        else:
            server = stack.enter_context(served(far, rtu=medium != "numbered", gateway=True))
            keys |= {"host": "127.0.0.1", "port": server.port}
            keys["kind"] = "modbus" if medium == "numbered" else "modbus_rtu"
        transport = rtu(**keys)
        received: list[dict] = []
        transport.subscribe(lambda at, points: received.append(dict(points)))
        stack.callback(transport.close)
        transport.connect(RealClock(), pytest.fail, within=1.0)
        eventually(lambda: transport.counts["discarded"] >= 3 and len(received) > 20, within=20.0)
        assert any("late answers were discarded" in one.text for one in transport.remarks())
    assert [(name, value) for one in received for name, value in one.items() if value != truth[name]] == []


@pytest.mark.parametrize("echo", [False, True])
def test_two_devices_on_one_serial_line(echo: bool) -> None:
    pytest.importorskip("serial")
    one, two = device(unit=1), device(unit=2)
    two.words["input"][10] = 500
    groups = {"fast": {"every": "100 ms", "stale": "1 s"}}
    with on_a_line(one, two, echo=echo) as line:
        keys = {"line": line, "baudrate": 115200, "groups": groups, "local_echo": echo}
        first, second = rtu(**keys), rtu(**keys, unit=2)
        for transport in (first, second):
            transport.connect(RealClock(), pytest.fail, within=1.0)
        second.write({"target": 3, "place": -70000})
        assert first.read(list(TRUTH)) == pytest.approx(TRUTH)
        assert second.read(["height", "place"]) == {"height": 5.0, "place": -70000}
        assert one.words["holding"][20] == 0
        first.close()
        assert second.read(["target"]) == {"target": 3.0}
        second.close()


def test_a_line_that_is_not_there() -> None:
    pytest.importorskip("serial")
    with refuses(LinkLost, "/dev/nowhere"):
        rtu(line="/dev/nowhere").connect(RealClock(), pytest.fail, within=1.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, 'line "/dev/ttyUSB0"'),
        ({"line": "/dev/x", "host": "y"}, "line host remove"),
        ({"line": "/dev/x", "port": 502}, "TCP"),
        ({"host": "y", "baudrate": 9600}, "baudrate"),
        ({"line": "/dev/x", "parity": "evn"}, "parity 'evn' 'even'"),
    ],
)
def test_invalid_serial_lines_are_refused(changes: dict, words: str) -> None:
    with refuses(WiringError, words):
        rtu(**changes)
