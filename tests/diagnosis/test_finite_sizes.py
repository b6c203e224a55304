"""Causes that act only now and then: found at finite amplitudes where the score at 0 does not show them."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from astb_studies.oscillator import OSCILLATOR_EFFECTS
from diagnosis.contracts import Hypothesis, Parameter
from diagnosis.engine import search as searching
from diagnosis.engine.config import SIZES, Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.finding import Verdict

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "diagnose-other-data.md"
ONE = Config(workers=1, with_panel=False)
#: Met in a few stretches of a run.
HIDDEN = {"stop": {"amplitude": 14700.0, "gap": 0.0095}}
STOP = Hypothesis(
    "stop",
    "spring",
    "a stop",
    Parameter("amplitude", "N/m", 0.0, 2e4, low=0.0),
    shapes=(Parameter("gap", "m", 0.01, 0.01, 0.001, 0.05, logarithmic=True),),
    grid=((0.004,), (0.006,), (0.008,), (0.012,)),
)
CATALOGUE = {**OSCILLATOR_EFFECTS, "stop": STOP}
SLOW = pytest.mark.slow


@pytest.mark.parametrize("seed", [1001, pytest.param(1, marks=SLOW), pytest.param(7, marks=SLOW)])
def test_an_intermittent_stop_is_named_with_its_size(laboratory, oscillator, seed):
    lab = laboratory(oscillator(catalogue=CATALOGUE))
    finding = diagnose(lab.measure(seed, HIDDEN), lab.simulator, ONE)
    assert finding.verdict in {Verdict.NAMED, Verdict.REMAINDER}
    assert [cause.effect for cause in finding.causes] == ["stop"]
    stiffness, gap = finding.causes[0].parameters
    assert stiffness.value == pytest.approx(HIDDEN["stop"]["amplitude"], rel=0.02)
    assert gap.value == pytest.approx(HIDDEN["stop"]["gap"], rel=0.02)


def test_without_the_second_look_it_is_not_found(laboratory, oscillator, monkeypatch):
    lab = laboratory(oscillator(catalogue=CATALOGUE))
    data = lab.measure(1001, HIDDEN)
    monkeypatch.setattr(searching, "far_above_noise", lambda _state: False)
    assert not diagnose(data, lab.simulator, ONE).causes


def test_the_documentation_has_the_same_stop():
    (example,) = (
        text
        for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.DOTALL)
        if "stop = " in text
    )
    names: dict[str, object] = {}
    exec(compile(example, str(PAGE), "exec"), names)
    assert names["stop"] == STOP


@pytest.mark.parametrize(
    "hidden", [{}, {"coulomb": {"amplitude": 0.2}}, {"cubic": {"amplitude": 3e4}}], ids=str
)
def test_no_second_search_at_the_noise_level(laboratory, oscillator, monkeypatch, hidden):
    lab = laboratory(oscillator(catalogue=CATALOGUE), samples=600)

    def never(*_):
        raise AssertionError

    monkeypatch.setattr(searching, "try_finite_sizes", never)
    finding = diagnose(lab.measure(11, hidden), lab.simulator, ONE)
    assert [cause.effect for cause in finding.causes] == list(hidden)


@SLOW
@pytest.mark.parametrize("end", ["nan", "raise"])
def test_what_diverges_at_a_finite_amplitude_is_left_out(laboratory, oscillator, end):
    """A candidate that has no finite outputs at 1 or 5 times its size, or none that is tried, hides no other one."""
    ripe = Hypothesis("ripe", "loss", "ripe", Parameter("amplitude", "N", 0.0, 1.0, low=0.0))

    class Diverging(oscillator):
        def run(self, experiment, parameters, effects):
            outputs = super().run(experiment, parameters, effects)
            size = effects.get("ripe", {}).get("amplitude", 0.0)
            if size >= SIZES[0] and end == "raise":
                raise OverflowError
            outputs[:, 0] += 1e-6 * size * np.sin(experiment.time) if size < SIZES[1] else math.nan
            return outputs

    simulator = Diverging(catalogue={**CATALOGUE, "ripe": ripe})
    lab = laboratory(simulator)
    finding = diagnose(lab.measure(1001, HIDDEN), simulator, ONE)
    assert [cause.effect for cause in finding.causes] == ["stop"]


@pytest.mark.parametrize("seed", [1001, pytest.param(1, marks=SLOW)])
def test_a_stop_without_a_candidate_causes_no_wrong_name(laboratory, oscillator, seed):
    """A candidate that leaves most of the error is not named: the verdict reports an unknown error."""
    lab = laboratory(oscillator())
    finding = diagnose(lab.measure(seed, HIDDEN), lab.simulator, ONE)
    assert finding.verdict in {Verdict.UNRESOLVED, Verdict.REMAINDER}
    assert finding.verdict is Verdict.UNRESOLVED or "does not explain all" in finding.sentence


def test_amplitudes_of_both_signs_are_tried_where_both_are_physical(laboratory, oscillator):
    """The hidden stop as its own mirror: a two-sided candidate whose negative amplitudes are the stop."""
    mirrored = replace(STOP, name="mirrored", amplitude=Parameter("amplitude", "N/m", 0.0, 2e4))

    class Mirror(oscillator):
        def run(self, experiment, parameters, effects):
            values = effects.get("mirrored", {})
            stop = {"amplitude": max(-values.get("amplitude", 0.0), 0.0), "gap": values.get("gap", 1.0)}
            return super().run(experiment, parameters, {"stop": stop, **effects})

    simulator = Mirror(catalogue={"mirrored": mirrored})
    data = laboratory(oscillator()).measure(1001, HIDDEN)
    finding = diagnose(data, simulator, ONE)
    assert [cause.effect for cause in finding.causes] == ["mirrored"]
    assert finding.causes[0].parameters[0].value == pytest.approx(-HIDDEN["stop"]["amplitude"], rel=0.02)
