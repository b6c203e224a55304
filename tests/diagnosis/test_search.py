"""Effects hidden in the motion of an oscillator, and what the search says of them."""

import os
from types import SimpleNamespace

import numpy as np
import pytest

from diagnosis.contracts import DiagnosisError
from diagnosis.engine.admission import _comparable
from diagnosis.engine.base_model import without_effects
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.fitting.fit import fit
from diagnosis.engine.fitting.point import base_point
from diagnosis.engine.fitting.replay import Replay
from diagnosis.engine.noise import white
from diagnosis.engine.runs import measured_channels, split
from diagnosis.engine.search import search as search_for
from diagnosis.engine.search_state import Problem
from diagnosis.finding import Verdict
from tests.refusals import refuses

ONE = Config(workers=1)


def search(lab, data, config=ONE):
    data, simulator = measured_channels(data, lab.simulator)
    replay = Replay(simulator, data.of("fit"), config.workers)
    return search_for(Problem(replay, data.of("select"), simulator.catalogue, config))


def named(result):
    return [accepted.effect for accepted in result.accepted]


def lambda_of(lab, effects):
    """λ: the misfit which the base model cannot take up, in the noise of the data sheet; no random number in it."""
    data = lab.measure(0, effects, loud=0.0)
    replay = Replay(lab.simulator, data.of("fit"), 1)
    noise = white([c.noise for c in lab.simulator.channels])
    base = fit(replay, noise, base_point(lab.simulator.nuisances, replay.names), refresh=True)
    return np.sqrt(base.linearisation.chi2)


def sized(lab, effect, lam, **shapes):
    """The effect with the amplitude at which its λ is ``lam``."""
    amplitude = lab.simulator.catalogue[effect].amplitude.spread
    for _ in range(6):
        amplitude *= lam / lambda_of(lab, {effect: {"amplitude": amplitude, **shapes}})
    return {effect: {"amplitude": amplitude, **shapes}}


HIDDEN = [
    {"cubic": {"amplitude": 3e4}},
    {"quadratic": {"amplitude": -1500.0}},
    {"coulomb": {"amplitude": 0.2}},
    {"maxwell": {"amplitude": 60.0, "tau": 0.2}},
    {"maxwell_two": {"amplitude": 200.0, "tau": 0.03, "ratio": 1.0, "tau_two": 0.8}},
    {"lag": {"amplitude": 1e-3}},
    {"force_gain": {"amplitude": 0.01}},
    {"drift": {"amplitude": -0.2}},
]


@pytest.mark.parametrize("hidden", HIDDEN, ids=lambda hidden: next(iter(hidden)))
def test_a_hidden_effect_is_named_and_its_size_found(laboratory, hidden):
    lab = laboratory()
    ((effect, truth),) = hidden.items()
    result = search(lab, lab.measure(11, hidden))
    assert named(result) == [effect]
    assert not result.ambiguous(ONE.ambiguous)
    found = result.model.point.effects()[effect]
    for coordinate in result.model.point.coordinates:
        if coordinate.owner == effect:
            name = coordinate.parameter.name
            sd = result.model.deviation(coordinate)
            sd *= truth[name] if coordinate.parameter.logarithmic else 1.0
            assert abs(found[name] - truth[name]) < 4.0 * sd


def test_a_pair_of_effects_is_named(laboratory):
    lab = laboratory(samples=800)
    result = search(lab, lab.measure(12, {"cubic": {"amplitude": 1e5}, "lag": {"amplitude": 5e-4}}))
    assert sorted(named(result)) == ["cubic", "lag"]


@pytest.mark.parametrize("conditions", [{}, {"colour": 0.9}, {"quantised": True}, {"dropped": 0.1}], ids=str)
def test_no_cause_is_named_without_a_hidden_effect(laboratory, conditions):
    lab = laboratory()
    for seed in range(3):
        result = search(lab, lab.measure(100 + seed, **conditions))
        assert not result.accepted


def test_two_branches_are_not_called_two_causes(laboratory):
    """A rubber with two relaxation times is near to one with one and some friction: the family comes first."""
    lab = laboratory(samples=800)
    two = {"maxwell_two": {"amplitude": 150.0, "tau": 0.05, "ratio": 1.0, "tau_two": 0.4}}
    for seed in range(2):
        assert named(search(lab, lab.measure(200 + seed, two))) == ["maxwell_two"]


