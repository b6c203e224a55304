"""A rig whose form differs from the model: a detection is permitted, a wrong cause is not."""

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from astb_studies.benchmarks.diagnosis import oscillator_siblings
from astb_studies.benchmarks.diagnosis.ground_truth import draw
from astb_studies.benchmarks.diagnosis.oscillator_cases import LAMBDA_FORM, OscillatorCases
from astb_studies.benchmarks.diagnosis.sealed import parameters_of
from astb_studies.benchmarks.diagnosis.sibling_forms import CURVED, FORMS, Curved, drawn
from bench_sim.parameters import load
from bench_sim.rig.rig import Rig
from diagnosis.engine import verdict

#: A softening spring and a worn damper: the nearest entries of the catalogue score highly.
ACCUSED_WITHOUT_GUARD = (20, 46)


@pytest.mark.slow
@pytest.mark.parametrize("seed", ACCUSED_WITHOUT_GUARD)
def test_what_the_form_owes_is_seen_and_not_named(judged, seed):
    found = judged("oscillator", "null", "sibling", seed)
    assert found.detected
    assert not found.causes
    assert not found.amiss


@pytest.mark.slow
def test_without_constancy_the_form_is_called_a_cause(judged, monkeypatch):
    for guard in ("owed_to_form", "no_clearer"):
        monkeypatch.setattr(verdict, guard, lambda *_: ())
    found = [judged("oscillator", "null", "sibling", seed) for seed in ACCUSED_WITHOUT_GUARD]
    # The interval of the second holds 0: it is not named for that, either.
    assert [bool(one.amiss) for one in found] == [True, False]


def test_a_clear_cause_keeps_its_name_on_a_sibling(judged):
    found = judged("oscillator", "single", "sibling", 15)
    assert found.weakest > 50
    assert found.exact


@pytest.mark.slow
@pytest.mark.parametrize("seed", [5200110, 5200128])
def test_what_softens_is_seen_and_called_no_cubic_spring(judged, monkeypatch, seed):
    """Neither a spring nor a surface follows what a spring has been through, and both take a part of it."""
    found = judged("oscillator", "null", "sibling", seed)
    assert found.detected
    assert not found.causes
    assert found.suspects == ["cubic"]
    monkeypatch.setattr(verdict, "no_clearer", lambda *_: ())
    assert judged("oscillator", "null", "sibling", seed).causes == ["cubic"]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_siblings_are_seldom_accused(judged):
    """In ten cases without a hidden effect, no cause is reported."""
    found = [judged("oscillator", "null", "sibling", 50 + k) for k in range(10)]
    assert [one.causes for one in found if one.causes] == []


def test_forms_are_drawn_by_what_no_effect_imitates():
    cases = OscillatorCases()
    forms = [cases.draw(seed, "null", "sibling").form for seed in range(25)]
    assert {name for form in forms for name in form} == oscillator_siblings.FORMS.keys()
    noise = np.array([channel.noise for channel in cases.simulator.channels])
    for form in forms[:4]:
        moved = [
            oscillator_siblings.run(cases.simulator, form, run.experiment, {}, {})
            - cases.simulator.run(run.experiment, {}, {})
            for run in cases._base._replay.runs
        ]
        # Part of it may be imitated, by an effect or the base: at least so much is there.
        assert np.linalg.norm(np.concatenate(moved) / noise) > LAMBDA_FORM[0]


def test_a_force_that_depends_only_on_time_is_a_drive():
    """An oracle for the rounds: what does not depend on the motion is taken off the drive, and felt by the ground."""
    cases = OscillatorCases()
    experiment = cases._base._replay.runs[0].experiment

    def push(t, x, v):
        return np.sin(t)

    forms = {"push": push}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(oscillator_siblings, "FORMS", forms)
        made = oscillator_siblings.run(cases.simulator, {"push": 3.0}, experiment, {}, {})
    force = 3.0 * np.sin(experiment.time)
    drive = experiment.inputs["drive"] - force
    other = type(experiment)(experiment.name, experiment.time, {"drive": drive})
    right = cases.simulator.run(other, {}, {})
    right[:, 1] += force
    assert made == pytest.approx(right)


def test_every_form_of_the_bench_fits_into_its_ranges_and_is_drawn():
    seeds = [np.random.default_rng(seed) for seed in range(60)]
    assert {name for rng in seeds for name in drawn(rng)} == {form.name for form in FORMS}
    null = draw(1, "null", "sibling")
    assert null.form
    plain = parameters_of(msgspec.structs.replace(null, form={}))
    for form in FORMS:
        for size in form.sizes:
            changed = parameters_of(msgspec.structs.replace(null, form={form.name: size}))
            assert (changed.record == plain.record) == (form.name == CURVED)


def test_a_curved_area_is_followed_by_its_osculating_parabola():
    """Volume, area and slope of the cubic at the present height, whatever it is."""
    record = Rig(load(), seed=1).plant.parameter_array
    flat = {
        name: record[name][0].copy() for name in ("bellows_volume", "effective_area", "effective_area_slope")
    }
    memory = SimpleNamespace(bellows_vertical=np.zeros(2))
    plant = SimpleNamespace(parameter_array=record, memory=memory)
    rig = SimpleNamespace(plant=plant, run=np.zeros)
    curved = Curved(rig, 2.0)
    for heights in ([0.0, 0.0], [0.01, -0.02], [-0.015, 0.03]):
        memory.bellows_vertical[:] = z = np.array(heights)
        curved._bend()
        V, A, slope = (record[name][0] for name in flat)
        V0, A0, A1 = flat.values()
        assert V + A * z + slope * z**2 / 2 == pytest.approx(V0 + A0 * z + A1 * z**2 / 2 + 2.0 * z**3 / 6)
        assert A + slope * z == pytest.approx(A0 + A1 * z + 2.0 * z**2 / 2)
        assert slope == pytest.approx(A1 + 2.0 * z)
