"""The page's inputs from an identification and from the bench's records, in addition to the plans' curves."""

from types import SimpleNamespace

import numpy as np
import pytest

from astb_studies.paper.bench_results import BenchResults, Harmonics, harmonics
from astb_studies.paper.identified import SHAPE, Identified, changes, mean_of_sides
from bench_protocol.units import mm
from bench_sim.model.wiring import sensor_of
from bench_sim.parameters import load
from diagnosis.estimates import Z95
from diagnosis.systems.air_spring.identified import ASKED

RECORD = load("astb").record
GEOMETRY = np.array([float(RECORD[name][0]) for name in SHAPE])
RNG = np.random.default_rng(3)


def test_area_and_volume_change_by_the_law_of_the_plant():
    y = np.array([-60.0, 0.0, 30.0]) * mm
    k_0, k_1 = float(RECORD.membrane_length[0]), float(RECORD.membrane_length_slope[0])
    Y = y**2 / (1.0 + (y / float(RECORD.membrane_travel[0])) ** 2)
    area, volume = changes(GEOMETRY, y)
    np.testing.assert_allclose(area, -0.5 * k_1 * Y / float(RECORD.effective_area[0]), rtol=1e-12)
    np.testing.assert_allclose(volume, -0.5 * k_0 * Y / float(RECORD.bellows_volume[0]), rtol=1e-12)


def test_the_width_of_the_changes_is_that_of_drawn_springs():
    root = 0.01 * GEOMETRY[:, None] * RNG.normal(size=(6, 6))
    y = np.linspace(-60.0, 60.0, 7) * mm
    one = Identified({}, 0.0, GEOMETRY, root @ root.T)
    drawn = GEOMETRY + RNG.normal(size=(4000, 6)) @ root.T
    spread = np.std([changes(geometry, y) for geometry in drawn], axis=0)
    centre, width = one.changes(y)
    np.testing.assert_array_equal(centre, changes(GEOMETRY, y))
    np.testing.assert_allclose(width, Z95 * spread, rtol=0.1, atol=1e-9)


def identification(per_side, shared):
    """An identification whose parameters have these values; one of a side is known to 1 %, independently."""
    values = {}
    for name, asked in ASKED.items():
        if asked.each:
            values |= {f"left.{name}": per_side[0], f"right.{name}": per_side[1]}
        else:
            values[name] = shared
    values |= {"left.bellows_pressure.offset": 300.0, "right.bellows_pressure.offset": -100.0}

    def joint(names):
        found = np.array([values[name] for name in names])
        return found, np.diag((0.01 * found) ** 2)

    parameters = [SimpleNamespace(parameter=SimpleNamespace(name=name)) for name in values]
    return SimpleNamespace(parameters=parameters, joint=joint)


def test_parameters_of_both_sides_are_averaged():
    found = mean_of_sides(identification((1.0, 3.0), 5.0))
    area, shell = found.parameters["effective_area"], found.parameters["shell_stiffness_lateral"]
    assert area.value == 2.0
    assert area.high - area.value == pytest.approx(Z95 * 0.01 * np.sqrt(1.0 + 9.0) / 2.0)
    assert (shell.value, shell.high - shell.value) == (5.0, pytest.approx(Z95 * 0.05))
    assert found.pressure_zero == 100.0
    np.testing.assert_allclose(found.geometry, [2.0, 2.0, 2.0, 5.0, 5.0, 5.0])
    widths = np.sqrt(np.diagonal(found.covariance))
    np.testing.assert_allclose(widths, [0.01 * np.sqrt(10.0) / 2.0] * 3 + [0.05] * 3)


def test_readings_are_freed_of_their_lag_before_the_gas_is_taken_off():
    area, K, rubber = 0.26, 1e6 + 2e5j, 3e4 + 1.5e4j
    height = 5 * mm
    signals = {
        "height": height,
        "bellows_pressure": (rubber - K) * height / area,
        "load_cell": -0.5 * K * height,  # two under each spring
    }
    starts = {one: 30.0 * k for k, one in enumerate((0.1, 0.2, 0.4, 0.6))}

    def series(name):
        times = np.arange(0.0, 150.0, 0.005)
        kind = next(one for one in signals if one in name)
        values = np.full(times.shape, 2.0)
        for f, start in starts.items():
            lag = float(RECORD.sensor_lag[sensor_of(name)])
            wave = signals[kind] / (1.0 + 2j * np.pi * f * lag)
            inside = (times >= start) & (times < start + 25.0)
            values[inside] += (wave * np.exp(2j * np.pi * f * times[inside])).real
        return times, values

    phases = [
        SimpleNamespace(name=f"vertical sine {f:g} Hz", start=start, end=start + 25.0)
        for f, start in starts.items()
    ]
    found = harmonics(SimpleNamespace(phases=phases, series=series))
    assert [one.frequency for one in found] == [0.4, 0.6]
    bench = BenchResults({}, {}, (np.zeros(2), np.zeros(2)), harmonics=found)
    np.testing.assert_allclose(bench.loss_without_gas(area).y, rubber.imag, rtol=1e-3)


def test_the_loss_without_gas_is_that_of_the_remaining_force():
    one = Harmonics(1.2, 5e-3 + 0j, -5e3 - 800j, -18e3 - 3e3j)
    bench = BenchResults({}, {}, (np.zeros(2), np.zeros(2)), harmonics=[one])
    expected = ((-18e3 - 3e3j) * 0.25 - (-5e3 - 800j)) / 5e-3
    np.testing.assert_allclose(bench.loss_without_gas(0.25).y, [expected.imag])
