"""The bench as plans see it: arming, bounded waits, reported faults, and measurements."""

import math

import pytest

from bench_protocol.units import NS, Hz, bar, kN, mm, ms, s
from drivers.commander import CYCLE
from drivers.errors import (
    BenchError,
    BenchTimeout,
    LinkLost,
    Misuse,
    NotCommander,
    NotRecorded,
    RigFault,
    Stale,
)
from tests.refusals import refuses

# -- arming ------------------------------------------------------------------------------------------------------


def test_arming_walks_through_every_state_and_disarming_back(world, bench):
    bench.arm()
    assert bench.rig.state == "ACTIVE"
    bench.disarm()
    assert bench.rig.state == "DISABLED"
    walked = [state for _, state, _ in world.peer.tracks]
    unique = [a for a, b in zip(walked, [None, *walked], strict=False) if a != b]
    assert unique[-8:] == [
        "DISABLED",
        "AIR_LOW",
        "AIR_HIGH",
        "HOLD",
        "ACTIVE",
        "HOLD",
        "AIR_HIGH",
        "DISABLED",
    ]


def test_arming_stops_at_the_given_state_and_continues_from_there(bench):
    bench.arm(to="HOLD")
    assert bench.rig.state == "HOLD"
    bench.arm()
    assert bench.rig.state == "ACTIVE"
    with refuses(Misuse, "ESTOP DISABLED ACTIVE"):
        bench.arm(to="ESTOP")


def test_arming_takes_over_what_is_measured(world, bench):
    world.peer.values |= {
        "lateral.force": 1 * kN,
        "lateral.displacement": -7 * mm,
        "vertical_left.force": 3 * kN,
    }
    bench.arm()
    assert bench.lateral.force_setpoint == pytest.approx(1 * kN)
    assert bench.lateral.displacement_setpoint == pytest.approx(-7 * mm)
    assert world.peer.values["vertical_left.force"] == pytest.approx(3 * kN)  # ACTIVE moved nothing


def test_arming_is_bounded(world, bench):
    world.peer.reset = lambda: None  # a rig that does not leave DISABLED
    before = bench.now
    with refuses(BenchTimeout, "AIR_LOW DISABLED"):
        bench.arm(within=2 * s)
    assert bench.now - before <= 2 * s + 2 * CYCLE / NS


@pytest.mark.parametrize("state", ["FAULT_HOLD", "FAULT_DISABLED"])
def test_arming_resets_a_latched_fault_first(world, bench, state):
    bench.arm()
    world.peer.fault(state, "command late")
    with pytest.raises(RigFault):
        bench.wait(1 * s)
    bench.arm()
    assert bench.rig.state == "ACTIVE"
    assert bench.rig.reason == "none"


def test_an_emergency_stop_is_not_reset_while_it_is_pressed(world, armed):
    world.peer.estop = True
    world.peer.fault("ESTOP", "emergency stop")
    with refuses(RigFault, "emergency"):
        armed.wait(1 * s)
    with refuses(RigFault, "release"):
        armed.arm()
    assert armed.rig.state == "ESTOP"
    world.peer.estop = False
    armed.arm()
    assert armed.rig.state == "ACTIVE"


def test_disarming_works_in_a_fault_and_leaves_it_latched(world, armed):
    world.peer.fault("FAULT_HOLD", "limit tripped")
    armed.disarm()
    assert armed.rig.state == "FAULT_DISABLED"
    assert armed.rig.reason == "limit tripped"


def test_a_plan_that_fails_leaves_a_bench_at_rest(world):
    with pytest.raises(ZeroDivisionError), world.bench as bench:
        bench.arm()
        1 / 0  # noqa: B018
    assert world.peer.state == "DISABLED"
    assert world.peer.lease == 0
    world.bench.close()


def test_connecting_twice_is_misuse(bench):
    with refuses(Misuse, "connected"):
        bench.connect()
    assert bench.rig.state != "unknown"


# -- waiting -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("duration", [0, 1 * ms, 20 * ms, 0.333, 2.0])
def test_waiting_takes_as_long_as_it_says(bench, duration):
    before = bench.clock.now()
    bench.wait(duration)
    assert bench.clock.now() - before == round(duration * NS)


@pytest.mark.parametrize("duration", [-1, math.nan, math.inf, 1e9])
def test_waits_are_bounded(bench, duration):
    with refuses(ValueError, "duration 86400"):
        bench.wait(duration)
    with refuses(ValueError, "within 86400"):
        bench.wait_for(lambda: True, within=duration)


