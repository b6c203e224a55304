"""A finding says nothing that its own figures contradict."""

from dataclasses import replace

import numpy as np
import pytest

from astb_studies.oscillator import SURFACE_SHAPE, Oscillator, coefficients_of, force_surface
from diagnosis.engine import verdict as judging
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.gain import _fraction
from diagnosis.engine.remainder import Remainder
from diagnosis.finding import Verdict


@pytest.mark.parametrize(("before", "after"), [(4.0, 1.0), (4.0, 0.9), (1.2, 0.5), (3.0, 3.5)])
def test_no_share_of_the_error_that_is_gone_exceeds_one(before, after):
    """Less than the noise may be left by chance."""
    share = float(_fraction(np.array([before**2, after**2, 1.0]), 1.0))
    assert share == pytest.approx(min((before**2 - after**2) / (before**2 - 1.0), 1.0))
    left = Remainder("report", before, after, 0.0, {"one": before})
    assert left.gained("one") == pytest.approx((before**2 - max(after, 1.0) ** 2) / (before**2 - 1.0))


def test_a_report_run_that_changes_the_verdict_is_reported(laboratory):
    """A slow sine of the test run alone makes an error there; the validation runs know nothing of it."""
    lab = laboratory(samples=600)
    data = lab.measure(31, {"coulomb": {"amplitude": 3.0}})
    sound = diagnose(data, lab.simulator, Config(workers=1))
    assert sound.verdict is Verdict.NAMED
    assert not any("changed the verdict" in one for one in sound.remains)
    runs = []
    for run in data.runs:
        outputs = run.outputs.copy()
        if run.role == "report":
            outputs[:, 1] += 8.0 * np.sin(2.0 * np.pi * 0.3 * run.experiment.time)
        runs.append(replace(run, outputs=outputs))
    finding = diagnose(replace(data, runs=tuple(runs)), lab.simulator, Config(workers=1))
    assert finding.verdict is not Verdict.NAMED
    (told,) = (one for one in finding.remains if "changed the verdict" in one)
    assert Verdict.NAMED.value in told and told in finding.sentence


def test_a_surface_that_does_not_improve_unseen_runs_goes(laboratory, monkeypatch):
    """It is dropped with a reason, and the model, its gain and the verdict are those without it."""
    lab = laboratory(Oscillator(surfaces=(force_surface(),)), samples=600)
    shape = coefficients_of(2.0 * np.random.default_rng(2).standard_normal(SURFACE_SHAPE))
    data = lab.measure(7, {"force": shape})
    kept = diagnose(data, lab.simulator, Config(workers=1))
    assert kept.unknowns and kept.unknowns[0].kept
    assert kept.gains[0].noise_ratio < kept.gains[0].noise_ratio_before
    # The same surface, turned upside down where it was fitted, makes the test runs worse.
    fitted = judging.explain

    def worse(model, *others):
        extended, unknown = fitted(model, *others)
        numbers = extended.point.numbers.copy()
        numbers[[i for i, one in enumerate(extended.point.coordinates) if one.owner == "force"]] *= -1.0
        return replace(
            extended, linearisation=replace(extended.linearisation, point=extended.point.at(numbers))
        ), unknown

    monkeypatch.setattr(judging, "explain", worse)
    finding = diagnose(data, lab.simulator, Config(workers=1))
    assert not any(one.kept for one in finding.unknowns)
    assert finding.verdict is Verdict.UNRESOLVED
    assert finding.gains[0].noise_ratio == pytest.approx(finding.gains[0].noise_ratio_before, rel=0.02)
    assert "does not predict the test runs better" in finding.unknowns[0].sentence


@pytest.mark.parametrize("hidden", [{"cubic": {"amplitude": 1e6}}, {"coulomb": {"amplitude": 3.0}}])
def test_explained_scores_are_not_listed_as_remaining(laboratory, hidden):
    lab = laboratory(samples=400)
    finding = diagnose(lab.measure(33, hidden), lab.simulator, Config(workers=1))
    explained = [one for one in finding.scores if one.outcome == "below the threshold in the final model"]
    assert explained
    assert not [one.title for one in explained if f"{one.title} (" in " ".join(finding.remains)]
