"""Clients of other people talk to a running rig: python-can, cantools, AUTOSAR's E2E, pymodbus, mbpoll."""

import re
import shutil
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from importlib.resources import files

import can
import cantools
import e2e.p01
import numpy as np
import pytest
from pymodbus.client import ModbusTcpClient

from bench_protocol.can_codec import Decoder
from bench_protocol.canopen import HEARTBEAT_IDENTIFIER
from bench_protocol.frames import frame
from bench_protocol.registers import ACTIVE_BLOCK, LEASE_ADDRESS, PROBE_FLOAT, PROBE_WORD
from bench_protocol.table import TABLE
from bench_protocol.units import bar, mm

REAL = ("tcp", pytest.param("socketcan", marks=pytest.mark.vcan))
on_real_wires = pytest.mark.parametrize("site", REAL, indirect=True)
on_tcp = pytest.mark.parametrize("site", ["tcp"], indirect=True)
needs_mbpoll = pytest.mark.skipif(
    not shutil.which("mbpoll"), reason="mbpoll is not installed (apt install mbpoll)"
)
ADDRESS = {(r.signal, r.encoding): r.address for r in TABLE.registers}


@pytest.fixture(scope="module")
def database() -> cantools.database.Database:
    return cantools.database.load_file(str(files("bench_protocol") / "generated" / "astb.dbc"))


@pytest.fixture
def bus(site) -> Iterator[can.BusABC]:
    """python-can's own client of the bus."""
    site.close_shared()
    if site.transport == "tcp":
        bus = can.Bus(
            interface="socketcand",
            channel="vcan0",
            host="127.0.0.1",
            port=site.rig.can_port,
            tcp_tune=True,
            ignore_config=True,
        )
    else:
        bus = can.Bus(interface="socketcan", channel="vcan0", ignore_config=True)
    yield bus
    bus.shutdown()


@pytest.fixture
def client(site) -> Iterator[ModbusTcpClient]:
    """pymodbus as it comes."""
    site.close_shared()
    client = ModbusTcpClient("127.0.0.1", port=site.rig.modbus_port, timeout=2)
    assert client.connect()
    yield client
    client.close()


def read_float(client: ModbusTcpClient, name: str) -> float:
    words = client.read_input_registers(ADDRESS[name, "float32"], count=2).registers
    return client.convert_from_registers(words, client.DATATYPE.FLOAT32)


def collected(bus: can.BusABC, seconds: float) -> list[can.Message]:
    end, messages = time.monotonic() + seconds, []
    while time.monotonic() < end:
        if (message := bus.recv(0.1)) is not None:
            messages.append(message)
    return messages


@on_real_wires
def test_cantools_decodes_all_that_a_stock_client_hears(bus, client, database):
    # The heartbeat is CANopen's alone.
    messages = [one for one in collected(bus, 0.6) if one.arbitration_id != HEARTBEAT_IDENTIFIER]
    counts = {m.name: sum(x.arbitration_id == m.identifier for x in messages) for m in TABLE.messages}
    for message in TABLE.messages:
        if message.from_rig and message.rate:
            assert counts[message.name] > 0.5 * 0.6 * message.rate, message.name
    ours = Decoder(TABLE, from_rig=True)
    for message in messages:
        theirs = database.decode_message(message.arbitration_id, message.data, decode_choices=False)
        samples = ours.decode(frame(message.arbitration_id, bytes(message.data)))
        for row, value in zip(samples.signals, samples.values, strict=True):
            signal = TABLE.signals[row]
            # The DBC is in the units that people read; without a value it has the code that says so.
            if not np.isnan(value):
                shown = (
                    float(signal.show(value).split()[0])
                    if signal.unit != "1" and not signal.choices
                    else value
                )
                assert theirs[_name_in(theirs, signal.name)] == pytest.approx(shown, rel=1e-5, abs=1e-9), (
                    signal.name
                )
    assert ours.tally.tolist()[1:] == [0] * (len(ours.tally) - 1), (
        "nothing unknown, malformed, lost or repeated"
    )
    assert read_float(client, "rig.map_hash") == pytest.approx(TABLE.map_hash, rel=1e-6)
    last = {x.arbitration_id: x for x in messages}[0x181]
    decoded = database.decode_message(0x181, last.data)
    assert decoded["left_height"] == pytest.approx(read_float(client, "left.height") / mm, abs=0.1)
    assert decoded["left_bellows_pressure"] == pytest.approx(
        read_float(client, "left.bellows_pressure") / bar, abs=0.02
    )


