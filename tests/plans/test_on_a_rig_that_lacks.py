"""Plans on a rig that lacks something: what it cannot measure is not available, and never a pass."""

from html import unescape
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import pytest
from click.testing import CliRunner

from astb.commands.run import run_command
from astb.rig_in_memory import RigInMemory
from bench_protocol.dimensions import ordinary
from bench_records.record import read
from bench_records.report import write_report
from bench_records.result import CheckVerdict, Outcome, read_result
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.steps import CARRYING

NO_GAS = "no thermometer in the chambers"
NO_FORCE = "the lateral actuator goes to positions only"


@pytest.fixture
def run_without(tmp_path):
    """Run a plan on a rig without some signals: a dictionary of reasons."""

    def run(name, absent, dimensions=None):
        memory = RigInMemory(Rig(load("astb"), seed=0))
        states = []
        with memory.bench(absent=absent) as bench:
            bench.dimensions = ordinary() if dimensions is None else dimensions
            memory.clock.every(100_000_000, lambda: states.append(memory.rig.state.name))
            result = execute(plans()[name], bench, tmp_path / "out", rig="short")
        said = [event.text for event in read(tmp_path / "out").events if event.kind == "note"]
        return SimpleNamespace(result=result, states=set(states), said=said, directory=tmp_path / "out")

    return run


def names(result, verdict):
    return {check.name for check in result.checks if check.verdict is verdict}


@pytest.mark.slow
def test_what_the_rig_cannot_measure_is_not_available_and_the_rest_is_judged(run_without):
    absent = {
        "left.auxiliary_temperature": NO_GAS,
        "right.auxiliary_temperature": NO_GAS,
        "lateral.force": NO_FORCE,
        "lateral.force_setpoint": NO_FORCE,
        "load_cell.4": "broken",
        "platform.vertical_setpoint": "bolted down",
        "rig.pipe": "none",
    }
    run = run_without("aw0", absent)
    assert run.result.verdict is Outcome.INCOMPLETE
    lacking = names(run.result, CheckVerdict.NOT_AVAILABLE)
    assert {name for name in lacking if "Hz" not in name} == {
        "air lost per minute, left spring",
        "air lost per minute, right spring",
        "load on the right spring",
        "right vertical stiffness, slow",
        "peak of the bolster",
        "roll stiffness",
        "pressure difference by rolling",
    }
    assert {f"right vertical {what} at {f} Hz" for what in ("K'", "c") for f in (0.5, 1)} < lacking
    assert "actuators without inertia over load cells at 3 Hz" in lacking
    judged = {check.name for check in run.result.checks} - lacking
    assert {"lateral stiffness, slow", "left vertical K' at 1 Hz"} < judged
    assert all(check.passed for check in run.result.checks if check.name in judged)
    reasons = {check.note for check in run.result.checks if check.name in lacking}
    assert "the rig has no load_cell.4: broken" in reasons
    assert any("shows whether the gas has settled" in text and NO_GAS in text for text in run.said)
    assert any("stays held" in text and NO_FORCE in text for text in run.said)

    assert read_result(run.directory) == run.result, "and as it was written"
    page = unescape(write_report(run.directory).read_text(encoding="utf-8"))
    assert f"{len(lacking)} not available" in page
    assert "the rig has no load_cell.4: broken" in page
    suite = ET.parse(run.directory / "junit.xml").getroot().find("testsuite")
    assert suite.get("skipped") == str(len(lacking)) == str(len(suite.findall("testcase/skipped")))


def test_a_plan_without_a_required_signal_causes_no_motion(run_without):
    run = run_without("aw3", {"vertical_right.force_setpoint": "a spring of steel"})
    assert run.result.verdict is Outcome.BLOCKED
    assert run.result.reason == (
        "the rig: the rig has no vertical_right.force_setpoint: a spring of steel; aw3 cannot run without it"
    )
    assert run.result.phases == []
    assert run.states <= {"OFF", "BOOT", "INIT", "DISABLED"}


def test_every_plan_says_what_its_load_is_taken_up_with():
    assert not [name for name, plan in plans().items() if not set(CARRYING) <= set(plan.needs)]


def test_a_plan_without_any_possible_check_causes_no_motion(run_without):
    run = run_without("leak_down", {"left.auxiliary_temperature": NO_GAS})
    assert run.result.verdict is Outcome.BLOCKED
    assert (
        f"has no left.auxiliary_temperature: {NO_GAS}; leak_down cannot run without it" in run.result.reason
    )
    assert run.states <= {"OFF", "BOOT", "INIT", "DISABLED"}


@pytest.mark.slow
def test_unobserved_gas_gets_time_to_settle(run_without):
    gas = {
        f"{side}.{part}_temperature": NO_GAS
        for side in ("left", "right")
        for part in ("bellows", "auxiliary")
    }
    run = run_without("aw0", gas)
    assert run.result.verdict is Outcome.INCOMPLETE
    assert names(run.result, CheckVerdict.NOT_AVAILABLE) == {
        "air lost per minute, left spring",
        "air lost per minute, right spring",
    }
    assert any("15 s to settle" in text for text in run.said)


@pytest.mark.parametrize(
    ("verdicts", "status"),
    [
        (["pass", "pass"], 0),
        (["pass", "incomplete"], 4),
        (["incomplete", "fail"], 1),
        (["blocked", "incomplete", "fail"], 3),
    ],
)
def test_the_exit_status_tells_the_most_serious_verdict(monkeypatch, verdicts, status):
    results = [SimpleNamespace(verdict=Outcome(one)) for one in verdicts]
    monkeypatch.setattr("astb.run.run_plans", lambda *arguments, **options: results)
    assert CliRunner().invoke(run_command, ["aw0", "--virtual"]).exit_code == status
