"""The mutation matrix: the table of faults, who is meant for what, and the page; faults that were caught still are."""

from collections import Counter
from xml.sax.saxutils import escape

import numpy as np
import pytest

from astb.campaigns.plan_case import run_plan_case
from astb.session import planned_faults, simulated_parameters
from astb_studies.mutations.faults import judge, mutations, read_cells
from astb_studies.mutations.healthy import read_sound_runs, sound_rig, tolerances
from astb_studies.mutations.measure import cells_of, drawn_values, fault_cases, sound_case, sound_run
from astb_studies.mutations.page import PAGE, PICTURE, page
from bench_protocol.units import mm
from bench_sim.parameters import load
from bench_sim.rig.faults.catalogue import find_fault
from test_plans.discovery import plans
from tests.refusals import refuses

FAULTS = {one.name: one for one in mutations().mutation}
#: Some that each of these plans is there for, and that no other test breaks a bench with.
STILL_CAUGHT = {
    "tightness": ("thermometer stuck",),
    "lateral_stiffness": ("shear cell stuck",),
    "dynamic_stiffness": ("orifice 14 mm", "load cells 10 ms late"),
    "differential_pressure_valve": ("dpv set high",),
    "measuring_chain": ("lasers swapped", "load cells swapped"),
    "safety": ("service valves clogged",),
}


def check(name, value, verdict="pass", low=0.0, high=10.0):
    return {"name": name, "value": value, "low": low, "high": high, "verdict": verdict}


def row(verdict, *checks, reason=""):
    return {"plan": "a_plan", "verdict": verdict, "reason": reason, "checks": list(checks)}


AIR = "air lost per minute, {} spring"
SOUND = row("pass", check(AIR.format("left"), 5.0), check(AIR.format("right"), 5.0), check("c at 1 Hz", 5.0))


def judged(*args, **kwargs):
    return judge(mutations(), FAULTS["leak 5e-11"], row(*args, **kwargs), SOUND)


def test_each_kind_has_faults_that_name_their_check():
    assert len(FAULTS) == len(mutations().mutation) >= 25
    assert {one.kind for one in FAULTS.values()} == {"plant", "sensor", "wire"}
    known = set(mutations().reasons)
    for one in FAULTS.values():
        assert set(one.right) <= known, one.name
        assert one.side in ("", "left", "right"), one.name
    assert known == {name for one in FAULTS.values() for name in one.right}, "an unused reason"


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_can_be_had_and_changes_something(name):
    simulation = FAULTS[name].simulation
    parameters = simulated_parameters(simulation)
    for planned in planned_faults(simulation):
        find_fault(planned.name).read(planned.values)
    assert simulation.faults or parameters.digest() != load().digest()


def test_each_check_detects_its_fault():
    cell = judged("fail", check("c at 1 Hz", 11.0, "fail"), check(AIR.format("left"), 11.0, "fail"))
    assert (cell.found, cell.told) == ("caught", "air lost per minute, left spring; c at 1 Hz")


@pytest.mark.parametrize(
    "failed", ["c at 1 Hz", AIR.format("right"), "air lost per minute"], ids=["check", "side", "nothing"]
)
def test_another_check_or_the_other_spring_is_the_wrong_reason(failed):
    cell = judged("fail", check(failed, 11.0, "fail"))
    assert cell.found == ("caught" if failed == "air lost per minute" else "wrong reason")


def test_a_blocked_plan_caught_it_only_if_it_says_what_it_should():
    assert judged("blocked", reason="the link to the rig: gone").found == "wrong reason"
    lost = FAULTS["PLC restarts"]
    air = "keep away from the springs: they hold pressure; the bench, in OFF, vents the springs by itself"
    for reason in ("the link to the rig: gone", f"{air}; the link to the rig: gone"):
        assert judge(mutations(), lost, row("blocked", reason=reason), SOUND).found == "caught"
    assert judge(mutations(), lost, row("blocked", reason=air), SOUND).found == "wrong reason"


def test_a_miss_tells_how_near_it_was():
    cell = judged("pass", check(AIR.format("left"), 8.0), check("c at 1 Hz", 4.0), check("new", 9.9))
    assert (cell.found, cell.nearest, cell.used) == ("missed", AIR.format("left"), 0.6)
    assert judged("pass", check("c at 1 Hz", 8.0, high=None)).nearest == "", "there is no limit that way"


