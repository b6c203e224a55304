"""A verdict follows from value and limits alone, and nothing that was not measured passes."""

import json
import math

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bench_records.curves import Axis, curve
from bench_records.layout import Phase, RecordError
from bench_records.result import (
    CheckVerdict,
    Outcome,
    Result,
    Timing,
    check,
    conclude,
    judge,
    read_result,
    unavailable,
)
from tests.refusals import refuses

numbers = st.floats(-1e12, 1e12)
margins = st.floats(0, 0.5)
limits = st.one_of(
    st.tuples(numbers, st.none()),
    st.tuples(st.none(), numbers),
    st.tuples(numbers, numbers).map(lambda pair: (min(pair), max(pair))),
)


@given(value=numbers, band=limits, margin=margins)
def test_passed_means_within_the_limits(
    value: float, band: tuple[float | None, float | None], margin: float
) -> None:
    low, high = band
    inside = (low is None or value >= low) and (high is None or value <= high)
    one = check("x", value, low=low, high=high, margin=margin)
    assert one.passed == inside
    assert (one.verdict is CheckVerdict.FAIL) == (not inside)


@given(value=numbers, band=limits, margin=margins)
def test_a_wider_margin_never_makes_a_check_better(
    value: float, band: tuple[float | None, float | None], margin: float
) -> None:
    order = [CheckVerdict.PASS, CheckVerdict.MARGINAL, CheckVerdict.FAIL]
    without, narrow, wide = (order.index(judge(value, *band, m)) for m in (0.0, margin / 2, margin))
    assert without <= narrow <= wide
    assert without != order.index(CheckVerdict.MARGINAL)


@given(low=numbers, width=st.floats(1e-3, 1e6), place=st.floats(0, 1), margin=st.floats(0.01, 0.49))
def test_values_near_a_limit_are_marginal(low: float, width: float, place: float, margin: float) -> None:
    high = low + width
    value = low + place * width
    assume(low < value < high and width > 1e-6 * abs(low))
    nearest = min(place, 1 - place)
    assume(abs(nearest - margin) > 1e-3)  # on the edge itself, rounding decides
    assert (judge(value, low, high, margin) is CheckVerdict.MARGINAL) == (nearest < margin)


@pytest.mark.parametrize(
    ("value", "low", "high", "verdict"),
    [
        (5.0, 0.0, 10.0, "pass"),
        (0.0, 0.0, 10.0, "marginal"),
        (10.0, 0.0, 10.0, "marginal"),
        (0.4, 0.0, 10.0, "marginal"),
        (0.6, 0.0, 10.0, "pass"),
        (-0.001, 0.0, 10.0, "fail"),
        (10.001, 0.0, 10.0, "fail"),
        (104.0, 100.0, None, "marginal"),  # 5 % of the limit itself
        (106.0, 100.0, None, "pass"),
        (-96.0, None, -95.0, "marginal"),
        (1e9, 0.0, None, "pass"),
        (0.0, None, 0.0, "pass"),  # nothing allowed, nothing found
        (3.0, 3.0, 3.0, "pass"),
    ],
)
def test_known_verdicts(value: float, low: float | None, high: float | None, verdict: str) -> None:
    assert check("x", value, low=low, high=high).verdict == verdict


