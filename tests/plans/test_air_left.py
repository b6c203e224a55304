"""The reported air in the springs: in every state, with any known readings, without contradictions."""

import itertools
import math
from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from bench_protocol.table import TABLE
from bench_protocol.units import bar
from bench_protocol.words import AIR_BY_STATE, REASONS, STATES
from drivers.errors import BenchTimeout, LinkLost, RigFault
from test_plans.air_left import KEEP_AWAY, air_at_risk, air_left, springs_are_empty, zeros_off
from test_plans.steps.carrying import depressurise

SIDES, CHAMBERS = ("left", "right"), ("bellows", "auxiliary")
NAMES = [f"{side}.{chamber}_pressure" for side in SIDES for chamber in CHAMBERS]
PRESSURES = {
    "empty": [0.01, 0.02, 0.0, 0.01],
    "full on the left": [2.21, 2.2, 0.0, 0.0],
    "full, and one is stale": [2.21, math.nan, 2.2, 2.2],
    "one side is stale": [0.01, 0.01, math.nan, math.nan],
    "all are stale": [math.nan] * 4,
}


def made(state, reason, pressures, *, stale=False, air=AIR_BY_STATE):
    """A bench of which just as much is known; it notes whether it was disarmed."""
    known = dict(zip(NAMES, [one * bar for one in pressures], strict=True))
    known["rig.state"] = math.nan if stale else STATES.index(state)

    def show(name):
        return f"{name} is stale for 3.2 s"

    def wait_for(condition, *, within, what):
        if not condition():
            raise BenchTimeout(f"{what}: not reached within {within:g} s")

    bench = SimpleNamespace(
        state="unknown" if stale else state,
        readings=SimpleNamespace(value_or_nan=known.get, show=show),
        lost=False,
        table=TABLE,
        lacks=lambda name: "",
        wiring=SimpleNamespace(sequences=SimpleNamespace(air=air)),
        describe=lambda: f"state {state}, reason: {reason}",
        despite_faults=nullcontext,
        wait_for=wait_for,
        disarmed=False,
    )

    def disarm():
        bench.disarmed, bench.state = True, "FAULT_DISABLED"
        known["rig.state"] = STATES.index(bench.state)

    bench.disarm = disarm
    bench.rig = SimpleNamespace(state=bench.state)
    return bench


def contradictions(told, state, pressures, *, stale):
    """Every way in which a sentence could say more, or something else, than is known."""
    becomes = {
        "vents the springs by itself": "let off",
        "keeps its valves shut": "shut in",
        "the air as last commanded": "as ordered",
    }
    for words, fate in becomes.items():
        if words in told and (stale or AIR_BY_STATE[state] != fate):
            yield words
    unknown = [name for name, pressure in zip(NAMES, pressures, strict=True) if math.isnan(pressure)]
    if "without pressure" in told and (unknown or max(pressures) > 0.2):
        yield "without pressure"
    if "they hold pressure (" in told and not any(pressure > 0.2 for pressure in pressures):
        yield "they hold pressure"
    if "not known whether they hold" in told and any(pressure > 0.2 for pressure in pressures):
        yield "nobody can tell"
    for name in unknown:
        if f"{name} is stale" not in told:
            yield f"{name} is not called stale"
    if "nan" in told:
        yield "a number of something unknown"
    if "without pressure" not in told and not told.startswith(KEEP_AWAY):
        yield "what a person has to do does not come first"


@pytest.mark.parametrize("stale", [False, True], ids=["state known", "state stale"])
@pytest.mark.parametrize("pressures", PRESSURES.values(), ids=PRESSURES)
def test_no_sentence_contradicts_what_is_known(pressures, stale):
    for state, reason in itertools.product(STATES, REASONS):
        bench = made(state, reason, pressures, stale=stale)
        told = air_left(bench)
        assert not list(contradictions(told, state, pressures, stale=stale)), told
        assert air_at_risk(bench) == ("" if springs_are_empty(bench) else told)


def test_a_rig_with_unknown_sequences_has_no_predicted_duration():
    told = air_left(made("DISABLED", "none", PRESSURES["full on the left"], air={}))
    assert told.endswith("it is not known what this rig does with the air in DISABLED")


@pytest.mark.parametrize("pressures", list(PRESSURES.values())[1:], ids=list(PRESSURES)[1:])
@pytest.mark.parametrize("state", [state for state in STATES if AIR_BY_STATE[state] != "as ordered"])
def test_springs_not_known_to_be_empty_are_reported_to_the_bench(state, pressures):
    bench = made(state, "none", pressures)
    with pytest.raises(RigFault, match="the springs are not known to be empty"):
        depressurise(SimpleNamespace(bench=bench, phase=lambda name: nullcontext()))
    assert bench.disarmed == (AIR_BY_STATE[state] == "shut in"), (
        "a fault that holds ends in the safe position"
    )
    told = air_left(bench)
    assert not list(contradictions(told, bench.state, pressures, stale=False)), told


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ([0.77, 0.01, 0.0, 0.01], [0.77, 0.01, 0.0, 0.01], True),  # at rest: a zero is off
        ([0.77, 0.01, 0.0, 0.01], [0.72, 0.01, 0.0, 0.01], False),  # air flows
        ([0.77, 0.01, 0.0, 0.01], [0.77, 0.05, 0.0, 0.01], False),
        ([0.77, 0.01, 0.0, 0.01], [0.04, 0.01, 0.0, 0.01], False),
        ([0.77, math.nan, 0.0, 0.01], [0.77, 0.01, 0.0, 0.01], False),
    ],
)
def test_a_zero_is_blamed_only_at_rest(before, after, told):
    bench = made("ACTIVE", "none", before)

    later = dict(zip(NAMES, [one * bar for one in after], strict=True)) | {
        "rig.state": STATES.index("ACTIVE")
    }
    bench.wait = lambda duration: setattr(bench.readings, "value_or_nan", later.get)
    assert bool(zeros_off(bench)) == told


def test_empty_springs_are_not_reported():
    bench = made("FAULT_DISABLED", "none", PRESSURES["empty"])
    depressurise(SimpleNamespace(bench=bench, phase=lambda name: nullcontext()))
    assert (
        air_left(bench) == "the springs are without pressure (0.02 bar on the left and 0.01 bar on the right)"
    )


@pytest.mark.parametrize("answers", [True, False])
def test_a_lost_connection_queries_the_rig_and_returns_no_old_values(answers):
    bench = made("ACTIVE", "none", PRESSURES["full on the left"])
    now = dict.fromkeys(NAMES, 0.1 * bar) | {"rig.state": STATES.index("FAULT_DISABLED")}

    def readings(*names):
        if not answers:
            raise LinkLost("nobody answers")
        return {name: now[name] for name in names}

    bench.lost, bench.settings = True, SimpleNamespace(readings=readings)
    if answers:
        assert air_at_risk(bench) == ""
        now["left.bellows_pressure"] = 0.7 * bar
        assert air_left(bench).endswith(
            "they hold pressure (0.70 bar on the left and 0.10 bar on the right); "
            "the bench, in FAULT_DISABLED, vents the springs by itself"
        )
    else:
        told = air_left(bench)
        assert "it is not known whether they hold pressure" in told
        assert told.endswith(
            "what the bench does with the air: rig.state cannot be read, for a connection is lost"
        )
