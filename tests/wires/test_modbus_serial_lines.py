"""Modbus over serial lines: frames of RTU over TCP, two devices on one line, and lines that cannot be."""

import pytest

from bench_protocol.clock import RealClock
from drivers.errors import LinkLost, WiringError
from drivers.wiring.modbus.transport import ModbusTransport
from tests.foreign.quirky_modbus import on_a_line, served
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
        with pytest.raises(LinkLost, match="does not answer"):
            rtu(host="127.0.0.1", port=server.port, unit=8, timeout="100 ms").connect(
                RealClock(), pytest.fail, within=1.0
            )


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
    with pytest.raises(LinkLost, match=r"the serial line /dev/nowhere cannot be opened: is it there"):
        rtu(line="/dev/nowhere").connect(RealClock(), pytest.fail, within=1.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, 'right is one of line = "/dev/ttyUSB0"'),
        ({"line": "/dev/x", "host": "y"}, 'right is one of line = "/dev/ttyUSB0"'),
        ({"line": "/dev/x", "port": 502}, "port and connection are for TCP"),
        ({"host": "y", "baudrate": 9600}, "baudrate is for a serial line"),
        ({"line": "/dev/x", "parity": "evn"}, "parity = 'evn': did you mean 'even'"),
    ],
)
def test_a_line_that_cannot_be(changes: dict, words: str) -> None:
    with pytest.raises(WiringError, match=words):
        rtu(**changes)