def test_the_base_parameters_are_biased_without_the_effect_and_right_with_it(laboratory):
    lab = laboratory()
    data = lab.measure(13, {"maxwell": {"amplitude": 200.0, "tau": 0.1}})
    rng = np.random.default_rng(13)
    truth = {
        n.name: n.nominal + n.spread * rng.standard_normal() for n in lab.simulator.nuisances if not n.per_run
    }
    result = search(lab, data)

    def off(model):
        return [
            abs(model.point.values()[i] - truth[c.parameter.name]) / model.deviation(c)
            for i, c in enumerate(model.point.coordinates)
            if not c.owner and not c.record
        ]

    assert max(off(result.model)) < 4.0
    model = result.model
    base = fit(model.replay, model.noise, without_effects(model.point), model.linearisation)
    assert max(off(base)) > 10.0


def test_the_same_seed_says_the_same_whatever_the_workers(laboratory, oscillator, force_surface):
    lab = laboratory(oscillator(surfaces=(force_surface,)), samples=600)
    data = lab.measure(14, {"coulomb": {"amplitude": 0.1}})
    findings = []
    for workers in (1, 2):
        finding = diagnose(data, lab.simulator, Config(workers=workers))
        finding.provenance.config["workers"] = 0
        findings.append(finding.to_json())
    assert findings[0] == findings[1]


def test_panel_and_gain_can_be_left_out_and_change_no_verdict(laboratory):
    lab = laboratory(samples=400)
    data = lab.measure(14, {"coulomb": {"amplitude": 0.1}})
    whole, short = (
        diagnose(data, lab.simulator, Config(workers=1, with_panel=told, with_gain=told))
        for told in (True, False)
    )
    assert whole.panel and whole.gains and whole.traces
    assert not (short.panel or short.gains or short.coverage or short.traces)
    assert (short.verdict, short.causes, short.scores) == (whole.verdict, whole.causes, whole.scores)


@pytest.mark.slow
def test_a_stop_is_in_no_catalogue_and_stays_unknown(laboratory, oscillator, force_surface):
    lab = laboratory(oscillator(surfaces=(force_surface,)), samples=800)
    finding = diagnose(lab.measure(15, {"stop": {"amplitude": 300.0, "gap": 0.02}}), lab.simulator, ONE)
    assert finding.verdict is Verdict.UNKNOWN
    assert not finding.causes
    assert finding.unknowns[0].kept


def test_what_two_effects_do_alike_is_called_ambiguous(laboratory, oscillator):
    """The same cause under two names: they cannot be separated, and neither is named alone."""
    from dataclasses import replace

    catalogue = oscillator().catalogue
    twin = replace(catalogue["drift"], name="creep", title="creep")

    class Twins(oscillator):
        def run(self, experiment, parameters, effects):
            both = {"amplitude": sum(effects.get(n, {}).get("amplitude", 0.0) for n in ("drift", "creep"))}
            return super().run(experiment, parameters, {**effects, "drift": both})

    lab = laboratory(Twins(catalogue={**catalogue, "creep": twin}))
    finding = diagnose(lab.measure(16, {"drift": {"amplitude": 0.3}}), lab.simulator, ONE)
    assert finding.verdict is Verdict.AMBIGUOUS
    assert {finding.causes[0].effect, finding.ambiguous_with[0].effect} == {"drift", "creep"}
    assert finding.ambiguous_with[0].bic_gap == pytest.approx(0.0, abs=0.5)


def test_a_negative_friction_is_not_accepted(laboratory):
    lab = laboratory()
    result = search(lab, lab.measure(17, {"coulomb": {"amplitude": -0.3}}))
    assert "coulomb" not in named(result)


def test_an_idle_effect_does_not_pass_where_the_misfit_is_of_another_kind(laboratory):
    """Significant, but a thousandth of a misfit in plain view: true statistics, no use."""
    lab = laboratory()
    drive = np.sin(2.0 * np.pi * 0.05 * lab.dt * np.arange(lab.samples))
    data = lab.measure(18, {"drift": {"amplitude": 0.02}})
    for run in data.runs:
        run.outputs[:, 1] += 50.0 * np.sign(drive) * (1.0 + 0.1 * np.sin(17.0 * drive))
    result = search(lab, data, Config(workers=1, effects=("drift",)))
    assert not result.accepted


def test_effects_may_be_chosen_and_unknown_ones_are_refused(laboratory):
    lab = laboratory()
    data = lab.measure(19, {"cubic": {"amplitude": 1e5}})
    finding = diagnose(data, lab.simulator, Config(workers=1, effects=("cubic", "lag")))
    assert {score.effect for score in finding.scores} == {"cubic", "lag"}
    with refuses(DiagnosisError, "'cubicle'"):
        diagnose(data, lab.simulator, Config(effects=("cubicle",)))