def test_a_wait_that_fails_says_what_how_long_and_what_is(world, bench):
    world.peer.values["left.height"] = -12 * mm
    world.peer.values["supply.pressure"] = math.nan
    before = bench.now
    with pytest.raises(BenchTimeout) as failure:
        bench.wait_for(
            lambda: bench.left.height > 0 or bench.supply.pressure > 9 * bar,
            within=3 * s,
            what="left spring at height",
        )
    assert bench.now - before == pytest.approx(3 * s)
    assert str(failure.value).startswith(
        "left spring at height: not reached within 3 s; "
        "now left.height = -12 mm, supply.pressure is unavailable; "
    )
    assert failure.value.fault == "rig"


def test_a_wait_ends_within_a_cycle_of_its_condition(world, bench):
    start = bench.now
    bench.wait_for(lambda: bench.now >= start + 0.5, within=1 * s)
    assert bench.now - start == pytest.approx(0.5, abs=0.021)


def test_steady_means_without_interruption(world, bench):
    start = bench.now
    flicker = lambda: (bench.now - start) % 0.5 > 0.1  # noqa: E731
    with pytest.raises(BenchTimeout):
        bench.wait_for(flicker, within=2 * s, what="peace", steady=0.45 * s)
    before = bench.now
    bench.wait_for(lambda: True, within=2 * s, steady=0.4 * s)
    assert bench.now - before == pytest.approx(0.4, abs=0.021)


def test_an_unknown_value_satisfies_no_limit(world, bench):
    world.peer.silent_can = True
    world.pass_time(0.5)
    for condition in (lambda: bench.left.height > -1, lambda: bench.left.height < 1):
        with refuses(BenchTimeout, "left.height"):
            bench.wait_for(condition, within=0.2 * s)


@pytest.mark.parametrize(
    "act",
    [
        lambda b: b.wait(10 * s),
        lambda b: b.wait_for(lambda: False, within=10 * s),
        lambda b: b.air.fill(to=9 * bar, within=100 * s),
        lambda b: b.generator.run("vertical", force_amplitude=1 * kN, frequency=1 * Hz, cycles=10),
        lambda b: b.average("left.height", over=10 * s),
        lambda b: b.lateral.push(50 * kN, 1 * kN),
    ],
)
def test_every_wait_notices_a_fault_and_tells_the_rigs_reason(world, armed, act):
    when = armed.clock.now() + round(0.5 * NS)
    hit = armed.clock.every(round(0.5 * NS), lambda: world.peer.fault("FAULT_HOLD", "command late"))
    with refuses(RigFault, "ACTIVE FAULT_HOLD"):
        act(armed)
    hit.cancel()
    assert armed.clock.now() - when <= 3 * CYCLE


def test_the_limit_that_tripped_first_is_named(world, armed):
    world.peer.values["left.height"] = 140 * mm
    world.peer.values["rig.tripped"] = 1.0
    world.peer.fault("FAULT_HOLD", "limit tripped")
    with refuses(RigFault, "reason left.height 140 mm"):
        armed.wait(1 * s)


def test_tear_down_may_go_on_despite_a_fault(world, armed):
    world.peer.fault("FAULT_HOLD", "limit tripped")
    with armed.despite_faults():
        armed.wait(0.1 * s)
    with pytest.raises(RigFault):
        armed.wait(0.1 * s)


def test_a_silent_rig_is_noticed(world, armed):
    world.peer.silent_can = True
    before = armed.now
    with refuses(LinkLost, "silent"):
        armed.wait(10 * s)
    assert armed.now - before < 1 * s


def test_the_watchdog_is_fed_while_waiting_and_tells_who_has_taken_the_bench(world, armed):
    asked = len(world.peer.requests)
    armed.wait(60 * s)
    assert 140 <= len(world.peer.requests) - asked <= 160, "0.4 s apart, for a watchdog of 1 s"
    assert world.peer.watchdog == 1000
    world.peer.foreign, world.peer.lease = True, 99
    world.peer.values |= {"rig.lease": 99.0, "rig.holder": 4711.0}
    before = armed.now
    with refuses(NotCommander, "99 TCP 4711"):
        armed.wait(60 * s)
    assert armed.now - before < 1


def test_a_watchdog_that_cannot_be_fed_ends_the_plan_and_not_its_tear_down(world, armed):
    world.peer.silent_modbus = True
    with refuses(LinkLost, "watchdog"):
        armed.wait(1 * s)
    armed.disarm()
    assert world.peer.state == "DISABLED"


