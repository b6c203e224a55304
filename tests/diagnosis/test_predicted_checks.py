"""What plans measure, as stock, tuned and extended model predict it, against the rig that has the hidden effect."""

import numpy as np
import pytest

from astb.diagnose import rig_of
from astb.rig_in_memory import RigInMemory
from astb.stiffness import StiffnessChecks, sine_in
from bench_protocol.units import Hz, mm
from bench_sim.model.effects import CATALOGUE
from bench_sim.rig.rig import Rig
from diagnosis.contracts import DiagnosisError
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import white
from diagnosis.engine.predicted_checks import confirmed, gained, predicted_checks
from diagnosis.finding import NAMED, SUSPECTED, Cause, CheckPrediction
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.records import read_records
from drivers.memory import Faults
from test_plans.discovery import plans
from test_plans.execution import execute
from test_plans.programmes.motions import RestPose, Stretch, Wave
from tests.refusals import refuses

MEDLEY = (
    Stretch(
        (
            Wave("vertical", 5 * mm, 0.5 * Hz, 3, "triangle"),
            Wave("vertical", 5 * mm, 1.2 * Hz, 4),
            Wave("vertical", 2 * mm, 4.0 * Hz, 8),
            RestPose(height=6 * mm, rest=6.0),
            RestPose(),
        )
    ),
)


@pytest.fixture(scope="module")
def predicted(bench_record):
    """Return the rows by name of a rig with hidden ``effects``, where ``cause`` extends the model, and the truth."""

    def predict(cause, effects):
        made = bench_record(f"checked {cause} {len(effects)}", MEDLEY, effects=effects)
        simulator = AirSpring(made.parameters, effects=CATALOGUE)
        runs = read_records([made.directory], simulator).runs
        replay = Replay(simulator, runs, 2)
        noise = white([np.hypot(c.noise, c.resolution / np.sqrt(12.0)) for c in simulator.channels])
        point = base_point(simulator.nuisances, replay.names)
        base = fit(replay, noise, point)
        effect = simulator.catalogue[cause]
        wider = base.point.extended(effect_coordinates(effect), (0.0, *effect.grid[0]))
        extended = fit(replay, noise, wider, base.linearisation)
        checks = StiffnessChecks(rig_of(made.parameters))
        rows = predicted_checks(checks, (), base, extended, extended.covariance(), seed=1)
        truth = {}
        for experiment in checks.experiments:
            outputs = simulator.run(experiment, {}, effects)
            names = (channel.name for channel in simulator.channels)
            figures = checks.figures(experiment, dict(zip(names, outputs.T, strict=True)))
            truth |= {name: value for (name, _), value in figures.items()}
        return {row.name: row for row in rows}, truth

    return predict


STIFF = ("K' at 3 Hz, AW0", "K' at 3 Hz, AW3")


@pytest.mark.slow
def test_with_the_cause_the_stiffness_of_another_plan_is_that_of_the_rig(predicted):
    rows, truth = predicted("compliance", {"compliance": {"compliance": 1.7e-9}})
    for name in STIFF:
        row, true = rows[name], truth[name]
        assert abs(row.extended - true) < 0.6 * abs(row.tuned - true)
        assert abs(row.extended - true) < 0.2 * abs(row.stock - true)
        assert abs(row.extended - true) < row.uncertainty
    assert rows[STIFF[1]].differs, "under a load that was not in the data, the base model does not imitate it"
    assert set(rows) == set(truth)
    assert len(rows) == 16


@pytest.mark.slow
def test_an_effect_equal_to_base_parameters_is_predicted_by_tuned_and_extended_models(predicted):
    rows, truth = predicted("blocked_orifice.left", {"blocked_orifice.left": {"share": 0.24}})
    for name in STIFF:
        row, true = rows[name], truth[name]
        assert not row.differs, "a smaller discharge coefficient is the same orifice"
        for predicted_by in (row.tuned, row.extended):
            assert abs(predicted_by - true) < 0.2 * abs(row.stock - true)


@pytest.mark.slow
def test_a_cause_that_a_sound_rig_does_not_have_changes_no_prediction(predicted):
    rows, _ = predicted("compliance", {})
    assert [name for name, row in rows.items() if row.differs] == []


def test_a_sine_is_found_in_a_motion_where_it_is_steady_and_no_other_one_is():
    step = 1.0 / 200.0
    time = np.arange(4000) * step
    motion = np.where(
        time < 8.0, 5 * mm * np.sin(2 * np.pi * 3 * time), 5 * mm * np.sin(2 * np.pi * 1 * time)
    )
    motion += np.random.default_rng(1).normal(0.0, 1e-5, time.size)
    three, one = sine_in(motion, step, 3.0), sine_in(motion, step, 1.0)
    assert three.stop * step <= 8.01
    assert one.start * step >= 7.99
    assert sine_in(motion, step, 2.0) is None
    assert sine_in(0.8 * motion, step, 3.0) is None, "of another amplitude, a spring has another stiffness"
    motion[100:1500:50] = np.nan
    assert sine_in(motion, step, 3.0) is None


@pytest.mark.slow
def test_a_record_in_the_data_folder_holds_the_measured_figures(bench_record, tmp_path):
    made = bench_record("beside", MEDLEY)
    with RigInMemory(Rig(made.parameters, seed=1)).bench(outward=Faults(), seed=1) as bench:
        result = execute(plans()["dynamic_stiffness"], bench, tmp_path / "dynamic", seed=1)
    content = {check.name: check.value for check in result.checks}
    simulator = AirSpring(made.parameters, effects=CATALOGUE)
    data = read_records([made.directory, tmp_path / "dynamic"], simulator)
    (run,) = data.beside
    names = (channel.name for channel in data.channels)
    outputs = dict(zip(names, run.outputs.T, strict=True))
    figures = StiffnessChecks(rig_of(made.parameters)).figures(run.experiment, outputs)
    assert len(figures) == 8
    for (name, _), value in figures.items():
        assert 1e3 * value == pytest.approx(content[name.removesuffix(", AW0")], rel=0.01), name
    with refuses(DiagnosisError, "screening"):
        read_records([tmp_path / "dynamic"], simulator)


def row(tuned, extended, measured, uncertainty=1.0):
    return CheckPrediction(
        name="K",
        unit="N/m",
        stock=0.0,
        tuned=tuned,
        extended=extended,
        uncertainty=uncertainty,
        measured=measured,
    )


@pytest.mark.parametrize(
    ("rows", "yes"),
    [
        ([], False),
        ([row(110.0, 100.2, None)], False),
        ([row(110.0, 100.2, 100.0)], True),
        ([row(100.2, 100.1, 100.0)], False),
        ([row(110.0, 109.0, 100.0)], False),
        ([row(110.0, 100.2, 100.0), row(50.0, 50.0, 40.0)], False),
    ],
)
def test_a_suspected_cause_is_named_where_figures_of_other_plans_confirm_it(rows, yes):
    """There is an error of the base model to be explained, and most of it goes with the cause."""
    one = Cause(
        effect="softer",
        title="",
        family="",
        parameters=[],
        strength=None,
        score=None,
        bic_gain=None,
        lpd_gain=None,
        status=SUSPECTED,
    )
    assert gained(rows) is yes
    assert [cause.status for cause in confirmed([one], rows)] == [NAMED if yes else SUSPECTED]
    assert [cause.status for cause in confirmed([one, one], rows)] == [SUSPECTED, SUSPECTED]