def test_a_channel_that_was_not_measured_is_left_out(laboratory):
    lab = laboratory()
    data = lab.measure(20, {"lag": {"amplitude": 1e-3}})
    for run in data.runs:
        run.outputs[:, 1] = np.nan
    result = search(lab, data)
    assert [c.name for c in result.model.replay.simulator.channels] == ["displacement"]


def test_runs_are_split_by_whole_runs_and_by_the_seed(laboratory):
    from dataclasses import replace

    data = laboratory(samples=10).measure(21)
    data = replace(data, runs=tuple(replace(run, role="fit") for run in data.runs))
    once, again = split(data, 3), split(data, 3)
    assert [r.role for r in once.runs] == [r.role for r in again.runs]
    assert sorted(r.role for r in once.runs) == ["fit", "fit", "fit", "report", "select"]
    assert sorted(r.role for r in split(replace(data, runs=data.runs[:2]), 1).runs) == ["fit", "fit"]
    assert [r.role for r in split(replace(data, runs=data.runs[:1]), 1).runs] == ["fit"]
    with refuses(DiagnosisError, "runs"):
        split(replace(data, runs=()), 1)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_power_and_names_at_given_strengths(laboratory):
    """Of every effect with one amplitude: detected and named at λ = 6 and 10, and never another name."""
    lab = laboratory()
    right = {6.0: [], 10.0: []}
    wrong = 0
    for lam, results in right.items():
        for effect in ("cubic", "quadratic", "coulomb", "lag", "force_gain", "drift"):
            hidden = sized(lab, effect, lam)
            for seed in range(10):
                result = search(lab, lab.measure(3000 + seed, hidden))
                names = {*named(result), *(trial.effect for _, trial in result.ambiguous(ONE.ambiguous))}
                results.append(named(result) == [effect] and len(names) == 1)
                wrong += bool(names) and effect not in names
    assert np.mean(right[6.0]) >= 0.8
    assert np.mean(right[10.0]) >= 0.95
    assert wrong == 0


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_intervals_cover_and_amplitudes_are_right_at_twelve(laboratory):
    lab = laboratory()
    hits, errors = [], []
    for effect in ("cubic", "coulomb", "lag", "drift"):
        hidden = sized(lab, effect, 12.0)
        truth = hidden[effect]["amplitude"]
        for seed in range(25):
            result = search(lab, lab.measure(4000 + seed, hidden))
            if named(result) == [effect]:
                place = result.model.point.coordinates[-1]
                assert place.owner == effect
                error = result.model.point.effects()[effect]["amplitude"] - truth
                hits.append(abs(error) < 1.96 * result.model.deviation(place))
                errors.append(abs(error / truth))
    assert len(hits) >= 95
    assert 0.88 <= np.mean(hits) <= 0.99
    assert np.mean(errors) < 0.10


#: Sound laboratories per condition. A hundred see, in nineteen of twenty cases, that more than 6 % (white noise) or 8 %
#: are accused; three hundred (ASTB_NULLS=300) see 4 % and 5 %. `make benchmark-diagnosis` counts 1300.
NULLS = int(os.environ.get("ASTB_NULLS", "100"))


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("conditions", "most"),
    [
        ({}, 0.02),
        ({"colour": 0.6}, 0.03),
        ({"colour": 0.9}, 0.03),
        ({"quantised": True}, 0.03),
        ({"dropped": 0.1}, 0.03),
    ],
    ids=str,
)
def test_false_alarms(laboratory, conditions, most):
    """Targets of 1 % for white noise, with the tolerance of chance, and of 3 % in other cases."""
    lab = laboratory(samples=1000)
    alarms = 0
    for seed in range(NULLS):
        result = search(lab, lab.measure(5000 + seed, **conditions))
        alarms += bool(result.accepted) or bool(result.state.current.screening.exceeding)
    assert alarms <= most * NULLS


@pytest.mark.parametrize(
    ("gain", "others", "kept"),
    [
        (100.0, {"half": 50.1, "less": 49.9}, ["half"]),
        (18.0, {"near": 8.1, "far": 7.9}, ["near"]),  # within what a verdict calls ambiguous
        (2.4, {"little": 0.8, "worse": -1.1}, ["little"]),
    ],
)
def test_causes_with_a_similar_gain_are_alternatives(gain, others, kept):
    def trial(name, gained):
        return SimpleNamespace(effect=name, bic=1000.0 - gained)

    chosen = trial("chosen", gain)
    trials = [chosen, *(trial(name, gained) for name, gained in others.items())]
    assert _comparable(1000.0, chosen, trials, Config().ambiguous) == kept
