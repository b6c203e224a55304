"""Readings held between rare samples: the period follows from the data within a part in a hundred thousand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.contracts import Experiment, MeasuredRun
from diagnosis.systems.air_spring.simulator import AirSpring
from diagnosis.systems.held_samples import errors_of, held_period, of_period

STEP, SAMPLES, NOISE = 5e-3, 4000, 30.0
SHORTEST, LONGEST = 0.01, 0.2


def pressure(clock):
    """A pressure of some kilopascals at two frequencies with hardly a common multiple (Pa)."""
    tau = 2.0 * np.pi * clock
    return 4e3 * np.sin(0.7137 * tau) + 1.5e3 * np.sin(3.0931 * tau)


def measured(held, period, seed=1, noise=NOISE, late=0.0, lost=0.0):
    """Three runs of twenty seconds out of five minutes, of one pressure that is held, late, noisy and lost in part."""
    rng = np.random.default_rng(seed)
    readings = []
    for start in (31.26, 105.0, 290.515):
        clock = start + STEP * np.arange(SAMPLES)
        age = late + held * ((clock + 1e-6) % period)
        outputs = pressure(clock - age)[:, np.newaxis] + noise * rng.standard_normal((SAMPLES, 1))
        outputs[rng.random(SAMPLES) < lost] = np.nan
        everywhere = np.ones(SAMPLES, np.bool_)
        experiment = Experiment("one", clock - start, {}, {"start": start})
        run = MeasuredRun(experiment, outputs, everywhere, ~everywhere)
        readings += errors_of(run, [0], pressure(clock)[:, np.newaxis])
    return readings


@pytest.mark.parametrize("period", [0.011, 0.0237, 0.0533, 0.0713, 0.143])
@pytest.mark.parametrize(("held", "late", "lost"), [(0.2, 0.0, 0.0), (0.6, 0.004, 0.0), (0.3, 0.001, 0.1)])
def test_the_period_is_found(period, held, late, lost):
    found = held_period(measured(held, period, late=late, lost=lost), SHORTEST, LONGEST)
    assert found == pytest.approx(period, rel=2e-5)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    period=st.floats(0.0105, 0.19),
    held=st.floats(0.1, 1.0),
    late=st.floats(0.0, 0.01),
    seed=st.integers(0, 1000),
)
def test_a_reported_period_is_correct(period, held, late, seed):
    """No period is reported where the motion has the same line; a long hold is later than rates show."""
    found = held_period(measured(held, period, seed, late=late), SHORTEST, LONGEST)
    assert found is None or found == pytest.approx(period, rel=5e-5)


@settings(max_examples=30, deadline=None)
@given(noise=st.floats(1.0, 300.0), late=st.floats(0.0, 0.02), seed=st.integers(0, 1000))
def test_readings_that_are_only_late_are_not_held(noise, late, seed):
    assert held_period(measured(0.0, 0.05, seed, noise, late), SHORTEST, LONGEST) is None


def test_a_hold_hidden_by_noise_is_not_reported():
    assert held_period(measured(0.02, 0.012, noise=300.0), SHORTEST, LONGEST) is None
    assert held_period([], SHORTEST, LONGEST) is None


def test_what_was_measured_a_day_later_is_left_out():
    early, late = measured(0.3, 0.0371), measured(0.0, 0.0371)
    later = [one._replace(clock=one.clock + 86_400.0) for one in late]
    assert held_period([*early, *later], SHORTEST, LONGEST) == held_period(early, SHORTEST, LONGEST)
    brief = [one._replace(clock=one.clock[:9], errors=one.errors[:9], rates=one.rates[:9]) for one in early]
    assert held_period(brief[:1], SHORTEST, LONGEST) is None


def test_only_a_known_period_is_tried():
    bench = AirSpring(load(), effects=CATALOGUE)
    known = of_period(bench.catalogue["sample_and_hold"], 0.0371)
    assert known.grid == ((0.0371,),)
    (period,) = known.shapes
    assert period.nominal == 0.0371
    assert period.spread < 1e-4 * period.nominal
    assert known.amplitude == bench.catalogue["sample_and_hold"].amplitude
    assert bench.sharpened((), ()) == {}
    assert AirSpring(load(), effects={}).sharpened((), ()) == {}
