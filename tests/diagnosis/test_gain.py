"""The gain on unseen runs: a right extension reaches the noise, a wrong one does not, and intervals mean something."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.gain import Comparison, compare, models, shifts
from diagnosis.engine.noise import white

TRUTH = {"cubic": {"amplitude": 1.5e6}}


def arms(laboratory, seed, effect, size, truth=TRUTH):
    lab = laboratory()
    data = lab.measure(seed, truth)
    replay = Replay(lab.simulator, data.of("fit"), 1)
    noise = white([c.noise for c in data.channels])
    base = fit(replay, noise, base_point(lab.simulator.nuisances, replay.names))
    start = base.point.extended(effect_coordinates(lab.simulator.catalogue[effect]), (size,))
    return data, base, fit(replay, noise, start, base.linearisation, refresh=True)


def noise_of(data):
    return np.array([c.noise for c in data.channels])


def compared(base, extended, data, seed=0):
    before, after = (predict(model, data.of("report"), fixed=True) for model in (base, extended))
    return compare(before, after, noise_of(data), seed=seed)


@pytest.fixture(scope="module")
def right(laboratory):
    data, base, extended = arms(laboratory, 1, "cubic", 1e6)
    return data, base, extended, compared(base, extended, data)


def test_a_right_extension_explains_all_that_can_be_explained(right):
    for gain in right[3].gains:
        assert gain.fraction == pytest.approx(1.0, abs=0.02)
        assert gain.fraction_low <= gain.fraction <= gain.fraction_high
        assert gain.noise_ratio == pytest.approx(1.0, abs=0.05)
        assert gain.noise_ratio_before > 1.5
    assert [g.channel for g in right[3].gains] == ["all", "displacement", "force"]


def test_the_start_of_a_report_run_can_be_looked_up(right):
    data, base, extended, reported = right
    (run,) = data.of("report")
    both = models(base, extended, reported)
    for starts in (both.before_runs, both.after_runs):
        assert starts.keys() == {run.experiment.name, *base.replay.names}
    predicted = extended.replay.simulator.run(
        run.experiment, both.after | both.after_runs["report"], both.effects
    )
    assert np.std(run.outputs - predicted, axis=0) == pytest.approx(noise_of(data), rel=0.1)


def test_rmse_is_in_the_unit_that_people_read(right):
    data, _, _, measured = right
    (run,) = data.of("report")
    displacement = measured.gains[1]
    assert displacement.unit == "mm" and displacement.floor == pytest.approx(0.05)
    error = displacement.rmse_before * 1e-3 / run.outputs[:, 0].std()
    assert displacement.nrmse_before == pytest.approx(error, rel=1e-6)


def test_predictions_cover_what_they_should(right):
    for level in right[3].coverage:
        assert level.after == pytest.approx(level.level, abs=0.03)
        assert level.before < level.level - 0.1


def test_a_wrong_extension_gains_less(laboratory, right):
    data, base, extended = arms(laboratory, 1, "drift", 0.01)
    wrong = compared(base, extended, data).gains[0]
    assert wrong.fraction < 0.5 < right[3].gains[0].fraction


def test_no_fraction_explained_without_deviation(laboratory):
    data, base, extended = arms(laboratory, 1, "cubic", 0.0, truth=None)
    gain = compared(base, extended, data).gains[0]
    assert gain.fraction is None and gain.noise_ratio == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_the_bootstrap_interval_holds_the_truth(laboratory):
    inside = 0
    for seed in range(10):
        data, base, extended = arms(laboratory, seed, "cubic", 1e6)
        gain = compared(base, extended, data, seed=seed).gains[0]
        inside += gain.fraction_low - 0.01 <= 1.0 <= gain.fraction_high + 0.01
    assert inside >= 8


def test_traces_show_what_was_measured(right):
    data, _, _, measured = right
    trace = next(t for t in measured.traces if t.channel == "force")
    (run,) = data.of("report")
    k = round(trace.times[0] / run.experiment.step)
    assert trace.measured[0] == pytest.approx(run.outputs[k, 1], rel=1e-4)
    assert len(trace.times) == len(trace.measured) == len(trace.before) == len(trace.after)
    errors = np.array(trace.error_before)
    assert np.abs(errors).max() > 3 * np.abs(np.array(trace.error_after)).max()


def test_parameters_shift_by_more_than_the_base_model_believed(right):
    _, base, extended, _ = right
    found = shifts(base, extended, extended.covariance())
    assert abs(found[0].sigmas) > 5
    stiffness = next(s for s in found if s.name == "stiffness")
    assert stiffness.sigmas == pytest.approx((stiffness.after - stiffness.before) / stiffness.sd_before)
    assert {s.run for s in found if s.name == "start"} == set(base.replay.names)


def test_both_models_can_be_run_again(right):
    _, base, extended, _ = right
    both = models(base, extended, Comparison())
    run = extended.replay.runs[0]
    parameters = both.after | both.after_runs[run.experiment.name]
    again = extended.replay.simulator.run(run.experiment, parameters, both.effects)
    assert again == pytest.approx(extended.predictions[0], rel=1e-12, abs=1e-15)
    assert both.effects["cubic"]["amplitude"] == pytest.approx(1.5e6, rel=0.05)