@given(value=st.sampled_from([math.nan, math.inf, -math.inf]), band=limits, margin=margins)
def test_what_is_no_number_never_passes(
    value: float, band: tuple[float | None, float | None], margin: float
) -> None:
    one = check("x", value, low=band[0], high=band[1], margin=margin)
    assert one.verdict is CheckVerdict.ERROR
    assert not one.passed
    back = msgspec.json.decode(msgspec.json.encode(one), type=type(one))
    assert back.verdict is CheckVerdict.ERROR
    assert math.isnan(back.number)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({}, "could"),
        ({"low": math.nan}, "nan"),
        ({"high": math.inf}, "inf"),
        ({"low": 3e5, "high": 2e5, "unit": "bar", "scale": 1e5}, "low 3 bar high 2 bar"),
        ({"low": 0.0, "margin": 0.6}, "must 0 0.5"),
        ({"low": 0.0, "margin": math.nan}, "must 0 0.5"),
        ({"low": 0.0, "scale": 0.0}, "scale 0.0"),
        ({"low": 0.0, "scale": math.nan}, "scale nan"),
    ],
)
def test_checks_that_could_not_fail_or_not_pass(options: dict, complaint: str) -> None:
    with refuses(ValueError, complaint) as caught:
        check("pressure", 1.0, **options)
    assert "'pressure'" in str(caught.value)


def test_a_check_tells_itself_in_its_own_unit() -> None:
    band = check("pressure", 2.058e5, "bar", 1e5, low=2.01e5, high=2.11e5)
    assert str(band) == "pressure = 2.058 bar (2.01 to 2.11 bar): pass"
    assert str(check("loss", 12e3, "kPa", 1e3, high=10e3)) == "loss = 12 kPa (at most 10 kPa): fail"
    assert str(check("gain", math.nan, low=1)) == "gain = no value (at least 1): error"


def test_what_is_not_available_has_a_reason_no_value_and_never_passes() -> None:
    assert not LACKING.passed
    assert str(LACKING) == "roll: not available: the rig has no force control"
    assert msgspec.json.decode(msgspec.json.encode(LACKING), type=type(LACKING)) == LACKING
    with refuses(ValueError, "without"):
        unavailable("roll", "")
    with refuses(ValueError, "'good' 1"):
        msgspec.structs.replace(PASS, verdict=CheckVerdict.NOT_AVAILABLE)


PASS, FAIL = check("good", 1, low=0, high=2), check("bad", 3, low=0, high=2)
LACKING = unavailable("roll", "the rig has no force control")
MARGINAL, ERROR = check("close", 2, low=0, high=2), check("silent", math.nan, low=0, high=2)


@pytest.mark.parametrize(
    ("checks", "reason", "outcome", "why"),
    [
        ([PASS, MARGINAL], "", Outcome.PASS, ""),
        ([PASS, FAIL, ERROR], "", Outcome.FAIL, ""),
        ([PASS, ERROR], "", Outcome.BLOCKED, "the bench gave no value for: silent"),
        ([PASS, LACKING], "", Outcome.INCOMPLETE, ""),
        ([PASS, LACKING, FAIL], "", Outcome.FAIL, ""),
        ([PASS, LACKING, ERROR], "", Outcome.BLOCKED, "the bench gave no value for: silent"),
        (
            [LACKING, LACKING],
            "",
            Outcome.BLOCKED,
            "none of the checks is available: the rig has no force control",
        ),
        ([PASS, LACKING], "the rig tripped", Outcome.BLOCKED, "the rig tripped"),
        ([], "", Outcome.BLOCKED, "the plan ended without a single check"),
        ([PASS], "the rig tripped", Outcome.BLOCKED, "the rig tripped"),
        ([FAIL], "the rig tripped", Outcome.BLOCKED, "the rig tripped"),
    ],
)
def test_outcomes(checks: list, reason: str, outcome: Outcome, why: str) -> None:
    result = conclude("aw0", "title", "text", checks, reason=reason)
    assert (result.verdict, result.reason) == (outcome, why)


texts = st.text(max_size=20)
some_checks = st.lists(
    st.builds(
        lambda name, value, band, margin: check(name, value, "bar", 1e5, low=band[0], high=band[1], margin=margin),
        texts, st.floats(), limits, margins,
    ),
    max_size=5,
)  # fmt: skip


