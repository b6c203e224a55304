"""Whatever the rig refuses, in whichever state: what the drivers say of it is so, by the rig's own table."""

import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import NS, bar, kN, mm
from bench_protocol.words import STATES, BenchState
from bench_sim.rig.fittings import _FLANGE_PRESSURE
from bench_sim.rig.rig import Rig
from bench_sim.rig.safe_position import EMPTY, Grip
from bench_sim.rig.states import COMMAND_VALID, TRANSITIONS, Event
from drivers.errors import Refused
from drivers.wiring.astb import refusals
from drivers.wiring.astb.refusals import RigState, action_refusal
from tests.refusals import refuses

EVENTS = {
    "power_on": Event.POWER_ON,
    "power_off": Event.POWER_OFF,
    "air_low": Event.AIR_LOW,
    "air_high": Event.AIR_HIGH,
    "disable": Event.DISABLE,
    "reset": Event.RESET,
}


@pytest.fixture
def bench(parameters):
    with RigInMemory(Rig(parameters, seed=1)).bench() as bench:
        yield bench


def wait(bench, seconds):
    bench.clock.sleep_until(bench.clock.now() + round(seconds * NS))


@pytest.mark.parametrize("state", list(BenchState), ids=STATES)
@pytest.mark.parametrize("name", EVENTS)
def test_an_action_outside_its_states_is_explained(name, state):
    readings = {"rig.state": float(state), "rig.program": 0.0}
    rows = {(row.source, row.event): row for row in TRANSITIONS}
    row = rows.get((state, EVENTS[name]))
    told = action_refusal(
        f"action.{name}", RigState(readings, {"interlock.command": False, "interlock.estop": True})
    )
    assert (f"the bench is in {state.name}" in told) == (row is None)
    if row is not None and row.needs == COMMAND_VALID:
        assert "no valid command frames with D set" in told
    elif row is not None and row.needs:
        assert ("the mains are off; switch" in told) != ("the emergency stop is pressed; release" in told)


def test_the_pressures_are_those_of_the_rig():
    assert (refusals.EMPTY, refusals.FLANGE) == (EMPTY, _FLANGE_PRESSURE)
    names = {signal.name for signal in TABLE.of_kind(Kind.MEASUREMENT) if "_pressure" in signal.name}
    assert set(refusals._CHAMBERS) == names


def test_power_that_cannot_come_on_names_the_mains(bench):
    rig = bench.wiring.carrier.can._memory.rig
    rig.set_mains(there=False)
    wait(bench, 0.1)
    with refuses(Refused, "switch"):
        bench.arm()
    rig.set_mains(there=True)
    bench.arm()


def test_shims_that_cannot_be_changed_name_what_holds_the_bolster(bench):
    rig = bench.wiring.carrier.can._memory.rig

    def refusal(setting="nominal_preload", value=145 * kN):
        with pytest.raises(Refused) as caught:
            setattr(bench.rig, setting, value)
        return str(caught.value)

    bench.arm()
    bench.vertical.move_to(60 * mm, 60 * mm, rate=40 * mm)
    assert "the bench is in ACTIVE, so the actuators hold the bolster; disarm the bench first" in refusal()
    bench.air.fill(1.5 * bar, tolerance=0.1 * bar)
    bench.disarm()
    assert rig._controls["grip"] == Grip.SHUT
    for told in (refusal(), refusal("orifice_diameter", 10 * mm)):
        assert "left.bellows_pressure is 1." in told
        assert "vent both springs first, or disarm the bench, which vents them" in told
    while max(bench.left.bellows_pressure, bench.left.auxiliary_pressure) > EMPTY:
        wait(bench, 0.05)
    wait(bench, 0.2)
    assert rig._controls["grip"] == Grip.LOWERING
    assert "the actuators still set the bolster down; wait some seconds" in refusal()
    wait(bench, 10)
    bench.rig.nominal_preload = 145 * kN


def test_a_control_mode_under_a_program_names_the_program(bench):
    bench.arm()
    bench.vertical.hold_position()
    bench.generator.start("vertical", amplitude=1 * mm, frequency=1.0, cycles=100)
    with refuses(Refused, "control"):
        bench.vertical.control = "force"
    bench.generator.hold()
    bench.wait(0.1)
    with refuses(Refused, "program"):
        bench.vertical.control = "force"
    with refuses(Refused, "program"):
        bench.generator.hold()
    bench.generator.stop()
    with refuses(Refused, "program"):
        bench.action.program_stop()
