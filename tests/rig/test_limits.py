"""Limit detectors: six kinds, six actions, persistence, hysteresis and latch; by what the wires say."""

import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import kN, mm
from bench_protocol.words import CONTROL_MODES, LIMIT_KINDS, PROGRAM_STATES, LimitKind
from bench_sim.rig.limit_table import ACTIONS, limits_of, listed
from bench_sim.rig.limits import LIMITS
from bench_sim.rig.rig import Rig
from tests.refusals import refuses

DISPLACEMENT = CONTROL_MODES.index("displacement")


@pytest.fixture
def limited(parameters, commander):
    """A commander of an armed rig, lateral actuator in control of displacement, with an additional limit."""

    def make(**row):
        made = type(commander)(Rig(parameters, seed=1, limits=limits_of([row])))
        made.arm()
        made.apply(lateral_control=DISPLACEMENT)
        made.cycle(10)
        return made

    return make


def push(commander, to: float, cycles: int = 20) -> None:
    commander.cycle(cycles, lateral_displacement_setpoint=to)


def first_out(commander) -> tuple[str, str, float]:
    """Whose limit tripped first, its kind, and what it judged in steps; ("", "none", 0) for none."""
    commander.cycle(6)
    tripped = TABLE.tripped(commander.read("rig.tripped"))
    kind = LIMIT_KINDS[int(commander.read("rig.tripped_kind"))]
    return tripped.name if tripped else "", kind, commander.read("rig.tripped_value")


SIDEWAYS = {"signal": "lateral.displacement", "kind": "upper", "at": "10 mm"}

ENDS = {
    "none": ("ACTIVE", "RUN", ""),
    "indicate": ("ACTIVE", "RUN", "lateral.displacement"),
    "program hold": ("HOLD", "HOLD", "lateral.displacement"),
    "program stop": ("FAULT_HOLD", "STOPPED", "lateral.displacement"),
    "interlock": ("FAULT_DISABLED", "IDLE", "lateral.displacement"),
    "power off": ("OFF", "IDLE", "lateral.displacement"),
}
assert tuple(ENDS) == ACTIONS


def test_a_limit_with_a_lead_trips_before_it_is_reached_by_what_is_fast(limited) -> None:
    """At 150 mm/s 100 ms ahead are 15 mm; a slow motion goes all the way, and a return is not stopped."""
    ahead = SIDEWAYS | {"at": "30 mm", "action": "interlock", "lead": "100 ms", "persistence": "5 ms"}
    fast = limited(**ahead)
    push(fast, 29 * mm)
    assert fast.state == "FAULT_DISABLED"
    signal, kind, judged = first_out(fast)
    assert (signal, kind) == ("lateral.displacement", "upper")
    assert judged > 30 * mm / TABLE["lateral.displacement"].step
    assert fast.read("lateral.displacement") < 25 * mm, "it was stopped before"
    slow = limited(**ahead)
    for k in range(1, 286):
        push(slow, 0.1 * k * mm, cycles=1)
    assert slow.state == "ACTIVE"
    assert slow.read("lateral.displacement") > 28 * mm
    push(slow, -29 * mm)
    assert slow.state == "ACTIVE"


@pytest.mark.parametrize("action", ACTIONS)
def test_each_action_does_what_it_says(limited, action) -> None:
    bench = limited(**SIDEWAYS, action=action)
    bench.apply(generator_axis=3, generator_amplitude=1 * mm, generator_frequency=0.5, generator_cycles=100)
    assert bench.coil("program_run")[0] == 5
    push(bench, 14 * mm)
    state, program, signal = ENDS[action]
    assert (bench.state, PROGRAM_STATES[int(bench.read("rig.program"))]) == (state, program)
    assert first_out(bench)[0] == signal


def test_what_only_indicates_is_reset_in_any_state(limited) -> None:
    bench = limited(**SIDEWAYS, action="indicate")
    push(bench, 14 * mm)
    push(bench, 0.0)
    assert first_out(bench)[:2] == ("lateral.displacement", "upper"), "latched"
    assert bench.coil("reset")[0] == 5
    assert first_out(bench) == ("", "none", 0.0)
    assert bench.state == "ACTIVE"
    push(bench, 14 * mm)
    assert first_out(bench)[0] == "lateral.displacement", "and it watches on"


