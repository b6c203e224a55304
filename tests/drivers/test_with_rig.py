"""The drivers and the simulated rig meet on the wire, in virtual time."""

from types import SimpleNamespace

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.units import NS, Hz, bar, kN, minutes, mm, s
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from drivers.errors import Misuse, Refused, RigFault
from drivers.generator import Wave
from tests.refusals import refuses

#: The frame with the rig's state and that of its program.
STATE = 0x282


@pytest.fixture
def pair():
    """A simulated rig and a connected bench, in memory."""
    rig = Rig(load())
    with RigInMemory(rig).bench() as bench:
        yield rig, bench


@pytest.fixture
def losing():
    """A connected bench, and a function that loses the frames with the rig's state for some seconds from now on."""
    rig = Rig(load())
    lost = SimpleNamespace(until=0)

    def run(ticks):
        block = rig.run(ticks)
        return block[(block["id"] != STATE) | (memory.clock.now() > lost.until)]

    def lose(seconds):
        lost.until = memory.clock.now() + round(seconds * NS)

    memory = RigInMemory(rig, run)
    with memory.bench() as bench:
        yield bench, lose


def test_a_spring_is_lifted_filled_loaded_shaken_and_emptied(pair):
    _, bench = pair
    bench.arm()
    bench.vertical.control = "displacement"
    bench.vertical.move_to(0.0, 0.0, rate=40 * mm / s)
    assert bench.left.height == pytest.approx(0, abs=3 * mm)
    bench.air.fill(to=1.5 * bar, within=2 * minutes)
    bench.air.hold()
    bench.wait(20 * s)  # filling heats the gas, and while it cools the springs give way
    before = bench.averages("vertical_left.displacement", "vertical_left.force", over=0.5 * s)
    bench.vertical.control = "force"
    bench.wait(0.5 * s)
    after = bench.averages("vertical_left.displacement", "vertical_left.force", over=0.5 * s)
    assert after["vertical_left.displacement"] == pytest.approx(
        before["vertical_left.displacement"], abs=1 * mm
    )
    assert after["vertical_left.force"] == pytest.approx(before["vertical_left.force"], abs=1 * kN)
    bench.vertical.hold_position()
    with bench.capture("vertical_left.displacement", "rig.generator_cycle") as capture:
        bench.generator.run("vertical", amplitude=5 * mm, frequency=2 * Hz, cycles=5)
    swing = capture.values("vertical_left.displacement")
    assert swing.max() - swing.min() == pytest.approx(10 * mm, rel=0.15)
    assert capture.values("rig.generator_cycle").max() == 5
    bench.air.vent(within=3 * minutes)
    bench.disarm()
    assert bench.rig.state == "DISABLED"
    assert bench.wiring.carrier.tally()["lost"] == bench.wiring.carrier.tally()["repeated"] == 0
    assert bench.rig.rejected_commands == 0


def test_axes_move_at_once_or_not_at_all(pair):
    rig, bench = pair
    bench.arm()
    bench.vertical.hold_position()
    bench.lateral.control = "displacement"
    names = ("platform.vertical", "platform.lateral", "lateral.displacement")
    track = {"form": "unilateral_cosine", "amplitude": 8 * mm, "frequency": 1 * Hz}
    slow = Wave("lateral", amplitude=6 * mm, frequency=1 * Hz, cycles=4)
    with bench.capture(*names) as capture:
        bench.generator.run_together(
            slow,
            Wave("platform_vertical", cycles=2, delay=0.5 * s, **track),
            Wave("platform_lateral", cycles=2, **track),
        )
    assert bench.rig.generator_cycle == 4, "of the one that ends last, in whatever order they are given"
    assert all(float(np.ptp(capture.values(name))) > 7 * mm for name in names)
    steep = Wave("platform_roll", roll_amplitude=0.1, frequency=2 * Hz, cycles=9)
    with refuses(Refused, "fast"):
        bench.generator.run_together(slow, steep)
    with bench.capture("lateral.displacement") as capture:
        bench.generator.run("platform_vertical", amplitude=8 * mm, frequency=1 * Hz, cycles=3)
    assert float(np.ptp(capture.values("lateral.displacement"))) < 1 * mm, (
        "what was added before is forgotten"
    )
    with refuses(Misuse, "roll_amplitude"):
        bench.generator.run_together(slow, Wave("roll", amplitude=1 * mm, frequency=1 * Hz, cycles=3))
    assert not rig.generator._added
    with refuses(Misuse, "least"):
        bench.generator.run_together()


def test_a_program_whose_first_frames_are_lost_is_not_taken_for_the_one_before(losing):
    bench, lose = losing
    bench.arm()
    bench.vertical.hold_position()
    bench.generator.run("vertical", amplitude=2 * mm, frequency=5 * Hz, cycles=3)
    lose(0.08 * s)
    bench.generator.run("vertical", amplitude=2 * mm, frequency=5 * Hz, cycles=8)
    assert bench.generator.cycles == 8


def test_plates_and_pipes_are_changed_on_an_empty_bench_only(pair):
    rig, bench = pair
    assert bench.rig.orifice_diameter == pytest.approx(13 * mm)
    assert bench.rig.pipe == "off"
    bench.rig.orifice_diameter = 20 * mm
    bench.rig.pipe = "on"
    bench.arm()
    with refuses(Refused, "rig.orifice_diameter 16 mm") as refused:
        bench.rig.orifice_diameter = 16 * mm
    assert refused.value.code == 4
    with refuses(Refused, "rig.pipe off"):
        bench.rig.pipe = "off"
    assert bench.rig.orifice_diameter == pytest.approx(20 * mm)
    assert bench.rig.pipe == "on"
    assert rig.plant.parameters.orifice_diameter == pytest.approx([20 * mm, 20 * mm])
    assert (rig.plant.parameters.pipe_length == 1.5).all()
    bench.rig.orifice_diameter = 20 * mm  # nothing to change, nothing to refuse


def test_the_emergency_stop_of_the_rig_reaches_the_plan_in_words(pair):
    rig, bench = pair
    bench.arm()
    rig.press_estop()
    with refuses(RigFault, "ESTOP"):
        bench.wait(1 * s)
    assert bench.interlock.estop
    with refuses(RigFault, "release"):
        bench.arm()
    rig.release_estop()
    bench.arm()
    assert bench.rig.state == "ACTIVE"


def test_a_bench_that_is_closed_can_be_taken_by_the_next(pair):
    rig, bench = pair
    bench.arm()
    bench.close()
    assert rig.state.name == "DISABLED"
    assert rig.lease.owner is None
