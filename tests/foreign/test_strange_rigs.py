"""A bench on two third-party rigs, in virtual time: its actions, refusals, and detected faults."""

from types import SimpleNamespace

import pytest

from bench_protocol.units import NS, bar, kN, mm
from bench_protocol.words import TO_SAFE
from drivers.errors import LinkLost, NotAvailable, Refused, RigFault
from tests.foreign import AT_REST
from tests.foreign.virtual import VirtualHall, VirtualPlc

pytestmark = pytest.mark.timeout(300)  # who comes first compiles the model
STRANGE = {"plant_a": VirtualPlc, "hall_b": VirtualHall}


def wait(clock, seconds):
    clock.sleep_until(clock.now() + round(seconds * NS))


@pytest.fixture(params=STRANGE)
def strange(request):
    """A strange rig, virtual, with a bench that is connected."""
    virtual = STRANGE[request.param]()
    with virtual.bench() as bench:
        yield SimpleNamespace(
            name=request.param, virtual=virtual, rig=virtual.rig, clock=virtual.clock, bench=bench
        )


def test_a_stop_needs_no_action_where_orders_lead_to_rest(strange):
    strange.bench.arm()
    assert TO_SAFE in strange.bench.wiring.absent
    strange.bench.settings.go_safe(strange.clock)
    wait(strange.clock, 10)
    assert strange.bench.rig.state == "DISABLED"


def test_the_bench_is_armed_moved_and_brought_to_rest(strange):
    bench = strange.bench
    assert bench.rig.state == "DISABLED"
    assert bench.left.height == pytest.approx(AT_REST[strange.name] * mm, abs=0.2 * mm)
    bench.rig.nominal_preload = 60 * kN
    assert bench.rig.nominal_preload == pytest.approx(60 * kN, abs=5)
    bench.arm()
    bench.vertical.move_to(0.0, 0.0, rate=40 * mm)
    bench.air.fill(to=1.5 * bar)
    bench.lateral.move_to(5 * mm)
    bench.wait(0.5)
    assert bench.lateral.displacement == pytest.approx(5 * mm, abs=0.3 * mm)
    with pytest.raises(Refused, match=r"did not acknowledge rig\.nominal_preload = 55 kN: .* still reads 60"):
        bench.rig.nominal_preload = 55 * kN
    with bench.capture("lateral.displacement") as capture:
        bench.generator.run("lateral", "sine", amplitude=4 * mm, frequency=1.0, cycles=4)
    values = capture.values("lateral.displacement")
    assert values.max() - values.min() == pytest.approx(8 * mm, rel=0.05)
    bench.air.vent(tolerance=0.2 * bar)
    bench.disarm()
    assert bench.rig.state == "DISABLED"


def test_what_a_rig_does_not_have_says_so_when_it_is_asked(strange):
    bench = strange.bench
    with pytest.raises(NotAvailable, match=r"has no lateral\.acceleration: no accelerometer on the bolster"):
        _ = bench.lateral.acceleration
    with pytest.raises(NotAvailable, match=r"has no rig\.pipe: no connecting pipes can be fitted"):
        bench.rig.pipe = "on"


def test_a_rig_holds_when_its_commander_is_gone(strange):
    strange.bench.arm()
    strange.bench.commander.stop()
    wait(strange.clock, 1.5)
    assert strange.rig.state.name in ("QUICK_STOP", "HALT")
    with pytest.raises(RigFault, match="the rig left ACTIVE: state FAULT_HOLD") as told:
        strange.bench.check()
    assert told.value.fault == "link"
    wait(strange.clock, 3.5)
    assert strange.rig.state.name in ("FAULT", "SAFE")


def test_a_step_without_effect_is_reported_with_its_command(strange):
    """Deaf to requests, the rig stays where it is."""
    strange.rig.estop = True
    wait(strange.clock, 0.2)
    with pytest.raises(RigFault, match="release the button"):
        strange.bench.arm()
    strange.rig.estop = False
    wait(strange.clock, 0.2)
    deaf = {"plant_a": "_answer_request", "hall_b": "_take_command"}[strange.name]
    setattr(strange.rig, deaf, lambda *data: None)
    said = {"plant_a": r"plc\.request = 4", "hall_b": r"bus\.Command\.Request = 68"}[strange.name]
    with pytest.raises(RigFault, match=said):
        strange.bench.reset()


def test_an_emergency_stop_is_seen_and_must_be_released_before_a_reset(strange):
    strange.bench.arm()
    strange.rig.estop = True
    with pytest.raises(RigFault, match="state ESTOP, reason: emergency stop"):
        strange.bench.wait(1.0)
    with pytest.raises(RigFault, match="release the button"):
        strange.bench.reset()
    strange.rig.estop = False
    wait(strange.clock, 0.1)
    strange.bench.arm()
    assert strange.bench.rig.state == "ACTIVE"


def test_a_rig_that_falls_silent_is_lost(strange):
    strange.bench.arm()
    strange.virtual.silent = True
    with pytest.raises(LinkLost):
        strange.bench.wait(5.0)