@pytest.mark.parametrize(
    ("row", "ways", "kind", "judged"),
    [
        ({"kind": "lower", "at": "-10 mm"}, (-14 * mm,), "lower", (-1450, -1000)),
        ({"kind": "error", "at": "5 mm", "persistence": "40 ms"}, (), "error", (500, 4000)),
        ({"kind": "rate", "at": "150 mm/s"}, (14 * mm,), "rate", (15_000, 25_000)),
        (
            {"kind": "count", "at": 2, "level": "5 mm", "hysteresis": "1 mm"},
            (8 * mm, 0.0, 8 * mm, 0.0, 8 * mm),
            "count",
            (3, 3),
        ),
    ],
    ids=["lower", "error", "rate", "count"],
)
def test_each_kind_judges_what_it_says(limited, row, ways, kind, judged) -> None:
    bench = limited(signal="lateral.displacement", action="indicate", **row)
    for way in ways:
        assert first_out(bench)[0] == "", "not before the last way"
        push(bench, way)
    if kind == "error":  # an actuator that cannot follow: another one against it
        bench.rig.plant.parameters.actuator_speed_limit[2] = 1 * mm
        push(bench, 30 * mm, 30)
    signal, told, value = first_out(bench)
    assert (signal, told) == ("lateral.displacement", kind)
    assert judged[0] <= value <= judged[1]


def test_a_reading_that_is_gone_trips_in_time(limited) -> None:
    bench = limited(signal="left.height", kind="timeout", at="200 ms", action="indicate")
    bench.rig.faults.on("broken_wire", {"sensor": "left.height", "reads": "nothing"})
    bench.cycle(4)
    assert bench.rig.values[TABLE.index["rig.tripped"]] == 0, "80 ms"
    bench.cycle(8)
    assert first_out(bench)[:2] == ("left.height", "timeout")


def test_a_ramp_that_does_not_arrive_trips_in_time(limited) -> None:
    bench = limited(
        signal="lateral.displacement", kind="timeout", at="300 ms", within="2 mm", action="program stop"
    )
    push(bench, 6 * mm, 60)
    assert bench.state == "ACTIVE", "it has arrived"
    bench.rig.plant.parameters.actuator_speed_limit[2] = 1 * mm
    push(bench, 20 * mm, 60)
    assert bench.state == "FAULT_HOLD"
    assert first_out(bench)[1] == "timeout"


def test_what_is_short_does_not_trip_and_what_does_not_latch_comes_back(limited) -> None:
    short = limited(**SIDEWAYS, action="program stop", persistence="2 s")
    push(short, 14 * mm, 40)
    push(short, 0.0, 40)
    push(short, 14 * mm, 40)
    assert short.state == "ACTIVE", "never two seconds in a row"
    loose = limited(**SIDEWAYS, action="indicate", latch=False, hysteresis="3 mm")
    push(loose, 14 * mm)
    limits = b"\x02\0\4\0\1"
    assert loose.ask(limits)[2] == 1
    push(loose, 8 * mm)
    assert loose.ask(limits)[2] == 1, "within its hysteresis"
    push(loose, 5 * mm)
    assert loose.ask(limits)[2] == 0
    assert first_out(loose)[0] == "lateral.displacement", "the first out stays until a reset"


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"signal": "left.heigth", "kind": "upper"}, "'left.height'"),
        ({"signal": "left.height", "kind": "above"}, "'above'"),
        ({"signal": "left.height", "kind": "upper", "at": "5 bar"}, "at '5 bar'"),
        ({"signal": "left.height", "kind": "upper", "at": "nan mm"}, "number"),
        ({"signal": "left.height", "kind": "upper", "atm": 3}, "mean 'at'"),
        ({"signal": "left.height", "kind": "upper", "action": "off"}, "'off'"),
        ({"signal": "left.height", "kind": "rate", "at": "1 m/s"}, "action"),
        ({"signal": "left.height", "kind": "upper", "persistence": "-1 s"}, "negative"),
        ({"signal": "left.height", "kind": "upper", "latch": "no"}, "false"),
        ({"signal": "left.height", "kind": "error", "at": "1 mm", "action": "indicate"}, "reading"),
    ],
)
def test_a_limit_that_does_not_fit_is_refused_in_words(row, words) -> None:
    with refuses(ValueError, words):
        limits_of([row])


def test_a_limit_takes_the_place_of_the_assumed_one(tmp_path) -> None:
    assert limits_of([]) == LIMITS
    changed = limits_of([{"signal": "lateral.force", "kind": "upper", "at": "20 kN"}])
    assert len(changed) == len(LIMITS)
    one = next(x for x in changed if (x.signal, x.kind) == ("lateral.force", LimitKind.UPPER))
    assert (one.at, one.hysteresis) == (20 * kN, 1 * kN), "the rest stays"
    assert ("lateral.force", "upper", "20 kN", "20 ms", "1 kN", "until reset", "program stop") in listed(
        changed
    )
