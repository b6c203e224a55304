"""Messages and actions of both foreign rigs, received by third-party clients: cantools and pymodbus."""

import threading
from pathlib import Path

import cantools
import pytest
from pymodbus.client import ModbusTcpClient

from tests.foreign import can_rig, plc_rig
from tests.foreign.can_rig import CanRig, checksum
from tests.foreign.modbus_server import Server
from tests.foreign.plc_rig import PlcRig

pytestmark = pytest.mark.timeout(300)  # who comes first compiles the model
DBC = cantools.database.load_file(Path(__file__).parent / "hall_b" / "hall_b.dbc")


class Hall:
    """A client with a DBC on the bus of rig B."""

    def __init__(self):
        self.rig, self.heard = CanRig(seed=1), {}
        self.counter = 0

    def send(self, name, **values):
        message = DBC.get_message_by_name(name)
        self.counter += 1
        data = bytearray(message.encode({"Alive": self.counter & 0xF, "Check": 0} | values, strict=False))
        data[7] = checksum(message.frame_id, bytes(data))
        self.rig.receive(message.frame_id, bytes(data))

    def run(self, seconds, beating=True):
        for cycle in range(round(seconds * 100)):
            if beating and cycle % 10 == 0:
                self.send("Heartbeat")
            for identifier, data in self.rig.cycle():
                assert data[7] == checksum(identifier, data)
                message = DBC.get_message_by_frame_id(identifier)
                self.heard |= message.decode(data, decode_choices=False)
        return self.heard


@pytest.fixture
def hall():
    made = Hall()
    made.run(0.3)
    return made


def test_cantools_reads_what_the_firmware_packs(hall):
    received, read = hall.heard, hall.rig.machine.read
    assert received["HeightLeft"] == pytest.approx(1e3 * read("left_height"), abs=0.006)
    assert received["PositionRight"] == pytest.approx(1e3 * read("vertical_right_displacement"), abs=0.006)
    assert received["Cell4"] == pytest.approx(-read("load_cell_4") / 9.80665, abs=0.3)
    assert received["Cell6"] == pytest.approx(-read("load_cell_6") / 9.80665, abs=0.06)
    assert received["BellowsRight"] == pytest.approx(101.325, abs=3)
    assert received["Supply"] == pytest.approx(101.325, abs=10)
    assert received["GasChamberRight"] == pytest.approx(read("right_auxiliary_temperature") - 273.15, abs=0.5)
    assert received["PlatformRoll"] == pytest.approx(0.0, abs=0.2)
    assert (received["State"], received["VerticalMode"], received["Plates"]) == (0, 1, pytest.approx(13.0))


def test_rig_b_operates_while_a_heart_beats_and_halts_when_it_stops(hall):
    hall.send("Command", Request=34)
    assert hall.run(0.1)["State"] == 0, "one thing after the other"
    hall.send("Command", Request=17)
    hall.run(0.1)
    hall.send("Command", Request=34)
    assert hall.run(0.1)["State"] == 2
    start = hall.heard["PositionLeft"]
    for step in range(100):
        hall.send("SetPositions", SetLeft=start + 0.2 * step, SetRight=start + 0.2 * step, SetLateral=0.0)
        hall.run(0.01)
    assert hall.run(0.2)["PositionLeft"] == pytest.approx(start + 19.8, abs=0.5)
    hall.run(0.6, beating=False)
    assert (hall.heard["State"], hall.heard["Fault"]) == (5, 3)
    assert hall.run(2.1, beating=False)["State"] == 6
    hall.send("Command", Request=68)
    assert (hall.run(0.1)["State"], hall.heard["Fault"]) == (0, 0)


def test_rig_b_ignores_what_is_garbled_or_out_of_range(hall):
    message = DBC.get_message_by_name("Command")
    hall.rig.receive(message.frame_id, message.encode({"Request": 17, "Alive": 3, "Check": 0}))
    assert (hall.run(0.1)["State"], hall.rig.ignored) == (0, 1)
    hall.send("Parameter", Index=11, Plates=45.0)
    hall.send("Parameter", Index=4, ValveRight=2)
    received = hall.run(0.3)
    assert (received["Plates"], received["ValveRight"]) == (pytest.approx(13.0), 2)


@pytest.fixture
def served():
    rig = PlcRig(seed=1)
    with Server(0, rig.answer) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        client = ModbusTcpClient("127.0.0.1", port=server.port, timeout=2)
        assert client.connect()
        try:
            yield rig, client
        finally:
            client.close()
            server.shutdown()


