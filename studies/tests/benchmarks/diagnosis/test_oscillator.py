"""Effects hidden in an oscillator are found, or get no wrong name."""

import pytest

from astb_studies.benchmarks.diagnosis.ground_truth import NOISES
from diagnosis.finding import Verdict

SINGLES = [("white", 1), ("AR 0.6", 2), ("12 bits", 3), ("frames lost", 4)]


@pytest.mark.parametrize(("condition", "seed"), SINGLES)
def test_one_effect(judged, condition, seed):
    found = judged("oscillator", "single", condition, seed)
    assert found.hidden
    assert not found.amiss
    assert found.exact or found.weakest < 10


def test_two_effects_of_two_families(judged):
    found = judged("oscillator", "pair", "white", 6)
    assert len(found.hidden) == 2
    assert not found.amiss
    assert found.exact


@pytest.mark.parametrize("condition", NOISES)
def test_no_effect_gives_no_finding(judged, condition):
    found = judged("oscillator", "null", condition, 11)
    assert found.verdict == Verdict.NO_EFFECT
    assert not found.amiss


@pytest.mark.slow
def test_what_is_in_no_catalogue_is_called_unknown(judged):
    found = judged("oscillator", "outside", "white", 3)
    assert found.verdict == Verdict.UNKNOWN
    assert not found.causes


@pytest.mark.slow
def test_two_relaxation_times_are_not_called_friction(judged):
    found = judged("oscillator", "near", "white", 5)
    assert found.hidden == ["maxwell_two"]
    assert found.reported
    assert not found.wrong


@pytest.mark.slow
def test_a_stop_that_is_hardly_touched_is_no_cubic_spring(judged):
    """In the fit runs it looks like one; the validation run excites it more and separates them."""
    found = judged("oscillator", "outside", "white", 1063)
    assert found.hidden == ["stop"]
    assert found.verdict == Verdict.UNKNOWN
    assert not found.causes


@pytest.mark.slow
def test_two_causes_that_are_plausible_only_together(judged):
    """A lag without the rubber, or the rubber without the lag, would need another mass."""
    found = judged("oscillator", "pair", "white", 1227)
    assert sorted(found.hidden) == ["lag", "maxwell"]
    assert found.exact


@pytest.mark.parametrize(
    ("kind", "seed"), [("single", 2), ("single", 1294), pytest.param("near", 1025, marks=pytest.mark.slow)]
)
def test_what_the_true_cause_is_wrong_by_is_no_second_cause(judged, kind, seed):
    """For a large cause, an unmodelled fiftieth of it exceeds the noise."""
    found = judged("oscillator", kind, "white", seed)
    assert found.weakest > 150
    assert not found.amiss
    assert found.exact


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("kind", ["single", "pair", "null"])
def test_hardly_ever_amiss(judged, kind):
    """Of twelve of each kind under changing conditions, at most one may be amiss, and no null."""
    found = [judged("oscillator", kind, NOISES[k % len(NOISES)], 50 + k) for k in range(12)]
    amiss = [(one.seed, one.condition, one.hidden, one.amiss) for one in found if one.amiss]
    assert len(amiss) <= (0 if kind == "null" else 1), amiss


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_near_misses_are_called_by_no_name_of_another_family(judged):
    found = [judged("oscillator", "near", "white", 50 + k) for k in range(12)]
    assert [(one.seed, one.causes) for one in found if one.wrong] == []


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_what_is_in_no_catalogue_is_mostly_called_unknown(judged):
    """A small stop is no more than a cubic spring to these data: of twelve, two may be called so."""
    found = [judged("oscillator", "outside", "white", 50 + k) for k in range(12)]
    assert all(one.detected for one in found)
    assert len([one for one in found if one.causes]) <= 2
