"""The unchanged plans on two third-party rigs, in virtual time: the verdicts equal those on our rig."""

from types import SimpleNamespace

import numpy as np
import pytest

from astb.rig_in_memory import RigInMemory
from bench_protocol.units import mm
from bench_records.result import CheckVerdict, Outcome
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.run import Run
from test_plans.steps.shaking import AMPLITUDE, LATERAL, TRIES, shake
from tests.foreign.can_rig import SET_POSITIONS
from tests.foreign.virtual import VirtualHall, VirtualPlc

pytestmark = pytest.mark.timeout(300)  # who comes first compiles the model
slow = pytest.mark.slow
STRANGE = {"plant_a": VirtualPlc, "hall_b": VirtualHall}
#: Checks of AW0 and AW3 that a rig does not support, and the stated reasons.
MISSING = {
    "plant_a": ("air lost per minute", "no thermometer in the chambers"),
    "hall_b": ("roll stiffness", "the lateral actuator goes to positions only"),
}


@pytest.fixture
def run_on(tmp_path):
    """Run a plan on a rig, strange or our own, built with ``changes``; return its result."""

    def run(name, plan, **changes):
        if name == "own":
            made = RigInMemory(Rig(load("astb").with_values(**changes), seed=1))
        else:
            made = STRANGE[name](seed=1, **changes)
        with made.bench() as bench:
            return execute(plans()[plan], bench, tmp_path / name, rig=name, seed=1)

    return run


def verdicts(result):
    return {one.name: one.verdict for one in result.checks}


@pytest.mark.parametrize(
    ("name", "plan"),
    [("plant_a", "aw0"), ("plant_a", "aw3"), ("hall_b", "aw0"), ("hall_b", "aw3")],
)
@slow
def test_a_plan_judges_a_spring_as_on_our_own_rig(run_on, name, plan):
    own, strange = run_on("own", plan), run_on(name, plan)
    assert own.verdict is Outcome.PASS, own.reason
    found, words = verdicts(strange), {one.name: one.note for one in strange.checks}
    missing, why = MISSING[name]
    assert found.keys() == verdicts(own).keys(), strange.reason
    absent = {one for one, verdict in found.items() if verdict is CheckVerdict.NOT_AVAILABLE}
    assert len(absent) == 2
    assert any(one.startswith(missing) for one in absent)
    assert all(why in words[one] for one in absent)
    assert [one.name for one in strange.checks if not one.passed and one.name not in absent] == []
    assert strange.verdict is Outcome.INCOMPLETE


@slow
def test_air_that_stays_is_seen_with_thermometers_of_a_tenth_of_a_kelvin(tmp_path):
    """Steps of 0.1 K at 10 Hz, with a lag of 1 s: read over one second they were 0.18 % of air in a minute."""
    with STRANGE["hall_b"](seed=25).bench() as bench:
        checks = execute(plans()["leak_down"], bench, tmp_path / "leak", rig="hall_b", seed=1).checks
    assert [one.value for one in checks] == pytest.approx([0.0, 0.0], abs=1e-3)


@slow
def test_amplitude_control_reaches_the_sines_of_a_described_rig(tmp_path):
    """A cycle of 50 ms loses up to a tenth of a sine of 3 Hz."""
    with STRANGE["plant_a"](seed=1).bench() as bench:
        bench.amplitude_control = True
        result = execute(plans()["dynamic_stiffness"], bench, tmp_path / "out", rig="plant_a", seed=1)
    tables = {one.name: one for one in result.curves if one.group.endswith("vertical sine of 5 mm")}
    np.testing.assert_allclose(tables["reached"].ys, AMPLITUDE, rtol=0.01)
    assert max(tables["commanded"].ys) > 1.05 * AMPLITUDE


@slow
@pytest.mark.parametrize("name", STRANGE)
def test_an_unsound_spring_fails_where_it_does_on_our_own_rig(run_on, name):
    own, strange = (run_on(one, "aw0", orifice_diameter=16 * mm) for one in ("own", name))
    assert own.verdict is strange.verdict is Outcome.FAIL
    failed = {one for one, verdict in verdicts(own).items() if verdict is CheckVerdict.FAIL}
    assert "left vertical c at 1 Hz" in failed
    both = verdicts(strange)
    # What lies close to a limit may fall on either side of it.
    sure = {
        one.name for one in own.checks if one.name in failed and abs(one.number - one.high) > 0.05 * one.high
    }
    assert {one for one in sure if both[one] is not CheckVerdict.NOT_AVAILABLE} <= {
        one for one, verdict in both.items() if verdict is CheckVerdict.FAIL
    }


def without_set_points(rig, sines):
    """Drop the set-points of 60 ms in the middle of each of the first ``sines``; return how many were begun."""
    receive, told = rig.receive, SimpleNamespace(last=[], count=0, sines=0)

    def lossy(identifier, data):
        if identifier == SET_POSITIONS:
            told.last = [*told.last[-2:], data[:6]]
            told.count = told.count + 1 if len(set(told.last)) > 1 else 0  # a turning point may come twice
            told.sines += told.count == 1
            if told.sines <= sines and 50 <= told.count < 53:
                return
        receive(identifier, data)

    rig.receive = lossy
    return told


@pytest.mark.parametrize("disturbed", [0, 2, TRIES])
def test_a_sine_whose_set_points_came_late_is_run_again(disturbed):
    made = VirtualHall(seed=1)
    with made.bench() as bench:
        bench.arm()
        bench.vertical.move_to(0.0, 0.0, rate=40 * mm)
        bench.wait(1.0)
        told = without_set_points(made.rig, disturbed)
        said = []
        log = SimpleNamespace(event=lambda time, kind, text, **data: said.append(text))
        run = Run(bench, log, dimensions=bench.dimensions)
        times, values = shake(run, "lateral", 3.0, LATERAL)
    assert told.sines == min(disturbed + 1, TRIES)
    assert sum("not the sine of 3 Hz" in one for one in said) == min(disturbed, TRIES - 1)
    assert ["set-points come late" in one for one in run.warnings] == [True] * (disturbed == TRIES)
    sine = AMPLITUDE * np.sqrt(0.5)
    assert values["lateral.displacement"].std() == pytest.approx(sine, rel=0.1 if run.warnings else 0.02)
    assert times[-1] - times[0] == pytest.approx(5 / 3, abs=0.02)
