"""The residual on unseen runs lowers the verdict, and is reported."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from astb_studies.oscillator import SURFACE_SHAPE, Laboratory, Oscillator, coefficients_of, force_surface
from diagnosis.contracts import Channel, Experiment, MeasuredRun
from diagnosis.engine.config import REMAINDER_RATIO, Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.remainder import Remainder, held_back, part_left
from diagnosis.engine.verdict import final
from diagnosis.finding import Verdict


def left(before=20.0, after=1.1, part=0.05, **without):
    return Remainder("report", before, after, part, without)


def test_a_plain_name_is_for_what_reaches_the_noise():
    assert final(Verdict.NAMED, left(after=1.9)) is Verdict.NAMED
    assert final(Verdict.NAMED, left(after=2.1)) is Verdict.REMAINDER
    assert final(Verdict.AMBIGUOUS, left(after=9.0)) is Verdict.AMBIGUOUS


def test_no_effect_is_for_what_reaches_the_noise():
    assert final(Verdict.NO_EFFECT, left(before=1.9, after=1.9, part=1.0)) is Verdict.NO_EFFECT
    assert final(Verdict.NO_EFFECT, left(after=9.0, part=1.0)) is Verdict.UNRESOLVED
    assert final(Verdict.NO_EFFECT, left(after=math.nan, part=math.nan)) is Verdict.NO_EFFECT


class Plain(Oscillator):
    """An oscillator without a form for the unknown effect."""

    surfaces = ()


#: What a finding of each verdict has.
NAMES: set[Verdict] = {Verdict.NAMED, Verdict.AMBIGUOUS, Verdict.REMAINDER}


def coherent(finding) -> bool:
    """Return whether verdict, causes, sentence, gain and remainder of a finding say the same."""
    (gain,) = [one for one in finding.gains if one.channel == "all"]
    large = gain.noise_ratio > REMAINDER_RATIO
    left = any("does not explain all" in one for one in finding.remains)
    return (
        bool(finding.causes) == (finding.verdict in NAMES)
        and ("do not contradict" in finding.sentence) == (finding.verdict is Verdict.NO_EFFECT)
        and not (large and finding.verdict in {Verdict.NO_EFFECT, Verdict.NAMED})
        and (not large or f"{gain.noise_ratio:.3g} times the noise" in finding.sentence)
        and (not large or left)
    )


HIDDEN = [
    {},
    {"coulomb": {"amplitude": 3.0}},
    {"coulomb": {"amplitude": 0.6}},
    {"cubic": {"amplitude": 1e6}},
    {"maxwell": {"amplitude": 600.0}, "lag": {"amplitude": 5e-3}},
    {"force_gain": {"amplitude": 0.03}},
]


@pytest.mark.parametrize(("hidden", "expected"), [(0, Verdict.NO_EFFECT), (1, Verdict.UNRESOLVED)])
def test_a_catalogue_without_the_cause_and_without_surfaces_does_not_acquit(laboratory, hidden, expected):
    """Fifteen times the noise were reported as zero."""
    data = laboratory(samples=400).measure(31, HIDDEN[hidden])
    finding = diagnose(data, Plain(), Config(workers=1, effects=("lag",)))
    assert finding.verdict is expected
    assert coherent(finding)


@pytest.mark.slow
@settings(deadline=None, max_examples=25, derandomize=True)
@given(
    st.sampled_from(HIDDEN),
    st.sets(st.sampled_from(sorted(Oscillator().catalogue)), min_size=1, max_size=3),
    st.booleans(),
)
def test_a_finding_never_contradicts_itself(hidden, effects, plain):
    data = Laboratory(Oscillator(), samples=400).measure(32, hidden)
    finding = diagnose(
        data, Plain() if plain else Oscillator(), Config(workers=1, effects=tuple(sorted(effects)))
    )
    assert coherent(finding), finding.sentence


def test_where_more_than_noise_is_left_a_rival_that_foretells_as_well_makes_it_ambiguous():
    assert final(Verdict.NAMED, left(after=9.0), rivals=1) is Verdict.AMBIGUOUS
    assert final(Verdict.REMAINDER, left(after=9.0), rivals=1) is Verdict.AMBIGUOUS
    assert final(Verdict.NAMED, left(after=11.0, part=0.55), rivals=1) is Verdict.UNRESOLVED
    assert final(Verdict.UNKNOWN, left(after=9.0), rivals=1) is Verdict.UNKNOWN


def test_what_leaves_most_of_the_error_in_every_channel_is_not_named():
    assert final(Verdict.NAMED, left(after=11.0, part=0.55)) is Verdict.UNRESOLVED
    assert final(Verdict.REMAINDER, left(after=11.0, part=0.55)) is Verdict.UNRESOLVED
    # Little is left in absolute terms: a small effect in noise is no relative.
    assert final(Verdict.NAMED, left(before=1.3, after=1.2, part=0.8)) is Verdict.NAMED
    assert final(Verdict.NAMED, left(after=1.0, part=math.nan)) is Verdict.NAMED


def test_the_gain_of_a_cause_is_relative_to_the_explainable_part():
    found = left(before=5.0, after=2.0, lag=3.0, drift=2.0, leak=1.0)
    assert found.gained("lag") == pytest.approx((9.0 - 4.0) / 8.0)
    assert found.gained("drift") == 0.0
    assert math.isnan(found.gained("leak"))


def test_the_remainder_is_measured_where_the_fit_has_seen_least():
    from dataclasses import replace

    from diagnosis.contracts import Dataset

    time = np.arange(4.0)
    run = MeasuredRun(Experiment("a", time, {}), np.zeros((4, 1)), time < 9.0, time > 9.0)
    data = Dataset((Channel("F", "N"),), (run, replace(run, role="select")))
    assert held_back(data)[0] == "select"
    assert held_back(replace(data, runs=(run,)))[0] == "fit"


def predicted(*roots):
    """A prediction of zeros that misses each channel by so much, as a root mean square."""
    time = np.arange(4.0)
    run = MeasuredRun(
        Experiment("a", time, {}), np.outer([1.0, -1.0, 1.0, -1.0], roots), time < 9.0, time > 9.0
    )
    return SimpleNamespace(replay=SimpleNamespace(runs=[run]), outputs=[np.zeros((4, len(roots)))])


def test_a_channel_that_reaches_its_noise_by_chance_does_not_speak_for_the_others():
    floors = np.ones(2)
    assert part_left(predicted(5.0, 1.1), predicted(3.0, 0.9), floors) == pytest.approx(
        math.sqrt(8.0 / (24.0 + 0.21))
    )
    assert part_left(predicted(5.0, 5.0), predicted(1.0, 0.9), floors) == 0.0
    assert math.isnan(part_left(predicted(1.01, 0.9), predicted(0.9, 0.9), floors))


def test_hysteresis_without_a_candidate_gives_no_maxwell_branch(laboratory):
    """A large friction and a catalogue of relatives: no plain name, and the sentence states the residual."""
    lab = laboratory(samples=400)
    data = lab.measure(31, {"coulomb": {"amplitude": 3.0}})
    finding = diagnose(data, lab.simulator, Config(workers=1, effects=("maxwell",)))
    assert finding.verdict is Verdict.UNRESOLVED
    (near,) = finding.suspects
    assert near.effect == "maxwell" and near.why in finding.sentence
    assert finding.gains[0].noise_ratio > 2.0
    assert f" {finding.gains[0].noise_ratio:.3g} times the noise" in finding.sentence


def test_the_sentence_contains_the_improvement(laboratory):
    lab = laboratory(samples=600)
    finding = diagnose(
        lab.measure(32, {"cubic": {"amplitude": 1e6}}),
        lab.simulator,
        Config(workers=1, effects=("cubic", "lag")),
    )
    gain = finding.gains[0]
    text = f"the error falls from {gain.noise_ratio_before:.3g} to {gain.noise_ratio:.3g} times the noise"
    assert finding.verdict is Verdict.NAMED
    assert text in finding.sentence
    assert finding.causes[0].gained == pytest.approx(gain.fraction, abs=0.02)


#: An inexact equation: a force over displacement and speed that no candidate has.
ROUGH = coefficients_of(0.3 * np.random.default_rng(6).standard_normal(SURFACE_SHAPE))


@pytest.mark.parametrize("surfaces", [(), (force_surface(),)])
def test_a_small_second_cause_enters_if_the_model_is_sufficient_with_it(laboratory, oscillator, surfaces):
    """A true score of 8 was dropped, since what was found before may be inexact by as much."""
    lab = laboratory(oscillator(surfaces=surfaces), samples=400)
    config = Config(workers=1, rough=0.9)
    two = lab.measure(33, {"cubic": {"amplitude": 1e6}, "lag": {"amplitude": 1e-4}})
    finding = diagnose(two, lab.simulator, config)
    assert {one.effect for one in finding.causes} == {"cubic", "lag"}
    rough = lab.measure(33, {"cubic": {"amplitude": 1e6}, "force": ROUGH})
    assert [one.effect for one in diagnose(rough, lab.simulator, config).causes] == ["cubic"]


def test_a_score_that_may_be_roughness_of_a_cause_is_mentioned(laboratory, oscillator):
    lab = laboratory(oscillator(surfaces=(force_surface(),)), samples=400)
    data = lab.measure(33, {"cubic": {"amplitude": 1e6}, "force": ROUGH})
    finding = diagnose(data, lab.simulator, Config(workers=1, rough=0.9))
    assert any("scores in the final model" in one for one in finding.remains)
    assert "Open points" in finding.summary.sure
