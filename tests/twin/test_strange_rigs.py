"""The twin with third-party rigs, which have other messages, other rates and other noise."""

from pathlib import Path

import pytest

from astb.diagnose import built_for
from bench_records.record import read
from bench_records.twin import TwinStory
from bench_sim.model.effects.gas import sonic_conductance
from bench_sim.parameters import load
from bench_sim.rig.faults.panel import PlannedFault
from diagnosis.twin.twin import Twin
from test_plans.discovery import plans
from test_plans.execution import execute
from tests.foreign.virtual import VirtualHall, VirtualPlc, VirtualYard
from tests.twin.test_twin import run, watched

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


def live_and_replayed(made, folder: Path) -> TwinStory:
    with made.bench() as bench:
        execute(plans()["aw0"], bench, folder, rig=made.name, seed=1)
    record = read(folder)
    return Twin(record, built_for(load("astb"), [record]), "astb").look()


@pytest.mark.parametrize("made", [VirtualHall, VirtualYard])
def test_a_fault_free_rig_has_no_deviation(made, tmp_path):
    story = live_and_replayed(made(seed=3), tmp_path / "run")
    assert not story.all_deviations
    assert story.judged_for > 30.0


def test_a_rig_that_never_rests_is_not_judged_with_a_reason(tmp_path):
    story = live_and_replayed(VirtualPlc(seed=3), tmp_path / "run")
    assert not story.all_deviations and not story.judged_for
    assert "the bench was not at rest, so the initial state of the model is unknown" in {
        one.why for one in story.judged
    }


def test_a_leak_is_detected(tmp_path):
    par = load("astb").record
    hole = sonic_conductance(0.5e-6, float(par.gas_constant))
    (parting,) = live_and_replayed(
        VirtualHall(seed=4, leak_conductance=(hole, 0.0)), tmp_path / "run"
    ).all_deviations
    cause = next(one for one in parting.causes if one.name == "leak.left")
    assert cause.low < 0.5e-6 < cause.high
    assert {one.name for one in parting.causes} <= {"leak.left", "leak_laminar.left"}


def test_sensors_with_more_noise_than_their_data_sheets_say_are_no_fault(tmp_path):
    noisy = [
        PlannedFault("noise", {"sensor": f"load_cell.{k}", "value": "0.08kN", "seed": str(k)}, 0.0, None)
        for k in (1, 4)
    ]
    story = watched(run("aw0", tmp_path, 21, *noisy))
    assert not story.all_deviations
    assert story.judged_for > 30.0
