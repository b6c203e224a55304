"""Each channel is compared with its own noise: what no candidate resembles is not taken for noise."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from astb_studies.oscillator import Laboratory
from diagnosis.contracts import Channel, Dataset, Experiment, MeasuredRun
from diagnosis.engine.config import Config
from diagnosis.engine.diagnose import diagnose
from diagnosis.engine.goodness import humming, ljung_box, misfits, strongest_line
from diagnosis.finding import Verdict

SAMPLES = 2000


def series(seed, kind, size):
    """White noise of variance 1 with a sine, a walk or AR(1) noise of so large a root mean square added."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(SAMPLES)
    more = {
        "sine": lambda: np.sin(0.31 * np.arange(SAMPLES) + seed),
        "walk": lambda: np.cumsum(rng.standard_normal(SAMPLES)),
        "white": lambda: rng.standard_normal(SAMPLES),
    }[kind]()
    more = more - more.mean()
    return noise + size * more / np.sqrt(np.mean(more**2))


def measured(values, *, rest=False):
    time = 0.01 * np.arange(len(values))
    everywhere = np.ones(len(values), bool)
    return MeasuredRun(
        Experiment("run", time, {}), values[:, None], everywhere, everywhere if rest else ~everywhere
    )


def found(values, alpha=0.003, *, floor=1.0, at_rest=np.inf):
    errors = [("report", [(measured(values), values[:, None])])]
    return misfits((Channel("force", "N", 1.0),), errors, np.array([floor]), np.array([at_rest]), alpha)


@pytest.mark.parametrize(("kind", "told"), [("sine", "a sine of 4.9"), ("walk", "drift")])
@pytest.mark.parametrize("size", [1.5, 4.4])
def test_a_sine_and_a_walk_above_the_noise_are_found_and_distinguished(kind, told, size):
    for seed in range(5):
        (one,) = found(series(seed, kind, size))
        assert told in one.kind
        assert one.ratio == pytest.approx(np.hypot(1.0, size), rel=0.1)


def test_sound_errors_are_found_at_the_stated_rate(ar1):
    """AR(1) noise of the size of the data sheet is sound; so is white noise that is louder."""
    seeds = range(100)
    assert not any(found(series(seed, "sine", 0.0)) for seed in seeds)
    for colour in (0.6, 0.9):
        errors = [ar1(np.random.default_rng(seed), SAMPLES, colour) for seed in seeds]
        assert sum(bool(found(one)) for one in errors) <= 1
    assert sum(bool(found(series(seed, "white", 1.0))) for seed in seeds) <= 1


@pytest.mark.parametrize("samples", [60, 250, 1000])
@pytest.mark.parametrize("lost", [0.0, 0.1])
@pytest.mark.parametrize("colour", [0.0, 0.6, 0.9, 0.98])
def test_noise_of_any_colour_has_no_more_lines_than_the_test_states(ar1, samples, lost, colour):
    rng = np.random.default_rng(3)

    def noise():
        return np.where(rng.random(samples) < lost, np.nan, ar1(rng, samples, colour))

    lines = np.array([strongest_line(noise(), 0.01).p for _ in range(600)])
    for level in (0.05, 0.005):
        assert np.sum(lines < level) <= binom.ppf(0.999, 600, level)


def test_a_noise_that_is_estimated_from_few_samples_makes_no_misfit(ar1):
    """The noise of fifty samples at rest is too small by a fifth in one of forty cases."""
    errors = [ar1(np.random.default_rng(seed), SAMPLES, 0.3) for seed in range(20)]
    assert not any(found(1.25 * one, at_rest=50) for one in errors)
    assert all(found(1.25 * one, at_rest=2000) for one in errors)


@pytest.mark.parametrize("size", [1.5, 6.0])
@pytest.mark.parametrize("lost", [0.0, 0.1])
@pytest.mark.parametrize("colour", [0.0, 0.9])
@pytest.mark.parametrize("frequency", [3.0, 3.31, 17.77])
def test_a_line_is_found_with_frequency_and_power(ar1, colour, lost, size, frequency):
    """Also one between two ordinates of the periodogram, and with lost samples."""
    rng = np.random.default_rng(3)
    values = ar1(rng, SAMPLES, colour) + size * np.sin(2.0 * np.pi * frequency * 0.01 * np.arange(SAMPLES))
    values[rng.random(SAMPLES) < lost] = np.nan
    line = strongest_line(values, 0.01)
    assert line.p < 1e-3
    assert line.frequency == pytest.approx(frequency, abs=0.02)
    assert line.part == pytest.approx(size**2 / (size**2 + 2.0), abs=0.08)


def test_p_values_of_line_and_whiteness_are_uniform_in_white_noise():
    rng = np.random.default_rng(3)
    noise = rng.standard_normal((300, 1000))
    lines = np.array([strongest_line(one, 0.01).p for one in noise])
    memory = np.array([ljung_box(one) for one in noise])
    for p in (lines, memory):
        assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.03)