def test_the_page_says_what_was_measured():
    assert PAGE.read_text(encoding="utf-8") == page(), "python -m astb_studies.mutations.measure page"


def test_the_picture_shows_what_was_measured():
    drawn, cells = (PAGE.parent / PICTURE).read_text(encoding="utf-8"), read_cells()
    found = Counter(cell.found for cell in cells)
    for name in ("caught", "wrong reason"):
        group = drawn.partition(f'<g id="{name.replace(" ", "-")}">')[2].partition('<g id="')[0]
        assert group.count("<use ") == found[name] > 0, name
    for name in FAULTS.keys() | {cell.plan.replace("_", " ") for cell in cells}:
        assert f">{escape(name)}</text>" in drawn, name


def test_every_fault_that_no_plan_catches_is_explained_and_no_other():
    caught = {cell.mutation for cell in read_cells() if cell.found == "caught"}
    assert {name for name, one in FAULTS.items() if one.missed} == FAULTS.keys() - caught


def test_every_plan_of_the_matrix_detects_some_effect():
    cells = read_cells()
    tried = {cell.plan for cell in cells}
    assert tried == {cell.plan for cell in cells if cell.found == "caught"}
    assert tried == {name for name, plan in plans().items() if plan.judges}


def test_at_most_one_sound_rig_in_a_hundred_was_rejected():
    """At least five hundred, or the statistics are too weak; each plan that judges, with drawn parameters if any."""
    runs = [run for run in read_sound_runs() if not run.refused]
    assert len({run.seed for run in runs}) == len(runs) >= 500
    assert sum(run.rejected for run in runs) <= 0.01 * len(runs)
    judging = {name for name, plan in plans().items() if plan.judges}
    assert {run.plan for run in runs} == judging
    assert {run.plan for run in runs if run.values} == {name for name in judging if drawn_values(name, 0)}


def test_sound_rigs_differ_within_their_tolerances():
    drawing, table = load(), tolerances()
    drawn = [simulated_parameters(sound_rig(seed)) for seed in range(20)]
    for name, one in (table.part | table.day).items():
        values = np.array([rig.entries[name].value for rig in drawn])
        assert len(np.unique(values)) == values.size, f"{name}: each rig and each spring has its own"
        if one.spread:
            assert np.abs(values / drawing.entries[name].value - 1).max() <= one.spread
    offsets = np.array([rig.entries["lever_offset"].value for rig in drawn])
    assert 0.1 * mm < offsets.std() < 0.35 * mm
    assert sound_rig(3) == sound_rig(3)


@pytest.mark.slow
@pytest.mark.parametrize("plan", STILL_CAUGHT)
def test_what_was_caught_still_is(plan):
    """A part of the matrix, measured again: limits that were opened, or checks that went, turn up here."""
    cases = [sound_case(plan), *fault_cases(plan, [FAULTS[name] for name in STILL_CAUGHT[plan]])]
    rows = [{"plan": plan, "variant": case.variant, "error": ""} | run_plan_case(case) for case in cases]
    found = {cell.mutation: cell.found for cell in cells_of(rows)}
    assert found == dict.fromkeys(STILL_CAUGHT[plan], "caught")


def test_a_case_without_a_verdict_is_no_cell_and_a_rejected_rig_says_why():
    sound = {"plan": "tightness", "variant": "sound", "error": "", **row("pass")} | {"plan": "tightness"}
    broken = {"plan": "tightness", "variant": "leak 5e-11", "error": "KilledWorker", **row(None)}
    with refuses(ValueError, "KilledWorker"):
        cells_of([sound, broken | {"plan": "tightness"}])
    run = sound_run({"seed": 4, "error": "", **row("fail", check("c at 1 Hz", 11.0, "fail"))})
    assert run.rejected
    assert run.told == "c at 1 Hz"
    nothing = sound_run({"plan": "tightness", "seed": 4, "error": "KilledWorker"})
    assert nothing.rejected
    assert nothing.told == "KilledWorker"
    text = "not ready: travel to the stop (wind = 9 m/s (gust) goes 42.5 mm; set a smaller wind); air at 3 bar (2 bar)"
    refused = sound_run({"plan": "tightness", "seed": 4, "error": "", **row("blocked", reason=text)})
    assert refused.refused
    assert refused.told == "not ready: travel to the stop; air at 3 bar"
