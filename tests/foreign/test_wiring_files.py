"""The wiring files of both rigs, only over their transports: read and written values have the right meaning."""

import tomllib
from pathlib import Path

import pytest

from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS
from drivers.errors import Refused
from drivers.wiring.description import read_description
from drivers.wiring.transports import open_transport
from tests.foreign import AT_REST, wiring_file
from tests.foreign.virtual import VirtualHall, VirtualPlc

pytestmark = pytest.mark.timeout(300)  # who comes first compiles the model
HERE = Path(__file__).parent


@pytest.mark.parametrize(
    ("name", "missing"),
    [
        ("plant_a", {"left.auxiliary_temperature", "right.auxiliary_temperature", "lateral.acceleration"}),
        ("hall_b", {"lateral.force", "lateral.force_setpoint", "lateral.acceleration"}),
    ],
)
def test_a_wiring_says_of_every_measurement_and_setting_where_it_is_or_why_not(name, missing):
    description = read_description(wiring_file(name), TABLE)
    absent = {one: why for one, why in description.absent.items() if why != "the wiring does not mention it"}
    assert set(absent) == missing | {"rig.pipe"}
    told = {
        *description.sources,
        *description.setpoints,
        *description.settings,
        *absent,
        *description.played,
    }
    forgotten = {
        signal.name
        for signal in TABLE.signals
        if signal.name not in told
        and signal.kind is not Kind.FURTHER
        and not signal.name.startswith(("rig.", "emergency.", "control.", "lease."))
    }
    assert {one.partition(".")[0] for one in forgotten} == {"action", "interlock", "car"}


def test_the_registers_of_rig_a_over_modbus():
    virtual = VirtualPlc()
    path = wiring_file("plant_a")
    table = tomllib.loads(path.read_text())["transports"]["plc"]
    transport = open_transport("plc", table, path.parent, port=virtual.port)
    received, lost = [], []
    transport.connect(virtual.clock, lost.append, within=1.0)
    transport.subscribe(lambda time, points: received.append((time, dict(points))))

    def wait(seconds):
        virtual.clock.sleep_until(virtual.clock.now() + round(seconds * NS))
        return received[-1][1]

    seen = wait(1.0)
    assert len(received) == 20
    assert 400 - seen["laser_left"] == pytest.approx(AT_REST["plant_a"], abs=0.2)
    assert seen["cell_1"] == pytest.approx(900 * 9.80665 / 4, abs=250)
    wait(transport.begin())  # it accepts only clients with a heartbeat
    transport.write({"request": 2})
    assert wait(0.6)["state"] == 2
    transport.write({"request": 0, "join_left": 0, "plates": 16.0})
    wait(0.1)
    assert transport.read(["join_left_is", "join_right_is", "plates_are"]) == {
        "join_left_is": 0,
        "join_right_is": 1,
        "plates_are": 13.0,  # only at rest
    }
    with pytest.raises(Refused):
        transport.write({"target_left": 9500})
    transport.close()
    assert not lost


def test_the_frames_of_rig_b_over_can():
    virtual = VirtualHall()
    description = read_description(wiring_file("hall_b"), TABLE)
    table, functions = description.transports["bus"], description.functions
    transport = open_transport("bus", table, HERE / "hall_b", functions=functions, port=virtual.port)
    received, times = {}, []

    def receive(time, points):
        received.update(points)
        times.append(time)

    transport.connect(virtual.clock, lambda reason: None, within=1.0)
    transport.subscribe(receive)
    start = virtual.clock.now()
    virtual.clock.sleep_until(1 * NS)
    # Simultaneous samples arrive in consecutive frames, and have one time.
    assert len(times) > 7 * len(set(times))
    assert len(set(times)) == pytest.approx(100 * (1 - start / NS), abs=1)
    assert received["Heights.HeightLeft"] == pytest.approx(AT_REST["hall_b"], abs=0.2)
    assert received["CellsB.Cell4"] == pytest.approx(-2400 / 4, abs=30)
    assert received["Air.ChamberRight"] == pytest.approx(101.325, abs=3)
    virtual.clock.sleep_until(
        virtual.clock.now() + round(transport.begin() * NS)
    )  # it must receive a heartbeat
    transport.write({"Parameter.ValveLeft": 2, "Parameter.TargetLeft": 250.0, "Command.Request": 17})
    virtual.clock.sleep_until(round(1.5 * NS))
    assert (
        received["ParameterIs.ValveLeft"],
        received["ParameterIs.TargetLeft"],
        received["Status.State"],
    ) == (
        2,
        250,
        1,
    )
    assert (virtual.rig.ignored, transport.counts) == (0, {})

    sound = virtual.rig.cycle

    def garbled():
        identifier, data = sound()[0]
        return [(identifier, bytes([data[0] ^ 1]) + data[1:])]

    virtual.rig.cycle = garbled
    virtual.clock.sleep_until(round(1.7 * NS))
    assert transport.counts == {"Heights": {"corrupt": 20}}
    transport.close()