@pytest.mark.parametrize("colour", [0.6, 0.9, 0.98])
def test_coloured_noise_at_rest_is_no_hum(ar1, colour):
    """Twenty rests of two seconds, each of a new sensor."""
    rng = np.random.default_rng(7)
    cells = tuple(Channel(f"load_cell.{i}", "N", 20.0) for i in range(20))
    rests = [20.0 * np.column_stack([ar1(rng, 200, colour) for _ in cells]) for _ in range(3)]
    runs = tuple(replace(measured(one[:, 0], rest=True), outputs=one) for one in rests)
    assert humming(Dataset(cells, runs), 0.003) == []


def test_a_sensor_that_hums_at_rest_is_in_doubt():
    rng = np.random.default_rng(1)
    noise = 20.0 * rng.standard_normal(1200)
    hum = 120.0 * np.sin(2.0 * np.pi * 11.0 * 0.01 * np.arange(1200)) + 0.5 * np.arange(1200)  # and drifts
    cell, other = Channel("load_cell.3", "N", 20.0), Channel("load_cell.4", "N", 20.0)
    run = measured(noise, rest=True)
    both = replace(run, outputs=np.column_stack((noise + hum, noise)))
    (doubt,) = humming(Dataset((cell, other), (both,)), 0.003)
    size, frequency = (float(one) for one in re.findall(r" ([\d.]+) (?:N|Hz)", doubt))
    assert doubt.startswith("load_cell.3")
    assert size == pytest.approx(120.0, rel=0.02) and frequency == pytest.approx(11.0, abs=0.1)
    assert not humming(Dataset((cell,), (run,)), 0.003)


def with_force(data, added):
    """Data whose force has ``added(time, number of the run)`` in it."""
    runs = []
    for number, run in enumerate(data.runs):
        outputs = run.outputs.copy()
        outputs[:, 1] += added(run.experiment.time, number)
        runs.append(replace(run, outputs=outputs))
    return replace(data, runs=tuple(runs))


def sine(time, number):
    return 3.0 * np.sin(2.0 * np.pi * 3.1 * time + number)


def walk(time, number):
    steps = np.cumsum(np.random.default_rng(100 + number).standard_normal(len(time)))
    return 4.5 * (steps - steps.mean()) / steps.std()


@pytest.mark.parametrize("added", [sine, walk])
def test_an_error_above_the_noise_is_never_no_effect(laboratory, added):
    lab = laboratory(samples=700)
    data = lab.measure(5)
    assert diagnose(data, lab.simulator, Config(workers=1)).verdict is Verdict.NO_EFFECT
    finding = diagnose(with_force(data, added), lab.simulator, Config(workers=1))
    assert finding.verdict is Verdict.UNRESOLVED
    assert any("error of force" in one for one in finding.remains)


class Resting(Laboratory):
    """Every run begins with four seconds at rest."""

    def experiments(self):
        """Return the experiments with no drive at first."""
        return [
            replace(one, inputs={"drive": np.where(one.time < 4.0, 0.0, one.inputs["drive"])})
            for one in super().experiments()
        ]


def test_a_hum_at_rest_makes_no_effect_doubtful():
    """The rests that hum say that the noise is as large as the hum."""
    lab = Resting(samples=1500)
    data = lab.measure(5)
    still = np.arange(1500) < 400
    quiet = tuple(replace(run, rest=still) for run in data.runs)
    assert diagnose(replace(data, runs=quiet), lab.simulator, Config(workers=1)).verdict is Verdict.NO_EFFECT

    def hum(time, _):
        return 6.0 * np.sin(2.0 * np.pi * 11.0 * time)

    finding = diagnose(with_force(replace(data, runs=quiet), hum), lab.simulator, Config(workers=1))
    assert finding.verdict in {Verdict.DOUBTFUL, Verdict.UNRESOLVED}
    (doubt,) = (one for one in finding.doubts if one.startswith("force shows a sine"))
    assert float(re.search(r" ([\d.]+) N", doubt)[1]) == pytest.approx(6.0, rel=0.02)


@pytest.mark.parametrize("samples", [80, 81, 95, 110, 400])
def test_a_short_series_is_compared_too(samples):
    """A test run may leave fewer ordinates than the background of a line has elsewhere."""
    assert found(np.zeros(samples)) == []
    values = series(1, "walk", 6.0)[:samples]
    walk = found(6.0 * (values - values.mean()) / values.std())
    assert [one.ratio for one in walk] == pytest.approx([6.0])
    sine = np.sin(0.31 * np.arange(samples)) + 1e-3 * np.random.default_rng(2).standard_normal(samples)
    assert strongest_line(sine, 0.01).frequency == pytest.approx(4.93, abs=1.0 / (0.01 * samples))
