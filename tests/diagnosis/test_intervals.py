"""Intervals of a cause's numbers: along bent valleys, inside their ranges, and not below what the samples resolve."""

from dataclasses import dataclass, field, replace
from math import pi

import numpy as np
import pytest

from diagnosis.contracts import (
    Channel,
    Dataset,
    DiagnosisError,
    Experiment,
    Hypothesis,
    MeasuredRun,
    Parameter,
)
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point, effect_coordinates
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.intervals import below_resolution, intervals, profiled, resolution
from diagnosis.engine.noise import white
from diagnosis.estimates import estimate
from diagnosis.finding import Verdict
from diagnosis.systems.piston import PISTON
from tests.refusals import refuses

Z = 1.959963984540054


@dataclass(frozen=True)
class Bent:
    """y = θ³ in n samples: χ² rises by n·(θ³ − θ_0³)², whatever the curvature at θ_0."""

    name: str = "bent"
    channels: tuple = (Channel("y", "V"),)
    nuisances: tuple = ()
    catalogue: dict = field(
        default_factory=lambda: {
            "bend": Hypothesis(
                "bend", "shape", "a bend", Parameter("theta", "1", 0.0, 1.0, low=0.0, step=1e-4)
            )
        }
    )
    surfaces: tuple = ()

    def run(self, experiment, parameters, effects):
        return np.full((len(experiment.time), 1), effects.get("bend", {}).get("theta", 0.0) ** 3)


@pytest.mark.parametrize("cube", [0.5, 0.2])
def test_an_interval_along_a_bent_valley_ends_where_chi2_has_risen(cube):
    system, time = Bent(), np.arange(50.0)
    alternating = np.where(np.arange(50) % 2, 1.0, -1.0)[:, None]
    run = MeasuredRun(Experiment("one", time, {}), cube + alternating, time >= 0.0, time < 0.0)
    effect = system.catalogue["bend"]
    start = base_point((), ["one"]).extended(effect_coordinates(effect), [0.5])
    model = fit(Replay(system, (run,), 1), white([1.0]), start, refresh=True, steps=100)
    low, high = (model.point.coordinates[0].to_value(end) for end in profiled(model, 0))
    half = Z / np.sqrt(50.0)
    assert high**3 == pytest.approx(cube + half, abs=0.1 * half)  # a rise within a fifth is good enough
    if cube < half:
        assert low == 0.0  # the range ends before χ² has risen
    else:
        assert low**3 == pytest.approx(cube - half, abs=0.1 * half)
    (told,) = intervals(
        effect, model, 4.0 * model.covariance()
    )  # twice as uncertain: where χ² has risen by four times
    assert told.high**3 == pytest.approx(cube + 2.0 * half, abs=0.2 * half)


def test_no_interval_leaves_the_range():
    share = Parameter("share", "1", 0.7, 0.4, low=0.0, high=1.0, display="%", scale=0.01)
    told = estimate(share, 0.8, 0.5)
    assert (told.low, told.high) == (0.0, 100.0)
    assert told.sd == pytest.approx(50.0)


STEP, SPEED = 0.01, 10e-3
SETTINGS = {"bore": 25e-3, "stroke_from": -5e-3, "stroke_to": 45e-3, "ambient_pressure": 101_325.0}


def strokes(effects, roles=("fit",), seed=4):
    """Strokes of 10 mm/s, a sample every 0.1 mm, of an actuator with effects; noise of 0.05 N."""
    system = PISTON.simulator(SETTINGS, (PISTON.outputs[0].channel(0.05, 0.0),))
    rng, runs = np.random.default_rng(seed), []
    for k, role in enumerate(roles):
        clock = STEP * np.arange(1200)
        x = 17e-3 + 20e-3 * (2.0 / pi) * np.arcsin(np.sin(pi * SPEED / 40e-3 * clock + k))
        p = 3e5 + 1e5 * k + 2e4 * np.sin(2.0 * clock + k)
        inputs = {
            "displacement": x,
            "speed": np.gradient(x, STEP),
            "pressure": p,
            "pressure_rate": np.gradient(p, STEP),
            "time": clock,
        }
        experiment = Experiment(f"stroke {k}", clock, inputs)
        force = system.run(experiment, {}, effects) + 0.05 * rng.standard_normal((len(clock), 1))
        runs.append(MeasuredRun(experiment, force, clock > 0.5, clock < 0.0, role))
    return system, Dataset(system.channels, tuple(runs))


def fitted(presliding):
    hidden = {
        "seal_presliding": {
            "force_at_4_bar": 6.0,
            "share_growing_with_pressure": 0.6,
            "presliding_distance": presliding,
        }
    }
    system, data = strokes(hidden, roles=("fit", "fit"))
    effect = system.catalogue["seal_presliding"]
    start = base_point(system.nuisances, [r.experiment.record for r in data.runs])
    start = start.extended(effect_coordinates(effect), list(hidden["seal_presliding"].values()))
    return effect, fit(Replay(system, data.runs, 1), white([0.05]), start)


def test_a_presliding_below_the_travel_per_sample_is_a_bound():
    effect, model = fitted(10e-6)
    place = model.point.place(effect_coordinates(effect)[2])
    assert resolution(model, place) == pytest.approx(SPEED * STEP, rel=0.01)
    assert below_resolution(model, effect) == ["presliding_distance"]
    force, share, presliding = intervals(effect, model, model.covariance())
    assert presliding.value is None and presliding.below == pytest.approx(0.1, rel=0.01)
    assert force.low < 6.0 < force.high and share.low < 60.0 < share.high


def test_a_presliding_of_several_samples_has_an_interval():
    effect, model = fitted(0.5e-3)
    assert below_resolution(model, effect) == []
    *_, presliding = intervals(effect, model, model.covariance())
    assert presliding.below is None and presliding.low < 0.5 < presliding.high


def test_a_lag_below_the_sampling_period_is_no_cause_and_a_longer_one_is():
    config = Config(workers=1, effects=("force_lag",), with_panel=False)
    findings = {}
    for lag, verdict in ((4e-3, Verdict.UNRESOLVED), (25e-3, Verdict.NAMED)):
        system, data = strokes({"force_lag": {"lag": lag}}, ("fit", "fit", "select", "report"))
        findings[lag] = diagnose(data, system, config)
        assert findings[lag].verdict is verdict
    (told,) = findings[25e-3].causes[0].parameters
    assert told.low < 25.0 < told.high
    (suspect,) = findings[4e-3].suspects
    assert (suspect.effect, suspect.why) == ("force_lag", "it is smaller than the samples can resolve")
    assert "is the best candidate, but it is smaller than the samples can resolve" in findings[4e-3].sentence
    assert findings[25e-3].suspects == []


def test_a_length_without_a_measured_displacement_is_refused():
    effect, model = fitted(0.5e-3)
    bare = [replace(run, experiment=replace(run.experiment, inputs={})) for run in model.replay.runs]
    place = model.point.place(effect_coordinates(effect)[2])
    with refuses(DiagnosisError, "'displacement' 0"):
        resolution(replace(model, replay=model.replay.of(bare)), place)