def numbers(client, address, count):
    words = client.read_input_registers(address, count=2 * count).registers
    return client.convert_from_registers(words, client.DATATYPE.INT32, word_order="little")


def run_plc(rig, client, seconds, counting=True):
    for cycle in range(round(20 * seconds)):
        if counting and cycle % 2 == 0:
            client.write_register(1, client.read_holding_registers(1, count=1).registers[0] + 1)
        rig.cycle()
    return client.read_input_registers(0, count=4).registers


def ask(rig, client, request):
    client.write_register(0, request)
    acknowledged = run_plc(rig, client, 0.1)[2]
    client.write_register(0, 0)
    run_plc(rig, client, 0.1)
    return acknowledged


def test_pymodbus_reads_what_rig_a_publishes(served):
    rig, client = served
    run_plc(rig, client, 0.5)
    read = rig.machine.read
    lasers = client.read_input_registers(10, count=2).registers
    assert 400 - 0.01 * lasers[0] == pytest.approx(1e3 * read("left_height"), abs=0.006)
    assert numbers(client, 32, 6) == [round(read(f"load_cell_{cell}")) for cell in range(1, 7)]
    assert numbers(client, 26, 3)[0] == pytest.approx(1e6 * read("vertical_left_displacement"), abs=1)
    assert client.read_discrete_inputs(0, count=1).bits[0] is False
    assert client.read_input_registers(60, count=9).registers == [1, 1, 0, 0, 0, 0, 7, 5350, 130]


def test_rig_a_answers_single_requests_and_stops_without_a_counter(served):
    rig, client = served
    assert ask(rig, client, 3) == 3 | 0x80, "one thing after the other"
    assert ask(rig, client, 2) == 2
    assert run_plc(rig, client, 0.5)[1] == plc_rig.State.READY
    start = numbers(client, 26, 3)
    client.write_registers(20, client.convert_to_registers(start, client.DATATYPE.INT32, word_order="little"))
    assert ask(rig, client, 3) == 3
    for step in range(20):
        goal = [start[0] + 1000 * step, start[1] + 1000 * step, start[2]]
        words = client.convert_to_registers(goal, client.DATATYPE.INT32, word_order="little")
        client.write_registers(20, words)
        run_plc(rig, client, 0.05)
    run_plc(rig, client, 0.3)
    assert numbers(client, 26, 3)[0] == pytest.approx(start[0] + 19_000, abs=500)
    assert run_plc(rig, client, 0.7, counting=False)[1:4:2] == [
        plc_rig.State.QUICK_STOP,
        plc_rig.Fault.WATCHDOG,
    ]
    assert run_plc(rig, client, 3.2, counting=False)[1] == plc_rig.State.FAULT
    assert ask(rig, client, 4) == 4
    assert run_plc(rig, client, 0.1)[1:4:2] == [plc_rig.State.STOP, plc_rig.Fault.NONE]


def test_rig_a_refuses_numbers_and_addresses_that_it_does_not_have(served):
    _, client = served
    assert client.write_registers(4, [1, 3]).exception_code == 3
    assert client.write_register(40, 0).exception_code == 2
    assert client.read_input_registers(60, count=20).exception_code == 2
    assert client.read_coils(0, count=1).exception_code == 2
    assert client.read_holding_registers(4, count=2).registers == [0, 0]


def test_both_let_the_air_off_before_they_let_go():
    hall = Hall()
    hall.run(0.3)
    hall.send("Command", Request=17)
    hall.run(0.1)
    for index, (name, value) in enumerate(
        {"TargetLeft": 300.0, "TargetRight": 300.0}.items(), can_rig.TO_LEFT
    ):
        hall.send("Parameter", Index=index, **{name: value})
    for index, name in enumerate(("ValveLeft", "ValveRight"), can_rig.LEFT):
        hall.send("Parameter", Index=index, **{name: 2})
    assert hall.run(12)["BellowsLeft"] == pytest.approx(300.0, abs=5)
    hall.send("Command", Request=51)
    height = hall.heard["HeightLeft"]
    assert hall.run(0.5)["HeightLeft"] == pytest.approx(height, abs=2), "it does not jump"
    assert hall.run(20)["BellowsLeft"] < 125
    assert hall.heard["ForceLeft"] == pytest.approx(0.0, abs=0.5)
