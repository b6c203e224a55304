"""The sentence of a finding and of a check is put together from parts that fit: effects, sizes, rivals, causes."""

import re

import msgspec
import pytest

from astb.diagnose import _estimate
from bench_records.check_table import certainty
from bench_records.result import check
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.effect import Effect
from diagnosis.contracts import Hypothesis
from diagnosis.engine.remainder import Remainder
from diagnosis.engine.summary import Conclusions, summarised
from diagnosis.finding import Cause, Estimate, Finding, Models, Provenance, Rival, Verdict
from diagnosis.systems.chamber_effects import chamber_effects
from diagnosis.systems.piston_effects import PISTON_EFFECTS


def test_every_effect_says_what_is_so() -> None:
    for effect in CATALOGUE.values():
        assert effect.plain and ("{side}" in effect.plain) == bool(effect.places), effect.name
        assert not effect.plain.endswith(")"), f"{effect.name}: its amount follows in parentheses"
        assert effect.plain[0].islower() and not effect.plain.endswith("."), effect.name
    assert all(one.plain and not one.plain.endswith(")") for one in PISTON_EFFECTS.values())


@pytest.mark.parametrize(
    "effect",
    [*CATALOGUE.values(), *PISTON_EFFECTS.values(), *chamber_effects(1e-3).values()],
    ids=lambda one: one.name,
)
def test_the_symbols_of_every_equation_are_explained(effect: Effect | Hypothesis) -> None:
    equation, _, symbols = effect.equation.partition("\n")
    used, explained = (set(re.findall(r"[^\W\d_]+", text)) for text in (equation, symbols))
    assert {one for one in used if len(one) == 1} - set("dΣπ½²") <= explained


@pytest.mark.parametrize(
    ("plain", "told"),
    [("the left bellows leaks", "The left bellows leaks"), ("", "There is dry friction")],
)
def test_a_finding_says_it_as_a_sentence(plain: str, told: str) -> None:
    size = Estimate(name="area", unit="mm2", value=0.2, sd=0.01, low=0.18, high=0.22)
    one = Cause(
        effect="leak.left", title="dry friction", family="gas", parameters=[size], strength=1.0, score=9.0,
        bic_gain=1.0, lpd_gain=1.0, gained=1.0, plain=plain,
    )  # fmt: skip
    left = Remainder(role="fit", before=4.0, after=1.0, left=0.0)
    said = _sentence(Verdict.NAMED, one, left)
    assert said.startswith(told) and "0.200 ± 0.020 mm2" in said
    rival = msgspec.structs.replace(_rival(size), title="heat", instead_of="leak.left")
    asked = _sentence(Verdict.AMBIGUOUS, one, left, rival)
    assert "dry friction" in asked and "heat explains" in asked and "0.200 ± 0.020 mm2" in asked


@pytest.mark.parametrize(
    ("size", "told"),
    [
        ({"value": 0.4, "low": 0.39, "high": 0.41}, "0.4000 ± 0.0100"),
        ({"value": 0.4, "low": 0.1, "high": 0.41}, "0.40, 95 % interval: 0.10 to 0.41"),
        ({"value": 0.4, "low": None, "high": None}, "0.4"),
        ({"value": None, "low": None, "high": None, "below": 0.4}, "below 0.4"),
    ],
)
def test_a_pure_number_has_no_unit(size: dict[str, float | None], told: str) -> None:
    for unit, after in (("1", ""), ("N", " N")):
        one = Estimate(name="ratio", unit=unit, sd=None, **size)
        cause = Cause(
            effect="heat", title="heat", family="gas", parameters=[one], strength=1.0, score=9.0, bic_gain=1.0,
            lpd_gain=1.0,
        )  # fmt: skip
        left = Remainder("fit", 1.0, 0.0, 0.0)
        text = _sentence(Verdict.AMBIGUOUS, cause, left, _rival(one))
        assert text.count(told.replace(",", after + ",") if "," in told else told + after) == 1
        assert unit == "1" or f"{unit} (" in f"{_estimate(one)} ("
        assert unit != "1" or " 1 " not in f"{_estimate(one)} "


def _sentence(verdict: Verdict, one: Cause, left: Remainder, *rivals: Rival) -> str:
    finding = Finding(
        verdict=verdict, sentence="", causes=[one], threshold=3.0, alpha=0.01, ambiguous_with=[*rivals],
        provenance=Provenance(simulator="", seed=1, fit=[], select=[], report=[]), models=Models(before={}, after={}),
    )  # fmt: skip
    return summarised(finding, Conclusions([one], left)).sentence


def _rival(one: Estimate) -> Rival:
    return Rival(
        effect="maxwell",
        title="rubber",
        family="rubber",
        instead_of="heat",
        parameters=[one],
        bic_gap=1.0,
        cosine=0.9,
    )


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        ({"noise": 0.99}, "almost only from noise"),
        ({"laser_offset": 0.8, "noise": 0.6}, "mainly from laser offset, then noise"),
        ({"one": 0.6, "other": 0.6, "third": 0.5}, "from one, other and others"),
    ],
)
def test_a_check_says_what_makes_it_uncertain(parts: dict[str, float], told: str) -> None:
    said = certainty(check("K", 0.0, "N", low=-9.0, high=9.0, u=1.0, parts=parts))
    assert said.partition("; uncertainty ")[2].replace("other, one", "one, other") == told
