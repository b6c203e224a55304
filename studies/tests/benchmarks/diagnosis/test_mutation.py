"""The judge rejects a diagnosis without its guards."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from astb_studies.benchmarks.diagnosis.ground_truth import GroundTruth
from astb_studies.benchmarks.diagnosis.judge import judge
from astb_studies.benchmarks.diagnosis.oscillator_cases import OscillatorCases
from diagnosis.engine import backward, noise, noise_estimate, screening, trials
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose

WHITE = [("white", seed) for seed in (21, 22)]
COLOURED = [("AR 0.9", seed) for seed in (32, 33, 37, 41)]


@pytest.fixture
def alarms(judged):
    """Diagnose oscillators without a hidden effect; return the wrong findings."""
    return lambda cases: [
        one.amiss for one in (judged("oscillator", "null", *case) for case in cases) if one.amiss
    ]


def test_all_guards_give_no_false_alarm(alarms):
    assert not alarms([*WHITE, *COLOURED])


def test_without_the_threshold_chance_is_accused(alarms, monkeypatch):
    monkeypatch.setattr(screening, "threshold", lambda *_: 0.0)
    assert alarms(WHITE)


def test_without_whitening_coloured_noise_is_accused(alarms, monkeypatch):
    def as_if_white(channels, leftovers, counted, spent=0.0):
        errors = [
            np.concatenate([left[mask[:, i], i] for left, mask in zip(leftovers, counted, strict=True)])
            for i in range(len(channels))
        ]
        return noise.white([float(np.std(error)) for error in errors])

    monkeypatch.setattr(noise_estimate, "estimate", as_if_white)
    assert alarms(COLOURED)


def with_effects(seed, effects):
    cases = OscillatorCases()
    return cases.data(msgspec.structs.replace(cases.draw(seed, "null", "white"), effects=effects))


def judged_case(data, simulator, what):
    """Judge the finding for an effect that is in no catalogue."""
    finding = diagnose(data, simulator, Config(seed=31, workers=1))
    sealed = GroundTruth(
        seed=31, kind="outside", condition="white", lambdas={what: 50.0}, outside={what: 1.0}
    )
    return judge(finding, sealed, simulator, system="oscillator")


def judged_push(simulator):
    """Friction that pushes instead of dragging: no physical cause of the catalogue does."""
    return judged_case(with_effects(31, {"coulomb": {"amplitude": -0.4}}), simulator, "push")


def judged_incident():
    """A force that crept away while the fitted runs were made and never again: no property of the oscillator."""
    crept, healthy = (with_effects(32, effects) for effects in ({"drift": {"amplitude": 0.1}}, {}))
    runs = tuple(a if a.role == "fit" else b for a, b in zip(crept.runs, healthy.runs, strict=True))
    return judged_case(replace(crept, runs=runs), OscillatorCases().simulator, "incident")


def test_a_push_is_not_called_friction():
    found = judged_push(OscillatorCases().simulator)
    assert found.detected
    assert not found.amiss


def test_without_physical_signs_a_push_is_called_friction():
    simulator = OscillatorCases().simulator
    coulomb = simulator.catalogue["coulomb"]
    free = replace(coulomb, amplitude=replace(coulomb.amplitude, low=-np.inf))
    simulator = replace(simulator, catalogue={**simulator.catalogue, "coulomb": free})
    assert "coulomb" in judged_push(simulator).wrong


def test_an_incident_is_not_called_a_property():
    assert not judged_incident().amiss


def test_without_gates_an_incident_is_called_a_property(monkeypatch):
    for asked in (trials, backward):  # on entry, and again for the residual
        monkeypatch.setattr(asked, "unfit", lambda *_: "")
        monkeypatch.setattr(asked, "useless", lambda *_: "")
    assert "drift" in judged_incident().wrong
