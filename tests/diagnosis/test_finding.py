"""The finding: written data are read again, contradictions are refused, intervals are closed forms."""

from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.contracts import DiagnosisError, Parameter
from diagnosis.estimates import estimate, number, numbers
from diagnosis.finding import Cause, Finding, Models, Provenance, Rival, Suspect, Verdict
from tests.refusals import refuses

LEAK = Parameter("conductance", "m³/(s Pa)", 0.0, 1e-12, display="l/min/bar", scale=1.667e-10)


def finding(verdict=Verdict.NAMED, causes=1, rivals=0, **rest):
    cause = Cause(
        effect="leak",
        title="a leak",
        family="gas",
        parameters=[estimate(LEAK, 3e-12, 1e-13)],
        strength=30.0,
        score=29.0,
        bic_gain=800.0,
        lpd_gain=None,
    )
    rival = Rival(
        effect="heat", title="heat", family="gas", instead_of="leak", parameters=[], bic_gap=3.0, cosine=0.99
    )
    return Finding(
        verdict=verdict,
        sentence="The left bellows leaks, which the model did not have.",
        causes=[cause] * causes,
        threshold=3.4,
        alpha=0.01,
        provenance=Provenance(simulator="spring", seed=1, fit=["a"], select=["b"], report=["c"]),
        models=Models(
            before={"volume": 0.02}, after={"volume": 0.021}, effects={"leak": {"conductance": 3e-12}}
        ),
        ambiguous_with=[rival] * rivals,
        **rest,
    )


def test_a_finding_comes_back_as_it_was_written():
    one = finding(remains=["something at 40 Hz"])
    assert Finding.from_json(one.to_json()) == one
    assert one.to_json() == finding(remains=["something at 40 Hz"]).to_json()
    assert Finding.from_json(one.to_json()).models.effects["leak"]["conductance"] == 3e-12
    assert one.names == ("leak",)


@pytest.mark.parametrize(
    ("verdict", "causes", "rivals"),
    [
        (Verdict.NAMED, 0, 0),
        (Verdict.REMAINDER, 0, 0),
        (Verdict.NO_EFFECT, 1, 0),
        (Verdict.AMBIGUOUS, 1, 0),
        (Verdict.NAMED, 1, 1),
    ],
)
def test_a_verdict_that_contradicts_its_evidence_is_refused(verdict, causes, rivals):
    with pytest.raises(DiagnosisError, match=verdict.value.replace("+", r"\+")):
        finding(verdict, causes, rivals)


def test_only_a_verdict_without_a_name_has_suspects():
    near = Suspect(effect="leak", title="", family="", parameters=[], strength=None, why="is too small")
    assert Finding.from_json(finding(Verdict.UNRESOLVED, 0, suspects=[near]).to_json()).suspects == [near]
    with refuses(DiagnosisError, "'named'"):
        finding(suspects=[near])


def test_what_is_no_finding_is_refused():
    with refuses(DiagnosisError, "finding"):
        Finding.from_json(b'{"verdict": "guilty"}')
    broken = msgspec.json.decode(finding().to_json())
    broken["verdict"] = "named by chance"
    with refuses(DiagnosisError, "chance"):
        Finding.from_json(msgspec.json.encode(broken))


@given(st.floats(-1e6, 1e6), st.floats(0.0, 1e3, allow_subnormal=False), st.floats(1e-6, 1e6))
def test_an_interval_is_symmetric_and_scales(value, sd, scale):
    one = estimate(Parameter("p", "Pa", 0.0, 1.0, display="unit", scale=scale), value, sd)
    assert one.unit == "unit" and one.value == pytest.approx(value / scale)
    assert one.high - one.value == pytest.approx(one.value - one.low, rel=1e-6, abs=1e-9 * abs(value / scale))
    assert one.high - one.low == pytest.approx(2 * 1.96 * sd / scale, rel=1e-4, abs=1e-9 * abs(value / scale))


@given(st.floats(1e-6, 1e6), st.floats(0.0, 5.0))
def test_an_interval_of_a_logarithm_is_symmetric_in_ratios(value, sd):
    one = estimate(Parameter("tau", "s", 1.0, 1.0, logarithmic=True), value, sd)
    assert one.low > 0 and one.high / one.value == pytest.approx(one.value / one.low)
    assert math.log(one.high / one.value) == pytest.approx(1.959963985 * sd, rel=1e-6, abs=1e-12)


def test_unknown_numbers_are_null():
    assert number(math.nan) is None and number(math.inf) is None and number(2) == 2.0
    assert numbers([1.23456789, math.nan], 3) == [1.23, None]
    unbounded = estimate(LEAK, 1.0, math.inf)
    assert unbounded.sd is None and unbounded.low is None
