"""The motion from its sensors: noise goes, the motion stays, and geometry gives back what the bench did."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_sim.model.layout import LATERAL, Input, Mode, Sensor
from bench_sim.model.plant import Plant
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects
from diagnosis.contracts import DiagnosisError
from diagnosis.systems.motion import (
    SENSORS,
    abrupt,
    binned,
    in_step,
    motion_inputs,
    sensor_noise,
    smooth,
    sudden,
    with_lag,
    without_lag,
)
from tests.refusals import refuses

STEP = 5e-3
NOISE = 10e-6


def course(n=4000):
    """Rest, a slow triangle, a sine of 1.2 Hz, one of 8 Hz, a step within 0.2 s, rest: (n,) m, and where each is."""
    t = STEP * np.arange(n)
    x = np.zeros(n)
    parts = {
        "rest": (0.0, 3.0),
        "triangle": (3.0, 8.0),
        "slow sine": (8.5, 12.0),
        "fast sine": (12.5, 15.0),
        "hold": (17.0, 20.0),
    }
    where = {name: (t >= a) & (t < b) for name, (a, b) in parts.items()}
    phase = (t - 3.0) * 0.4
    x[where["triangle"]] = (5e-3 * (1.0 - 4.0 * np.abs((phase + 0.75) % 1.0 - 0.5)))[where["triangle"]]
    x[where["slow sine"]] = (5e-3 * np.sin(2 * np.pi * 1.2 * (t - 8.5)))[where["slow sine"]]
    x[where["fast sine"]] = (5e-4 * np.sin(2 * np.pi * 8.0 * (t - 12.5)))[where["fast sine"]]
    late = np.clip((t - 16.0) / 0.2, 0.0, 1.0)
    x += 4e-3 * late * late * (3.0 - 2.0 * late)
    return x, where


def test_noise_goes_and_the_motion_stays():
    motion, where = course()
    measured = motion + NOISE * np.random.default_rng(1).standard_normal(len(motion))
    error = smooth(measured, NOISE) - motion
    # Of white noise, the part of the band that the motion needs is left.
    for name, limit in (("rest", 2.5e-6), ("slow sine", 5e-6), ("fast sine", 7e-6), ("hold", 2.5e-6)):
        inside = where[name].copy()
        inside &= np.roll(inside, 40) & np.roll(inside, -40)
        assert np.std(error[inside]) < limit, name
    # At its corners a triangle is rounded by a few micrometres, not by the width of a filter.
    assert np.abs(error[where["triangle"]]).max() < 5 * NOISE


@pytest.mark.parametrize(("frequency", "size"), [(8.0, 5e-4), (12.5, 5e-4), (12.5, 3e-4)])
def test_waves_are_not_weakened(frequency, size):
    """Force transducers that lag by 0.5 ms weaken 12.5 Hz by 0.08 %, as much as smoothing once does."""
    time = STEP * np.arange(4000)
    wave = size * np.sin(2 * np.pi * frequency * time) * np.clip(np.minimum(time, 20.0 - time), 0.0, 1.0)
    noise = NOISE * np.random.default_rng(5).standard_normal((16, len(time)))
    # What passes of the noise is gone in the mean.
    mean = np.mean([0.5 * (smooth(wave + one, NOISE) + smooth(wave - one, NOISE)) for one in noise], axis=0)
    assert abs(wave @ mean / (wave @ wave) - 1.0) < 2e-4


@given(
    coefficients=st.lists(st.floats(-1e-3, 1e-3), min_size=3, max_size=3),
    missing=st.sets(st.integers(1, 198), max_size=60),
)
@settings(max_examples=30, deadline=None)
def test_a_parabola_comes_back_exactly_through_gaps(coefficients, missing):
    """Its third difference is zero: no penalty, whatever is missing."""
    s = np.linspace(-1.0, 1.0, 200)
    x = coefficients[0] + coefficients[1] * s + coefficients[2] * s * s
    measured = x.copy()
    measured[list(missing)] = np.nan
    tolerance = 1e-8 if np.ptp(x) >= NOISE else NOISE
    assert np.abs(smooth(measured, NOISE) - x).max() < tolerance


def test_what_only_trembles_stands_still():
    measured = 1e-3 + 3e-6 * np.random.default_rng(2).standard_normal(1000)
    assert np.ptp(smooth(measured, 5e-6)) == 0.0


def test_too_few_samples_are_refused():
    with refuses(DiagnosisError, "least 8"):
        smooth(np.array([0.0, *[np.nan] * 20, 1.0]), NOISE)


def test_the_lag_of_a_sensor_is_taken_back():
    """y = |H| sin(ωt − φ) with H = 1/(1 + iωτ) was sin ωt."""
    time = STEP * np.arange(2000)
    omega, lag = 2 * np.pi * 3.0, 2e-3
    H = 1.0 / (1.0 + 1j * omega * lag)
    read = abs(H) * np.sin(omega * time + np.angle(H))
    assert np.abs(without_lag(read, lag, STEP) - np.sin(omega * time))[10:-10].max() < 1e-5


@pytest.mark.parametrize("lag", [1e-4, 6e-4, 5e-3, 0.3, 20.0])
def test_a_first_order_lag_is_inverted(lag):
    """Against H = 1/(1 + iωτ) where the start is forgotten, and against its own inverse everywhere."""
    time = STEP * np.arange(4000)
    omega = 2 * np.pi * 3.0
    followed = with_lag(np.sin(omega * time), lag, STEP)
    H = 1.0 / (1.0 + 1j * omega * lag)
    steady = abs(H) * np.sin(omega * time + np.angle(H))
    fading = (followed[0] - steady[0]) * np.exp(-time / lag)
    assert np.abs(followed - steady - fading)[:-10].max() < 2e-5
    assert followed[0] == 0.0


def test_zero_lag_keeps_the_values():
    values = np.random.default_rng(3).standard_normal(50)
    assert with_lag(values, 0.0, STEP) is values


def rolled(frequency, size, seed, lost=0.0):
    """A wave of 2 mm sideways, 20 s, and one of ``size`` in a height that leads it by 30 degrees, with its noise."""
    time = STEP * np.arange(4000)
    fade = np.clip(np.minimum(time, 20.0 - time), 0.0, 1.0)
    sideways = 2e-3 * fade * np.sin(2 * np.pi * frequency * time)
    height = size * fade * np.sin(2 * np.pi * frequency * time + np.pi / 6)
    rng = np.random.default_rng(seed)
    measured = height + NOISE * rng.standard_normal(len(time))
    measured[rng.random(len(time)) < lost] = np.nan
    return sideways, height, measured


@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_a_wave_that_noise_hides_is_found_in_step_with_a_larger_one(lost):
    """At 20 µm and 12.5 Hz, smoothing leaves nearly zero; a larger motion shows when to look for it."""
    sideways, height, measured = rolled(12.5, 20e-6, 1, lost)
    alone = smooth(measured, NOISE)
    found = alone + in_step(measured - alone, sideways, STEP, NOISE)
    inside = slice(200, -200)
    wave = height[inside] / (height[inside] @ height[inside])
    assert alone[inside] @ wave < 0.05
    assert abs(found[inside] @ wave - 1.0) < 0.03
    assert np.std((found - height)[inside]) < 0.2 * np.std(height[inside])


def test_random_signals_are_not_synchronous():
    found = []
    for seed in range(20):
        sideways, _, measured = rolled(8.0, 0.0, seed)
        found.append(in_step(measured, sideways, STEP, NOISE))
    assert np.mean(np.array(found) != 0.0) < 0.02
    assert np.abs(found).max() < 0.3 * NOISE


@pytest.mark.parametrize(("samples", "scatter"), [(20, 1.0), (50, 1.0), (4000, 1.0), (4000, 3.0)])
def test_short_runs_ends_and_a_data_sheet_that_is_too_good_invent_no_motion(samples, scatter):
    """Beyond the ends the values are zero: mirrored, noise would count twice there."""
    time = STEP * np.arange(samples)
    sideways = 2e-3 * np.sin(2 * np.pi * 8.0 * time)
    found = []
    for seed in range(40):
        measured = scatter * NOISE * np.random.default_rng(seed).standard_normal(samples)
        found.append(in_step(measured, sideways, STEP, NOISE) != 0.0)
    assert np.mean(found) < 0.05
    ends = np.array(found)[:, [*range(10), *range(-10, 0)]]
    assert np.mean(ends) < 0.05


def test_no_signal_is_synchronous_with_a_constant():
    _, _, measured = rolled(8.0, 0.0, 1)
    for still in (np.zeros(4000), np.full(4000, 1e-3)):
        assert not in_step(measured, still, STEP, NOISE).any()


def test_sudden_marks_what_cubics_between_samples_miss():
    """At 12.5 Hz they are off by 3/128 (ωh)⁴ = 0.056 % of the acceleration: by 10 mm/s² of 18 m/s²."""
    time = STEP * np.arange(2000)
    wave = np.sin(2 * np.pi * 12.5 * time)
    half = np.sin(2 * np.pi * 12.5 * (time[1:-2] + 0.5 * STEP))
    cubic = (9.0 * (wave[1:-2] + wave[2:-1]) - wave[:-3] - wave[3:]) / 16.0
    off = np.abs(cubic - half).max()
    assert not sudden(0.9 * wave, off).any()
    assert sudden(1.2 * wave, off).all()
    corner = np.where(time < 5.0, 0.0, 1.0)
    marked = np.flatnonzero(sudden(corner, 0.01))
    assert 0 < len(marked) < 30
    assert np.abs(time[marked] - 5.0).max() < 0.06


def test_abrupt_marks_only_corners():
    time = STEP * np.arange(1000)
    corner = 0.04 * np.clip(time - 2.5, 0.0, None)
    found = np.flatnonzero(abrupt(corner, NOISE))
    assert 0.0 < len(found) < 30
    assert np.abs(time[found] - 2.5).max() < 0.06
    assert not abrupt(5e-3 * np.sin(2 * np.pi * 1.2 * time), NOISE).any()
    assert abrupt(1e-3 * np.sin(2 * np.pi * 8.0 * time), NOISE).all()


def swung(parameters, seconds, swing, platform=lambda t: (0.0, 0.0)):
    """Readings by name, heights and shear that there were, of a bench whose actuators and platform swing.

    ``swing`` gives the motion of the pistons from their position, ``platform`` its roll and where it goes sideways. The
    first quarter is left out.
    """
    plant = Plant.at_rest(parameters.record)
    plant.inputs[Input.VERTICAL_LEFT_MODE : Input.LATERAL_MODE + 1] = Mode.DISPLACEMENT
    stand = plant.ideal()[Sensor.VERTICAL_LEFT_DISPLACEMENT : Sensor.LATERAL_DISPLACEMENT + 1]
    rows, readings = [], []
    for k in range(1000 * seconds):
        t = 1e-3 * k
        if k >= 250 * seconds and k % 5 == 0:
            readings.append(plant.measure())
            truth = plant.truth()
            rows.append((truth["height[0]"], truth["lateral[0]"]))
        plant.inputs[Input.VERTICAL_LEFT_COMMAND : Input.LATERAL_COMMAND + 1] = stand + np.array(swing(t))
        plant.inputs[Input.PLATFORM_ROLL], plant.inputs[Input.PLATFORM_LATERAL] = platform(t)
        plant.step()
    read = np.array(readings)
    measured = {name: read[:, sensor_of(name)] for name in SENSORS}
    return measured | {"lateral.force": read[:, Sensor.LATERAL_FORCE]}, np.array(rows)


def swung_every_way(parameters):
    return swung(
        parameters,
        8,
        lambda t: (3e-3 * np.sin(4.0 * t), -2e-3 * np.sin(4.0 * t), 4e-3 * np.sin(3.0 * t)),
        lambda t: (3e-3 * np.sin(2.0 * t), 1e-3 * np.sin(2.5 * t)),
    )


#: A run begins and ends at rest, and what swings does not.
INNER = slice(100, -100)


def test_the_springs_were_where_the_sensors_say():
    """Heights and shear come back within half a step of the wire, though the platform rolls and the frame gives way."""
    measured, was = swung_every_way(load("astb").with_values(sensor_noise=0.0, sensor_resolution=0.0))
    inputs = motion_inputs(measured, STEP, load("astb"))
    assert np.abs(inputs["left.height"] - was[:, 0])[INNER].max() < 5e-6
    assert np.abs(inputs["shear"] - was[:, 1])[INNER].max() < 5e-6
    # Without the give of the frame the shear would be off by F/k: the force matters.
    stiff = motion_inputs({name: measured[name] for name in SENSORS}, STEP, load("astb"))
    assert np.abs(stiff["shear"] - was[:, 1])[INNER].max() > 1e-5
    assert "lateral.give" not in stiff


def test_a_free_bolster_keeps_swings_below_the_noise():
    """Of 8 µm at 3.6 Hz, the third harmonic of a track, less than 10 % is lost; without ``free`` a quarter is."""
    t = STEP * np.arange(2000)
    swing = np.exp(-2j * np.pi * 3.6 * t)
    height = 0.5e-3 * np.sin(2.0 * np.pi * 1.2 * t) + 8e-6 * np.cos(2.0 * np.pi * 3.6 * t)

    def lost(free: bool) -> float:
        noise = NOISE * np.random.default_rng(1).standard_normal((2, len(t)))
        measured = {
            f"{side}.height": height + one for side, one in zip(("left", "right"), noise, strict=True)
        }
        inputs = motion_inputs(measured, STEP, load("astb"), free=free)
        found = 0.5 * (inputs["left.height"] + inputs["right.height"])
        return float(2.0 * np.abs(np.mean(((found - height) * swing)[INNER])))

    assert lost(free=True) < 0.8e-6
    assert lost(free=False) > 2e-6


def test_if_the_frame_gives_way_more_the_springs_were_sheared_by_that_less():
    bench = load("astb").with_values(sensor_noise=0.0, sensor_resolution=0.0)
    measured, was = swung_every_way(with_effects(bench, {"frame_compliance": {"compliance": 1e-8}}))
    inputs = motion_inputs(measured, STEP, load("astb"))
    assert np.abs(inputs["shear"] - was[:, 1])[INNER].max() > 1e-5
    more = 1e-8 * bench.record.frame_stiffness[LATERAL]
    assert np.abs(inputs["shear"] - more * inputs["lateral.give"] - was[:, 1])[INNER].max() < 5e-6


def test_the_frame_gives_way_behind_its_damper():
    """At 12.5 Hz a force of 14 kN is ahead of the give by 5 % of it, which is 20 µm."""
    parameters = load("astb").with_values(sensor_noise=0.0, sensor_resolution=0.0)
    measured, was = swung(
        parameters, 4, lambda t: (0.0, 0.0, 2e-3 * min(t, 1.0) * np.sin(2 * np.pi * 12.5 * t))
    )
    assert np.ptp(measured["lateral.force"]) > 28e3

    def off(**values):
        bench = parameters.with_values(**values)
        return np.abs(motion_inputs(measured, STEP, bench)["shear"] - was[:, 1])[INNER].max()

    assert off() < 1e-6
    # With the noise of its data sheet a laser does not see the bolster roll; what rolls in step is found all the same.
    assert np.abs(motion_inputs(measured, STEP, load("astb"))["shear"] - was[:, 1])[INNER].max() < 1e-6
    assert off(frame_damping=0.0) > 15e-6


def test_the_noise_of_a_sample_includes_its_roundings():
    record = load("astb").record
    laser = sensor_noise("left.height", record)
    assert laser == pytest.approx(np.sqrt(10e-6**2 + (5e-6**2 + 10e-6**2) / 12.0))


@given(
    times=st.lists(st.floats(-2.0, 12.0), max_size=60),
    edges=st.lists(st.floats(0.0, 10.0), min_size=2, max_size=20, unique=True),
    seed=st.integers(0, 99),
)
def test_samples_are_binned_as_a_histogram_does(times, edges, seed):
    stamps, edges = np.sort(times), np.sort(edges)
    stamps = stamps[stamps != edges[-1]]  # a histogram has it in its last bin, a stretch in the next one
    values = np.random.default_rng(seed).standard_normal(len(stamps))
    count, total = binned(stamps, values, edges)
    np.testing.assert_array_equal(count, np.histogram(stamps, edges)[0])
    np.testing.assert_allclose(total, np.histogram(stamps, edges, weights=values)[0], atol=1e-12)
