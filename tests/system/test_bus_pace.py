"""A rig whose bus takes its time: the same bench, armed over the same wires, in real and in virtual time."""

import math
import re

import numpy as np
import pytest

from astb.rig_file import SimulatedCan, Simulation
from astb.rig_in_memory import RigInMemory
from astb.run import undisturbed
from astb.session import build_rig, bus_stages, virtual_session
from bench_protocol.clock import RealClock
from bench_protocol.frames import Block, join
from bench_protocol.table import TABLE
from bench_protocol.units import mm, ms
from bench_sim.rig.frame_time import frame_bits
from bench_sim.rig.registers import BUS_NOTE
from drivers.bench import Bench
from drivers.can_port import open_can
from drivers.modbus_port import ModbusPort, open_modbus
from drivers.wiring.own import own_wiring

ROOM = ("--can", "tcp", "--can-port", "0", "--modbus-port", "0")
BIT = 2000  # ns, at 500 kbit/s


def bus_note(modbus: ModbusPort) -> tuple[float, int]:
    """Return the load of the bus and the bench's errors, as anybody can ask for them."""
    text = modbus.identification()[BUS_NOTE].decode()
    found = re.fullmatch(r"CAN bus load ([\d.]+)%, (\d+) transmit errors", text)
    assert found, text
    return float(found[1]) / 100, int(found[2])


def assert_one_after_the_other(heard: Block, slack: int) -> None:
    """Between the ends of two frames lies at least the whole of the second, intermission included."""
    assert heard.size > 500
    gaps = np.diff(heard["time"])
    assert (gaps >= frame_bits(heard[1:]) * BIT - slack).all()
    assert (gaps < 3 * 135 * BIT).sum() > 100, "frames of one tick follow each other at once"


@pytest.mark.slow
def test_over_sockets_frames_come_one_after_the_other_and_the_bench_arms(start_rig) -> None:
    rig = start_rig(*ROOM, "--bit-rate", "500k")
    clock = RealClock()
    listener = open_can("tcp", port=rig.can_port)
    blocks: list[Block] = []
    listener.subscribe(blocks.append)
    modbus = open_modbus("127.0.0.1", rig.modbus_port, timeout=2.0)
    with undisturbed(), Bench(own_wiring(open_can("tcp", port=rig.can_port), modbus), clock) as bench:
        bench.arm()
        bench.wait(0.3)
        load, errors = bus_note(modbus)
    listener.close()
    # The hub writes times in whole microseconds.
    assert_one_after_the_other(join(blocks), slack=1000)
    assert 0.6 * TABLE.bus_load < load <= TABLE.bus_load
    assert errors == 0
    assert rig.stop() == ""


def test_a_bad_bus_is_tolerated_and_reported_in_virtual_time() -> None:
    simulation = Simulation(can=SimulatedCan(bit_rate="500k", error_rate=0.02))
    rig = build_rig(simulation)
    with virtual_session(rig, simulation) as session, session.bench as bench:
        bench.arm()
        bench.wait(1.5)
        assert bench.state == "ACTIVE"
        load, errors = bus_note(RigInMemory(rig).modbus())
    assert 0.3 < load < 0.6
    assert 0 <= errors < 128


def test_a_rig_that_spoils_its_frames_goes_off_the_bus_comes_back_and_has_held_meanwhile() -> None:
    """With a restart after 300 ms nothing is heard from it, nor by it: its watchdog takes that for a lost commander."""
    simulation = Simulation(can=SimulatedCan(bit_rate="500k", restart=0.3))
    rig = build_rig(simulation)
    (pace,) = bus_stages(rig, simulation)
    memory = RigInMemory(rig)
    memory.bus.add(pace)
    with memory.bench() as bench:
        bench.arm()
        pace.spoil("rig", 32)
        with bench.despite_faults():
            bench.wait(200 * ms)
            assert math.isnan(bench.left.height), "stale"
            bench.wait(0.5)
            assert bench.state == "FAULT_HOLD"
            assert abs(bench.left.height) < 300 * mm
    assert rig.contact("fault")


@pytest.mark.parametrize("text", ["fast", "500 k", "-1", "2M", "nan"])
def test_a_bit_rate_that_cannot_be_is_named(astb_here, rig_file, tmp_path, text) -> None:
    code, _, err = astb_here(tmp_path, "rig", "--rig", rig_file, "--bit-rate", text)
    assert code == 2
    assert "bit_rate = " in err