def test_the_watchdog_is_fed_while_an_answer_is_awaited(world, armed):
    """In virtual time a client that waits for an answer advances the time; two requests must not mix."""
    answer = world.peer.answer

    def slow(request):
        world.pass_time(0.3)
        return answer(request)

    world.modbus._client._answer = slow
    fed = world.peer.fed
    for _ in range(10):
        assert armed.air.left_mode == "hold"
    assert world.peer.fed - fed >= 7
    armed.check()


def test_third_party_programs_are_reported_with_the_bench(world, armed):
    assert armed.strangers() == ""
    world.peer.values |= {"rig.strangers": 12, "rig.stranger": 4711, "rig.stranger_identifier": 0x201}
    world.peer.values |= {"rig.lease": armed.wiring.given["control.token"]}
    armed.wait(0.2)
    assert "12 frames or requests refused, the last CAN frame 0x201 from TCP port 4711" in armed.describe()
    world.peer.values |= {"rig.stranger": 0}
    armed.wait(0.2)
    assert "0x201 from the bus" in armed.describe()
    world.peer.values |= {"rig.stranger": 1, "rig.stranger_identifier": 0}
    armed.wait(0.2)
    assert "a Modbus request from TCP port 1" in armed.describe()


def test_a_cut_bus_is_noticed_at_once(world, armed):
    world.can.lose("the server has gone")
    before = armed.now
    with refuses(LinkLost, "server"):
        armed.wait(10 * s)
    assert armed.now - before <= 0.04


def test_a_rig_that_never_speaks_on_can_is_not_connected_to(world):
    world.peer.silent_can = True
    with refuses(LinkLost, "within 2"):
        world.bench.connect()
    assert world.peer.lease == 0


def test_a_sink_that_fails_fails_the_plan(bench):
    def full(*arrays):
        raise OSError("no space left on device")

    bench.receiver.sink = full
    with refuses(NotRecorded, "space"):
        bench.wait(0.2 * s)


# -- measuring ---------------------------------------------------------------------------------------------------


def test_a_capture_of_several_signals(world, bench):
    with bench.capture("left.height", "load_cell.1", "rig.state") as capture:
        bench.wait(1 * s)
    times, columns = capture.aligned(rate=200)
    assert set(columns) == {"left.height", "load_cell.1", "rig.state"}
    assert len(times) == len(columns["left.height"]) >= 190
    assert capture.times("left.height").size == 200
    assert capture.times("rig.state").size == 50


def test_an_average_is_the_mean_of_what_came(world, bench):
    bench.clock.every(
        5_000_000, lambda: world.peer.values.update({"left.height": (bench.clock.now() % 2 * 10) * mm})
    )
    world.peer.values["right.height"] = 4 * mm
    assert bench.average("right.height", over=0.5 * s) == pytest.approx(4 * mm)
    means = bench.averages("left.height", "right.height", over=0.5 * s)
    assert means["right.height"] == pytest.approx(4 * mm)


def test_an_empty_window_has_no_average(world, bench):
    world.peer.values["left.height"] = math.nan
    bench.wait(0.1)
    with refuses(Stale, "left.height 0.5 s left.height"):
        bench.average("left.height", over=0.5 * s)


def test_settling(world, bench):
    world.peer.values["left.height"] = 100 * mm
    decay = bench.clock.every(
        5_000_000, lambda: world.peer.values.update({"left.height": 0.1 * 0.9**bench.now})
    )
    means = bench.settle("left.height", "right.height", band=2 * mm, over=1 * s, within=60 * s)
    assert (
        0.018 * 0.7 < means["left.height"] < 0.018
    )  # 10 % a second falls below 2 mm a second there, and twice more
    decay.cancel()
    bench.clock.every(5_000_000, lambda: world.peer.values.update({"left.height": 0.01 * bench.now}))
    with refuses(BenchTimeout, "within 5"):
        bench.settle("left.height", band=1 * mm, over=1 * s, within=5 * s)


def test_a_rotating_body_has_not_settled(world, bench):
    began = bench.now
    bench.clock.every(
        5_000_000,
        lambda: world.peer.values.update(
            {"left.height": 30 * mm * math.sin(math.pi * min((bench.now - began) / 6, 1.0))}
        ),
    )
    means = bench.settle("left.height", band=2 * mm, over=1 * s, within=60 * s)
    assert means["left.height"] == pytest.approx(0.0, abs=0.1 * mm), (
        "its peak of 30 mm, for which it stood still"
    )


def test_every_error_says_whose_fault_it_is():
    kinds, found = [BenchError], []
    while kinds:
        kind = kinds.pop()
        found.append(kind)
        kinds += kind.__subclasses__()
    assert len(found) >= 8
    assert all(kind.fault in ("rig", "plan", "link", "record") for kind in found)
