"""Where runs cannot distinguish the laws of a phenomenon, the phenomenon is named, and no law."""

from collections import Counter
from functools import cache

import pytest

from astb_studies.benchmarks.diagnosis.oscillator_cases import OscillatorCases
from astb_studies.oscillator import Oscillator
from bench_sim.model.effects import CATALOGUE
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.equivalence_classes import alike_laws
from diagnosis.finding import Finding
from diagnosis.systems.chamber_effects import chamber_effects
from diagnosis.systems.piston_effects import PISTON_EFFECTS

#: Two branches of a λ of 20 to 40, and one branch of 20 to 70: each is near to the other.
CASES = [
    ("near", 1125),
    pytest.param("near", 1785, marks=pytest.mark.slow),
    pytest.param("single", 300017, marks=pytest.mark.slow),
]


@cache
def identified(kind: str, seed: int) -> tuple[str, Finding]:
    cases = OscillatorCases()
    truth = cases.draw(seed, kind, "white")
    config = Config(seed=seed, workers=1, with_panel=False, with_gain=False)
    return next(iter(truth.effects)), diagnose(cases.data(truth), cases.simulator, config)


@pytest.mark.parametrize(("kind", "seed"), CASES)
def test_no_law_is_named_if_the_runs_are_insufficient(kind, seed):
    hidden, finding = identified(kind, seed)
    (cause,) = finding.causes
    assert hidden in {cause.effect, *(law.effect for law in cause.laws)}
    assert cause.laws and {law.family for law in cause.laws} == {"rubber"}
    summary = finding.summary
    assert "relaxation of the rubber" in summary.wrong and f"{cause.title} (" not in summary.wrong
    assert all(f"{one.title} (" in summary.sure for one in (cause, *cause.laws))
    assert all(part in summary.sure for part in cause.separated_by.partition(": ")[::2])


@pytest.mark.slow
def test_a_law_is_identified_from_sufficient_runs():
    for kind, seed in (("near", 1165), ("single", 300072)):
        hidden, finding = identified(kind, seed)
        assert finding.names == (hidden,) and not finding.causes[0].laws
        assert finding.causes[0].title in finding.summary.wrong


@pytest.mark.parametrize(
    "catalogue",
    [Oscillator().catalogue, PISTON_EFFECTS, chamber_effects(0.02), CATALOGUE],
    ids=["oscillator", "piston", "chamber", "bench"],
)
def test_every_phenomenon_has_several_laws_and_something_tells_them(catalogue):
    laws = Counter(one.phenomenon for one in catalogue.values() if one.phenomenon)
    assert laws and min(laws.values()) >= 2
    for phenomenon in laws:
        names = [name for name, one in catalogue.items() if one.phenomenon == phenomenon]
        assert any(catalogue[name].separated_by for name in names)
        for name in names:
            assert alike_laws(catalogue, name) == [other for other in names if other != name]
            richer = [one for one in catalogue[name].richer if catalogue[one].phenomenon]
            assert set(richer) < set(names), f"{name}: a richer law describes the same phenomenon"
