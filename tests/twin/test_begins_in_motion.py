"""What begins while the bench moves: its air stays, and so does what sensors read that are not concerned."""

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


def test_a_zero_that_goes_wrong_moves_nothing_but_its_own_reading(simulator, sound):
    off = readings(simulator, {"pressure_offset.left": {"offset": 2e4}}, **{BEFORE: 1.0})
    for name, read in sound.items():
        shifted = 2e4 if name == "left.bellows_pressure" else 0.0
        np.testing.assert_allclose(off[name] - read, shifted, atol=0.01, err_msg=name)


def test_a_gain_that_goes_wrong_moves_nothing_but_what_has_it(simulator, sound):
    gained = readings(simulator, {"pressure_gain": {"gain": 0.02}}, **{BEFORE: 1.0})
    for name, read in sound.items():
        share = 0.02 if name.endswith("_pressure") else 0.0
        np.testing.assert_allclose(gained[name], (1.0 + share) * read, rtol=1e-6, err_msg=name)


def test_zeros_that_were_wrong_before_are_taken_from_what_was_read(simulator, sound):
    off = readings(simulator, {"pressure_offset.left": {"offset": 2e4}})
    assert off["left.bellows_pressure"][0] == pytest.approx(PRESSURE)
    assert off["load_cell.1"][0] < sound["load_cell.1"][0] - 1e3


@pytest.mark.parametrize(
    ("effect", "chamber", "volumes"),
    [
        (
            "auxiliary_volume",
            "auxiliary",
            lambda par: (par.auxiliary_volume[0], 0.8 * par.auxiliary_volume[0]),
        ),
        ("bellows_volume", "bellows", lambda par: (par.bellows_volume[0], 0.8 * par.bellows_volume[0])),
    ],
)
def test_a_volume_that_shrinks_keeps_its_air(simulator, effect, chamber, volumes):
    par = simulator.parameters.record
    shrunk = readings(simulator, {effect: {"change": -0.2}}, **{BEFORE: 1.0})
    before, after = volumes(par)
    atmosphere = float(par.atmospheric_pressure)
    read = float(shrunk[f"left.{chamber}_pressure"][0]) + atmosphere
    assert read * after == pytest.approx((PRESSURE + atmosphere) * before, rel=1e-3)


def test_a_bellows_that_begins_to_widen_keeps_its_air(simulator):
    par = simulator.parameters.record
    compliance = 1e-8
    wide = readings(simulator, {"compliance": {"compliance": compliance}}, **{BEFORE: 1.0})
    atmosphere, V = float(par.atmospheric_pressure), float(par.bellows_volume[0])
    reference = float(par.nominal_preload[0] / par.effective_area[0]) + atmosphere
    p = float(wide["left.bellows_pressure"][0]) + atmosphere
    assert p * (V + compliance * (p - reference)) == pytest.approx((PRESSURE + atmosphere) * V, rel=1e-3)
