"""Fits of models that are linear and Gaussian, where everything has a closed form, and of an oscillator that is not."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from diagnosis.contracts import (
    Channel,
    DiagnosisError,
    Experiment,
    Hypothesis,
    MeasuredRun,
    Nuisance,
    Parameter,
)
from diagnosis.engine.config import REPORTED_FIT_STEPS
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.linear import prior_of
from diagnosis.engine.fitting.linearise import linearise
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.predict import predict
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import ChannelNoise, Noise, white
from diagnosis.engine.search import search
from diagnosis.engine.search_state import Problem
from diagnosis.engine.whitening import filters
from tests.refusals import refuses

N = 60
SD = (0.5, 2.0)


@dataclass(frozen=True)
class Straight:
    """y = offset + slope t in both channels, plus an effect t²: linear in everything."""

    name: str = "line"
    channels: tuple = (Channel("a", "V"), Channel("b", "V"))
    nuisances: tuple = (
        Nuisance("slope", "V/s", 1.0, 0.3),
        Nuisance("offset", "V", 0.0, 1.0, per_run=True),
    )
    catalogue: dict = field(
        default_factory=lambda: {
            "bend": Hypothesis("bend", "shape", "a bend", Parameter("amplitude", "V/s²", 0.0, 0.5))
        }
    )
    surfaces: tuple = ()

    def run(self, experiment, parameters, effects):
        t = experiment.time
        line = parameters.get("offset", 0.0) + parameters.get("slope", 1.0) * t
        line = line + effects.get("bend", {}).get("amplitude", 0.0) * t**2
        return np.column_stack((line, 0.5 * line))


def measured(name, seed, bend=0.0, role="fit"):
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 2.0, N)
    model = Straight()
    experiment = Experiment(name, t, {})
    truth = model.run(
        experiment, {"slope": 1.2, "offset": rng.standard_normal()}, {"bend": {"amplitude": bend}}
    )
    full = np.ones(N, bool)
    return MeasuredRun(experiment, truth + np.array(SD) * rng.standard_normal((N, 2)), full, ~full, role)


def posterior(runs, bend):
    """Mean and covariance of (slope − 1)/0.3, each offset, and the amplitude/0.5, by the textbook."""
    t = runs[0].experiment.time
    size = 1 + len(runs) + bend
    rows, y = [], []
    for r, run in enumerate(runs):
        for c, half in enumerate((1.0, 0.5)):
            X = np.zeros((N, size))
            X[:, 0], X[:, 1 + r] = 0.3 * half * t, half
            if bend:
                X[:, -1] = 0.5 * half * t**2
            rows.append(X / SD[c])
            y.append((run.outputs[:, c] - half * t) / SD[c])
    X, y = np.vstack(rows), np.concatenate(y)
    W = np.diag([1.0] * (1 + len(runs)) + [0.0] * bend)
    cov = np.linalg.inv(X.T @ X + W)
    return cov @ X.T @ y, cov, X, y


@pytest.mark.parametrize("bend", [False, True])
def test_mean_covariance_cost_and_bic_of_a_linear_gaussian_model(bend):
    runs = [measured("one", 1), measured("two", 2)]
    replay = Replay(Straight(), tuple(runs), 1)
    start = base_point(replay.simulator.nuisances, replay.names)
    if bend:
        start = start.extended(effect_coordinates(replay.simulator.catalogue["bend"]), (0.1,))
    model = fit(replay, white(SD), start)
    mean, cov, X, y = posterior(runs, bend)
    assert model.converged
    assert model.point.numbers == pytest.approx(mean, abs=1e-6)
    assert model.covariance() == pytest.approx(cov, rel=1e-6, abs=1e-12)
    cost = np.sum((y - X @ mean) ** 2) + np.sum(mean[: 1 + len(runs)] ** 2)
    assert model.linearisation.penalised_chi2 == pytest.approx(cost, rel=1e-9)
    assert model.bic == pytest.approx(cost + bend * math.log(len(y)), rel=1e-9)


def test_the_predictive_density_is_that_of_the_joint_normal():
    """log p(new | old) with slope and offset integrated out, up to what is the same for every model."""
    old, new = [measured("one", 1), measured("two", 2)], measured("new", 3)
    t = new.experiment.time
    shape = np.concatenate([half / sd * np.ones(N) for half, sd in zip((1.0, 0.5), SD, strict=True)])
    ramp = np.concatenate([0.3 * half / sd * t for half, sd in zip((1.0, 0.5), SD, strict=True)])
    square = np.concatenate([0.5 * half / sd * t**2 for half, sd in zip((1.0, 0.5), SD, strict=True)])
    y = np.concatenate([(new.outputs[:, c] - half * t) / SD[c] for c, half in enumerate((1.0, 0.5))])
    lpds, exact = [], []
    for bend in (False, True):
        replay = Replay(Straight(), tuple(old), 1)
        start = base_point(replay.simulator.nuisances, replay.names)
        if bend:
            start = start.extended(effect_coordinates(replay.simulator.catalogue["bend"]), (0.0,))
        lpds.append(predict(fit(replay, white(SD), start), [new]).lpd)
        mean, cov, _, _ = posterior(old, bend)
        shared = [0, -1] if bend else [0]
        X = np.column_stack([ramp, square][: len(shared)])
        total = np.eye(2 * N) + np.outer(shape, shape) + X @ cov[np.ix_(shared, shared)] @ X.T
        exact.append(multivariate_normal(X @ mean[shared], total).logpdf(y))
    assert lpds[1] - lpds[0] == pytest.approx(exact[1] - exact[0], abs=2e-3)
    assert lpds[0] + 0.5 * len(y) * -math.log(2.0 * math.pi) == pytest.approx(exact[0], abs=1e-3)


def test_columns_of_a_neighbour_lead_to_as_good_a_fit(laboratory):
    """A fit that borrows all nuisance columns is compared by its cost: 0.1 is negligible for a BIC gap of 10."""
    lab = laboratory()
    data = lab.measure(3, {"cubic": {"amplitude": 2e5}})
    replay = Replay(lab.simulator, data.of("fit"), 1)
    noise = white([c.noise for c in lab.simulator.channels])
    base = fit(replay, noise, base_point(lab.simulator.nuisances, replay.names))
    start = base.point.extended(effect_coordinates(lab.simulator.catalogue["cubic"]), (1e5,))
    borrowed = fit(replay, noise, start, base.linearisation)
    own = fit(replay, noise, start, refresh=True)
    assert borrowed.converged
    assert own.converged
    assert borrowed.linearisation.penalised_chi2 == pytest.approx(own.linearisation.penalised_chi2, abs=0.1)
    sd = np.sqrt(np.diagonal(own.covariance()))
    assert np.all(np.abs(borrowed.point.numbers - own.point.numbers) < 0.25 * sd)


def test_reused_columns_equal_those_of_the_new_noise(laboratory):
    lab = laboratory(samples=300)
    replay = Replay(lab.simulator, lab.measure(7).of("fit"), 1)
    point = base_point(lab.simulator.nuisances, replay.names)
    predictions = replay.predictions(point)
    channels = lab.simulator.channels
    coloured = Noise(tuple(ChannelNoise((c.noise**2, 0.6 * c.noise**2)) for c in channels))
    others = filters(white([2.0 * c.noise for c in channels]), replay.runs)

    def linearised(whiten, known=None):
        return linearise(replay, whiten, point, predictions, prior_of(point), known)

    own = linearised(filters(coloured, replay.runs))
    lent = linearised(filters(coloured, replay.runs), linearised(others))
    again = linearised(others, lent)
    assert np.array_equal(lent.information, own.information)
    assert np.array_equal(lent.gradient, own.gradient)
    assert np.array_equal(again.information, linearised(others).information)


def test_a_prediction_with_fixed_numbers_simulates_only_the_new_runs_parameters(laboratory):
    lab = laboratory(samples=300)
    fitted = fit(
        Replay(lab.simulator, lab.measure(8).of("fit"), 1),
        white([c.noise for c in lab.simulator.channels]),
        base_point(lab.simulator.nuisances, ["slow", "fast"]),
    )
    tried = []

    class Counted:
        def __getattr__(self, name):
            return getattr(lab.simulator, name)

        def run(self, experiment, parameters, effects):
            tried.append(dict(parameters))
            return lab.simulator.run(experiment, parameters, effects)

    counted = replace(fitted, replay=replace(fitted.replay, simulator=Counted()))
    predict(counted, lab.measure(9).of("report"), fixed=True)
    shared = {c.parameter.name for c in fitted.point.coordinates if not c.record}
    assert shared
    assert all(
        {name: one[name] for name in shared} == {name: tried[0][name] for name in shared} for one in tried
    )


def test_workers_do_not_change_a_bit(laboratory):
    lab = laboratory()
    data = lab.measure(4)
    noise = white([c.noise for c in lab.simulator.channels])
    models = []
    for workers in (1, 2):
        replay = Replay(lab.simulator, data.of("fit"), workers)
        models.append(fit(replay, noise, base_point(lab.simulator.nuisances, replay.names)))
    assert np.array_equal(models[0].point.numbers, models[1].point.numbers)


def test_parts_of_one_record_share_its_nuisances_whatever_they_are_for(laboratory):
    lab = laboratory(samples=400)
    whole = lab.measure(5).of("fit")[0]
    half = np.arange(400) < 200
    parts = [
        replace(
            whole,
            experiment=replace(whole.experiment, name=f"part {k}", source=whole.experiment.name),
            scored=scored,
        )
        for k, scored in enumerate((half, ~half))
    ]
    noise = white([c.noise for c in lab.simulator.channels])
    fits = [
        fit(replay, noise, base_point(lab.simulator.nuisances, replay.records))
        for replay in (Replay(lab.simulator, (whole,), 1), Replay(lab.simulator, tuple(parts), 1))
    ]
    one, cut = (model.point for model in fits)
    assert cut.coordinates == one.coordinates
    assert cut.numbers == pytest.approx(one.numbers, abs=1e-6)
    assert fits[1].penalised_chi2 == pytest.approx(fits[0].penalised_chi2, rel=1e-9)
    # A part that was not fitted has no separate start: only the fit describes it.
    first = fit(Replay(lab.simulator, parts[:1], 1), noise, base_point(lab.simulator.nuisances, ["slow"]))
    there = predict(first, parts[1:], fixed=True).linearisation.point
    assert [c.label for c in there.coordinates] == [c.label for c in first.point.coordinates]
    assert all(c.held for c in there.coordinates)
    assert np.array_equal(there.numbers, first.point.numbers)


def test_an_effect_that_is_rough_has_central_differences_before_the_base_model_is_differentiated_anew():
    """A ripple of one difference step turns the one-sided slope round; on both sides of the start it is the same."""
    asked = []

    class Rippled(Straight):
        def run(self, experiment, parameters, effects):
            amplitude = effects["bend"]["amplitude"]
            asked.append((amplitude, parameters["slope"], parameters["offset"]))
            step = self.catalogue["bend"].amplitude.difference
            ripple = step * (1.0 - math.cos(math.pi * amplitude / step))
            return super().run(experiment, parameters, {"bend": {"amplitude": amplitude - ripple}})

    runs, noise = (measured("one", 1, 3.0),), white(SD)
    bend = effect_coordinates(Straight().catalogue["bend"])
    base = fit(Replay(Straight(), runs, 1), noise, base_point(Straight().nuisances, ["one"]))
    start = base.point.extended(bend, (0.0,))
    smooth = fit(Replay(Straight(), runs, 1), noise, start, base.linearisation)
    rippled = fit(Replay(Rippled(), runs, 1), noise, start, base.linearisation)
    at_start = {one for one in asked if one[0] == 0.0}
    assert len(at_start) == 1
    assert rippled.point.values()[-1] == pytest.approx(
        smooth.point.values()[-1], abs=smooth.deviation(bend[0])
    )


def test_a_model_that_fails_at_its_start_is_named():
    class Broken(Straight):
        def run(self, experiment, parameters, effects):
            return np.full((N, 2), np.nan)

    replay = Replay(Broken(), (measured("one", 1),), 1)
    with refuses(DiagnosisError, "NaN"):
        fit(replay, white(SD), base_point(Straight().nuisances, replay.names))


def test_a_model_that_raises_says_where_and_at_which_parameters():
    class Fragile(Straight):
        def run(self, experiment, parameters, effects):
            return np.ones((N, 2)) / (1 // int(2.0 - parameters["slope"]))

    replay = Replay(Fragile(), (measured("one", 1),), 1)
    text = r"line failed in the run one at slope = 1.003 V/s.*ZeroDivisionError: .*\(test_fit\.py, line \d+\)"
    with pytest.raises(DiagnosisError, match=text):
        fit(replay, white(SD), base_point(Straight().nuisances, replay.names))


def test_two_runs_of_the_same_name_are_refused():
    with refuses(DiagnosisError, "runs"):
        Replay(Straight(), (measured("one", 1), measured("one", 2)), 1)


def test_the_whole_search_is_right_about_a_line():
    data = [measured(n, s, 0.8) for n, s in (("one", 1), ("two", 2))]
    select = (measured("three", 3, 0.8),)
    from diagnosis.engine.config import Config

    replay = Replay(Straight(), tuple(data), 1)
    result = search(Problem(replay, select, Straight().catalogue, Config()))
    assert [a.effect for a in result.accepted] == ["bend"]
    found = result.model.point.effects()["bend"]["amplitude"]
    sd = result.model.deviation(result.model.point.coordinates[-1])
    assert abs(found - 0.8) < 3.5 * sd


def test_a_fit_follows_a_narrow_curved_valley(laboratory):
    """Two relaxation times: stiffness and time of the fast branch trade places with the damper over a wide range."""
    lab = laboratory(samples=1000)
    branches = {"amplitude": 150.0, "tau": 0.03, "ratio": 1.0, "tau_two": 0.3}
    data = lab.measure(1, {"maxwell_two": branches})
    replay = Replay(lab.simulator, data.of("fit"), 1)
    effect = lab.simulator.catalogue["maxwell_two"]
    base = base_point(lab.simulator.nuisances, replay.names)

    def fitted(**start):
        values = [(branches | start)[parameter.name] for parameter in effect.parameters]
        noise = white([channel.noise for channel in data.channels])
        return fit(replay, noise, base.extended(effect_coordinates(effect), values), steps=REPORTED_FIT_STEPS)

    best = fitted()
    away = fitted(amplitude=60.0, tau=0.06, ratio=2.0, tau_two=0.4)
    assert away.converged
    assert away.penalised_chi2 < best.penalised_chi2 + 4.0