@given(
    checks=some_checks,
    title=texts,
    points=st.lists(st.floats(), max_size=8),
    seed=st.none() | st.integers(0, 2**63 - 1),
)
def test_json_there_and_back(checks: list, title: str, points: list[float], seed: int | None) -> None:
    result = conclude(
        "aw0", title, "", checks, seed=seed, phases=[Phase("main", 0.0, 1.0)],
        curves=[curve("c", Axis("x", "mm", 1e-3), Axis("y"), points, points)],
        timing=Timing(ticks=3, late=0, edges=[1e-3], counts=[3, 0]),
    )  # fmt: skip
    data = result.to_json()
    assert Result.from_json(data).to_json() == data


def test_a_verdict_that_was_tampered_with_is_refused() -> None:
    data = conclude("aw0", "", "", [FAIL]).to_json()
    for forged in (
        data.replace(b'"verdict": "fail"', b'"verdict": "pass"'),
        data.replace(b'"value": 3', b'"value": 1'),
    ):
        assert forged != data
        with pytest.raises(RecordError, match="but its"):
            Result.from_json(forged)


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"plan": "aw0"}', b"\xff\xfe"])
def test_foreign_results(tmp_path, content: bytes) -> None:
    (tmp_path / "result.json").write_bytes(content)
    with refuses(RecordError, "result.json"):
        read_result(tmp_path)


def test_missing_result(tmp_path) -> None:
    with refuses(RecordError, "result.json cannot be read"):
        read_result(tmp_path)


def test_curves_take_arrays_and_keep_gaps() -> None:
    axis = Axis("x")
    made = curve("c", axis, axis, np.array([1.0, np.nan, 3.0]), np.arange(3))
    assert made.xs == [1.0, None, 3.0]
    assert made.ys == [0.0, 1.0, 2.0]
    with refuses(ValueError, "2 1"):
        curve("c", axis, axis, [1.0, 2.0], [1.0])


def test_a_histogram_has_one_count_more_than_edges() -> None:
    with refuses(ValueError, "2 3 2"):
        Timing(ticks=1, late=0, edges=[1.0, 2.0], counts=[1, 0])
    with refuses(ValueError, "must"):
        Timing(ticks=1, late=0, edges=[2.0, 1.0], counts=[1, 0, 0])


def test_a_check_with_an_uncertainty_keeps_it_and_one_that_was_written_without_still_loads():
    known = check(
        "K'", 463e3, "kN/m", 1e3, low=427e3, high=501e3, u=2.1e3, even=0.5e3, parts={"laser gain": 0.5e3}
    )
    result = conclude("aw0", "", "", [known])
    assert Result.from_json(result.to_json()) == result
    assert known.conformity == pytest.approx(1.0)
    content = json.loads(result.to_json())
    for key in ("u", "even", "parts", "conformity"):
        del content["checks"][0][key]
    old = Result.from_json(json.dumps(content).encode()).checks[0]
    assert (old.u, old.conformity, old.verdict) == (None, None, CheckVerdict.PASS)
    assert str(old) == "K' = 463 kN/m (427 to 501 kN/m): pass"
    assert (
        str(known) == "K' = 463 ± 4 kN/m (k = 2; 427 to 501 kN/m): pass, conforms with > 99.9 % probability"
    )


def test_a_value_that_does_not_surely_conform_is_marginal_and_an_uncertainty_that_is_none_is_refused():
    assert judge(0.9, 0.0, 1.0, u=0.1) is CheckVerdict.MARGINAL
    assert judge(0.9, 0.0, 1.0, u=0.04) is CheckVerdict.PASS  # though within a twentieth or so of the limit
    assert judge(1.01, 0.0, 1.0, u=0.5) is CheckVerdict.FAIL
    assert judge(0.5, 0.0, 1.0, u=5.0) is CheckVerdict.MARGINAL  # an uninformative value is no pass
    for u, even in ((-0.1, 0.0), (0.1, 0.2), (math.inf, 0.0)):
        with refuses(ValueError, "uncertainty"):
            check("x", 0.5, low=0.0, u=u, even=even)
