"""Effects that begin while the bench moves: its air stays, and so do the readings of unaffected sensors."""

import numpy as np
import pytest

from bench_sim.model.effects import CATALOGUE
from bench_sim.parameters import load
from diagnosis.contracts import Experiment, Job
from diagnosis.systems.air_spring.gas import BEFORE
from diagnosis.systems.air_spring.simulator import AirSpring

STEP = 5e-3
TIME = STEP * np.arange(400)
PRESSURE = 4.0e5


@pytest.fixture(scope="module")
def simulator():
    return AirSpring(load("astb"), effects=CATALOGUE)


def readings(simulator, effects, **settings):
    """What a bench reads (n,) by channel that goes to and fro while its ``effects`` begin."""
    up = 4e-3 * np.sin(2.0 * np.pi * 1.0 * TIME)
    experiment = Experiment(
        name="to and fro",
        time=TIME,
        inputs={"left.height": up, "right.height": up},
        settings={"left.bellows_pressure": PRESSURE, "right.bellows_pressure": PRESSURE, **settings},
    )
    read = next(simulator.run_many([Job(experiment, {}, effects)]))
    return {channel.name: read[:, k] for k, channel in enumerate(simulator.channels)}


@pytest.fixture(scope="module")
def sound(simulator):
    return readings(simulator, {})


def test_a_wrong_zero_affects_only_its_own_reading(simulator, sound):
    off = readings(simulator, {"pressure_offset.left": {"offset": 2e4}}, **{BEFORE: 1.0})
    for name, read in sound.items():
        shifted = 2e4 if name == "left.bellows_pressure" else 0.0
        np.testing.assert_allclose(off[name] - read, shifted, atol=0.01, err_msg=name)


def test_a_gain_error_affects_only_its_own_channel(simulator, sound):
    gained = readings(simulator, {"pressure_gain": {"gain": 0.02}}, **{BEFORE: 1.0})
    for name, read in sound.items():
        share = 0.02 if name.endswith("_pressure") else 0.0
        np.testing.assert_allclose(gained[name], (1.0 + share) * read, rtol=1e-6, err_msg=name)


def test_zeros_that_were_wrong_before_are_taken_from_what_was_read(simulator, sound):
    off = readings(simulator, {"pressure_offset.left": {"offset": 2e4}})
    assert off["left.bellows_pressure"][0] == pytest.approx(PRESSURE)
    assert off["load_cell.1"][0] < sound["load_cell.1"][0] - 1e3


def content(par, gauge, *, larger=0.0, widens=0.0, softer=0.0):
    """Return p V (J) of the left bellows at its design height, whose plate gives way under the load."""
    load, p = float(par.nominal_preload[0]), gauge + float(par.atmospheric_pressure)
    area, slope = float(par.effective_area[0]), float(par.effective_area_slope[0])
    down = (1.0 + softer) * (gauge * area - load) / float(par.emergency_stiffness_vertical[0])
    volume = (1.0 + larger) * float(par.bellows_volume[0]) + area * down + 0.5 * slope * down**2
    return p * (volume + widens * (gauge - load / area))


def test_a_chamber_that_shrinks_keeps_its_air(simulator):
    atmosphere = float(simulator.parameters.record.atmospheric_pressure)
    shrunk = readings(simulator, {"auxiliary_volume": {"change": -0.2}}, **{BEFORE: 1.0})
    p = float(shrunk["left.auxiliary_pressure"][0]) + atmosphere
    assert 0.8 * p == pytest.approx(PRESSURE + atmosphere, rel=1e-3)


@pytest.mark.parametrize(
    ("effect", "values", "changed"),
    [
        ("bellows_volume", {"change": -0.2}, {"larger": -0.2}),
        ("compliance", {"compliance": 1e-8}, {"widens": 1e-8}),
        ("emergency_compliance", {"error": 1.0}, {"softer": 1.0}),
    ],
)
def test_a_bellows_that_becomes_another_one_keeps_its_air(simulator, effect, values, changed):
    par = simulator.parameters.record
    other = readings(simulator, {effect: values}, **{BEFORE: 1.0})
    gauge = float(other["left.bellows_pressure"][0])
    assert abs(gauge - PRESSURE) > 1e4
    assert content(par, gauge, **changed) == pytest.approx(content(par, PRESSURE), rel=1e-3)