def _name_in(decoded: dict, name: str) -> str:
    """Names longer than 32 characters are shortened in a DBC."""
    flat = name.replace(".", "_")
    return flat if flat in decoded else next(key for key in decoded if flat.startswith(key))


class ForeignCommander:
    """Streams commands that cantools encodes and e2e protects; of ours it knows the DBC and the map."""

    def __init__(self, bus: can.BusABC, database: cantools.database.Database) -> None:
        self.bits = dict.fromkeys(("control_enable", "control_hold", "control_active", "control_reset"), 0)
        self.platform = 0.0  # mm
        self.token = 0
        self._bus, self._database = bus, database
        self._counters: dict[str, int] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        start = time.monotonic()
        cycle = 0
        while not self._stop.is_set():
            self._send("Control", {"control_token": self.token, **self.bits})
            axes = {"platform_lateral_setpoint": 0, "platform_roll_setpoint": 0}
            self._send("PlatformSetpoints", {"platform_vertical_setpoint": self.platform, **axes})
            cycle += 1
            time.sleep(max(0.0, start + cycle * 0.02 - time.monotonic()))

    def _send(self, name: str, values: dict[str, float]) -> None:
        message = self._database.get_message_by_name(name)
        counter = self._counters[name] = (self._counters.get(name, -1) + 1) % 15
        data = bytearray(message.encode({"e2e_crc": 0, "e2e_counter": counter, **values}))
        data_id = message.dbc.attributes["E2EDataID"].value
        if message.dbc.attributes["E2EToken"].value == "data id":
            data_id ^= self.token
        e2e.p01.e2e_p01_protect(data, data_id, increment_counter=False)
        self._bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


@on_real_wires
def test_a_commander_made_of_foreign_parts_arms_and_moves_the_bench(bus, client, database, eventually):
    def state() -> str:
        code = client.read_input_registers(ADDRESS["rig.state", "int16"], count=1).registers[0]
        return TABLE["rig.state"].choices[code]

    def within(wanted: str) -> None:
        eventually(lambda: state() == wanted, what=wanted)

    commander = ForeignCommander(bus, database)
    try:
        assert not client.write_registers(LEASE_ADDRESS, [1]).isError()
        (commander.token,) = client.read_holding_registers(LEASE_ADDRESS, count=1).registers
        commander.bits["control_enable"] = 1
        time.sleep(0.4)  # an earlier commander may have left any counters
        if state().startswith("FAULT"):
            commander.bits["control_reset"] = 1
            within("DISABLED")
            commander.bits["control_reset"] = 0
            time.sleep(0.1)
        within("DISABLED")
        commander.bits["control_reset"] = 1
        within("AIR_LOW")
        assert not client.write_coil(ADDRESS["action.air_high", "bit"], True).isError()
        within("AIR_HIGH")
        commander.bits["control_hold"] = 1
        within("HOLD")
        commander.bits["control_active"] = 1
        within("ACTIVE")
        commander.platform = 6.0
        eventually(lambda: read_float(client, "platform.vertical") == pytest.approx(6 * mm, abs=0.1 * mm))
        commander.platform = 0.0
        eventually(lambda: read_float(client, "platform.vertical") == pytest.approx(0, abs=0.1 * mm))
        commander.bits["control_enable"] = 0
        within("DISABLED")
        assert not client.write_registers(LEASE_ADDRESS, [0]).isError()
    finally:
        commander.stop()


@on_tcp
def test_pymodbus_reads_all_tables_and_hears_the_right_refusals(client):
    probes = client.read_input_registers(3, count=4).registers
    assert client.convert_from_registers(probes[:2], client.DATATYPE.FLOAT32) == pytest.approx(PROBE_FLOAT)
    assert client.convert_from_registers(probes[2:], client.DATATYPE.UINT32) == PROBE_WORD
    assert client.read_coils(0, count=10).bits[:10] == [False] * 10
    assert len(client.read_discrete_inputs(0, count=7).bits) >= 7
    identity = client.read_device_information(read_code=3, object_id=0).information
    assert identity[0] == b"ASTB"
    assert identity[0x80] == f"{TABLE.map_hash:08x}".encode()
    setting = ADDRESS["air.left_target", "float32"]
    too_high = list(struct.unpack(">HH", struct.pack(">f", 99 * bar)))
    refusals = {
        "outside the map": (client.read_input_registers(60_000, count=1), 2),
        "half a number": (client.read_holding_registers(setting, count=1), 3),
        "out of range": (client.write_registers(setting, too_high), 3),
        "not now": (client.write_coil(ADDRESS["action.air_high", "bit"], True), 4),
    }
    for what, (answer, code) in refusals.items():
        assert (answer.isError(), answer.exception_code) == (True, code), what


@pytest.fixture
def mbpoll(site) -> Callable[..., str]:
    """Run mbpoll once with 0-based addresses; return what it printed."""
    site.close_shared()

    def run(*arguments: str) -> str:
        fixed = ["mbpoll", "-0", "-1", "-q", "-a", "1", "-m", "tcp", "-p", str(site.rig.modbus_port)]
        done = subprocess.run([*fixed, *arguments], capture_output=True, text=True, timeout=20, check=False)
        return done.stdout + done.stderr

    return run


def numbers(text: str) -> list[float]:
    return [float(value) for value in re.findall(r"^\[\d+\]:\s+(\S+)", text, re.MULTILINE)]


@needs_mbpoll
@on_tcp
def test_mbpoll_reads_and_sets_the_bench(mbpoll, client):
    here = "127.0.0.1"
    assert numbers(mbpoll("-t", "3:float", "-B", "-r", "3", "-c", "1", here)) == pytest.approx(
        [PROBE_FLOAT], rel=1e-5
    )
    place = ADDRESS["left.auxiliary_temperature", "float32"]
    (temperature,) = numbers(mbpoll("-t", "3:float", "-B", "-r", str(place), "-c", "1", here))
    assert temperature == pytest.approx(read_float(client, "left.auxiliary_temperature"), abs=0.5)
    setting = str(ADDRESS["generator.frequency", "float32"])
    assert "Written 1 references" in mbpoll("-t", "4:float", "-B", "-r", setting, here, "2.5")
    active = str(ADDRESS["generator.frequency", "float32"] + ACTIVE_BLOCK)
    (before,) = numbers(mbpoll("-t", "3:float", "-B", "-r", active, "-c", "1", here))
    assert "Written 1 references" in mbpoll("-t", "0", "-r", str(ADDRESS["action.apply", "bit"]), here, "1")
    assert numbers(mbpoll("-t", "4:float", "-B", "-r", setting, "-c", "1", here)) == [before] != [2.5], (
        "what it staged went with its connection"
    )
    assert not client.write_registers(
        int(setting), list(struct.unpack(">HH", struct.pack(">f", 2.5)))
    ).isError()
    assert numbers(mbpoll("-t", "4:float", "-B", "-r", setting, "-c", "1", here)) == [2.5]
    assert numbers(mbpoll("-t", "3:float", "-B", "-r", active, "-c", "1", here)) == [before]
    assert not client.write_coil(ADDRESS["action.apply", "bit"], True).isError()
    assert numbers(mbpoll("-t", "3:float", "-B", "-r", active, "-c", "1", here)) == [2.5]
    refused = mbpoll("-t", "4:float", "-B", "-r", setting, here, "99")
    assert "Illegal data value" in refused
    assert client.write_registers(LEASE_ADDRESS, [5]).isError() is False
    assert "failed" in mbpoll("-t", "4:float", "-B", "-r", setting, here, "1"), (
        "another commander holds the bench"
    )
    client.write_registers(LEASE_ADDRESS, [0])
