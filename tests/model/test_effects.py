"""What every effect of the catalogue owes: absent at zero, smooth from there, and no gas or energy out of nothing."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module

import numpy as np
import pytest

from bench_protocol.units import WRITTEN_UNITS, mm
from bench_sim.model import effects
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.effect import FAMILIES, Effect, ShownBy
from bench_sim.model.experiments import LATERAL, ROLL, VERTICAL, Shape, impose_motion
from bench_sim.model.layout import SENSORS, SIDES, STATES, Input, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.model.quantities import PARAMETERS
from bench_sim.parameters import load

#: Readings without noise and converters: both would hide small effects.
BASE = load("astb").with_values(sensor_noise=np.zeros(SENSORS), sensor_resolution=np.zeros(SENSORS))
ADIABATIC = BASE.with_values(bellows_heat_transfer=0, auxiliary_heat_transfer=0)


def every(asked: Callable[[Effect], bool]) -> pytest.MarkDecorator:
    """The same test of every effect that declares this of itself."""
    chosen = [effect for effect in CATALOGUE.values() if asked(effect)]
    return pytest.mark.parametrize("effect", chosen, ids=[effect.name for effect in chosen])


ALL = every(lambda effect: True)
SMOOTH = every(lambda effect: effect.smooth and effect.shown_by is not ShownBy.COMMANDS)
OF_THE_PLANT = every(lambda effect: effect.family in ("rubber", "gas", "flow", "rig"))


def values_at(effect: Effect, amplitude: float) -> dict[str, float]:
    return {effect.amplitude.name: amplitude} | {shape.name: shape.typical for shape in effect.shapes}


def changed(base, effect: Effect, amplitude: float):
    """A copy of the record in which the effect sits, on the left where it can choose."""
    record = np.array([base.record], PARAMETERS).view(np.recarray)[0]
    effect.change(record, 0 if effect.places else None, values_at(effect, amplitude))
    return record


@dataclass
class Replay:
    readings: np.ndarray  # (samples, SENSORS)
    states: np.ndarray  # (steps, STATES), at the start of each step
    algebraic: np.ndarray  # (steps, ALGEBRAICS)


def replay(record, shown_by: ShownBy = ShownBy.MOTION, *, dt=1e-3, duration=0.6, interval=10e-3) -> Replay:
    """Move the bolster by hand in all directions, the platform by its command; sample the sensors every 10 ms."""
    plant = Plant.at_rest(record, dt=dt)
    offset = 0.0
    connected = shown_by is ShownBy.CONNECTED_VALVES
    for valve in (Input.LEFT_LEVELING, Input.RIGHT_LEVELING):
        plant.inputs[valve] = float(connected)
    if connected:
        # The leveling valves stand open and stay so; left and right differ too little for the other one to open.
        offset = 14 * mm
        plant.state[State.LEVER : State.LEVER + SIDES] = 11 * mm
        plant.memory.leveling_latch[:] = 1
        plant.state[[State.AUXILIARY_MASS + 1, State.AUXILIARY_ENERGY + 1]] *= 1.1
    else:
        plant.inputs[Input.DPV_CONNECTED] = 0.0
    motion = np.zeros((3, 5))
    motion[LATERAL] = Shape.SINE, 0.0, 16 * mm, 1.3, 0.0
    motion[VERTICAL] = Shape.SINE, offset, 6 * mm, 2.1, 0.0
    motion[ROLL] = Shape.SINE, 0.0, 4e-3, 1.7, 0.0
    per = round(interval / dt)
    count = round(duration / interval)
    found = Replay(
        np.empty((count, SENSORS)), np.empty((count * per, STATES)), np.empty((count * per, ALGEBRAICS))
    )
    for k in range(count):
        plant.inputs[Input.PLATFORM_VERTICAL] = 0.3 * mm * np.sin(0.4 * k)
        plant.inputs[Input.PLATFORM_LATERAL] = 0.2 * mm * np.sin(0.3 * k)
        part = slice(k * per, (k + 1) * per)
        shared = plant.state, plant.memory_array, plant.inputs, plant.parameter_array
        impose_motion(*shared, dt, per, motion, 1, found.states[part], found.algebraic[part])
        found.readings[k] = plant.measure()
    return found


#: Of a reading that an effect moves: what the sensors resolve.
SCALE = np.maximum(load("astb").record.sensor_noise, load("astb").record.sensor_resolution)
SCALE = np.where(SCALE > 0.0, SCALE, 1e-5)


def footprint(effect: Effect, amplitude: float, **options) -> np.ndarray:
    """(y(a) − y(0))/a in what the sensors resolve."""
    with_, without = (
        replay(changed(BASE, effect, a), effect.shown_by, **options).readings for a in (amplitude, 0.0)
    )
    return (with_ - without) / SCALE / amplitude


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


def test_each_family_has_its_file_and_no_name_twice():
    found = [one for family in FAMILIES for one in import_module(f"{effects.__name__}.{family}").EFFECTS]
    assert [one.name for one in found] == list(CATALOGUE)
    assert all(one.family in FAMILIES for one in found)


@ALL
def test_an_effect_is_well_formed(effect):
    assert effect.family in FAMILIES
    assert effect.amplitude.nominal == 0.0
    assert effect.amplitude.low <= 0.0 < effect.amplitude.high
    assert effect.equation and effect.source and effect.separated_by
    assert {*effect.confusers, *effect.richer} <= set(CATALOGUE) - {effect.name}
    for one in effect.parameters:
        assert WRITTEN_UNITS[one.display][:2] == (one.unit, pytest.approx(one.scale))
        assert one.low <= one.nominal <= one.high
        assert one.low <= one.typical <= one.high
        assert not one.logarithmic or one.low > 0.0
    for point in effect.grid:
        assert len(point) == len(effect.shapes)
        for value, shape in zip(point, effect.shapes, strict=True):
            assert shape.low <= value <= shape.high


@ALL
def test_at_amplitude_zero_the_record_is_that_of_the_base(effect):
    """And so is all that follows from it, to the last bit."""
    for place in range(len(effect.places)) if effect.places else [None]:
        record = np.array([BASE.record], PARAMETERS).view(np.recarray)[0]
        effect.change(record, place, values_at(effect, 0.0))
        assert record.tobytes() == BASE.record.tobytes()
        effect.change(record, place, values_at(effect, effect.amplitude.typical))
        assert record.tobytes() != BASE.record.tobytes()


@SMOOTH
def test_an_effect_is_continuously_differentiable_at_zero(effect):
    typical = effect.amplitude.typical
    slopes = [footprint(effect, typical * share) for share in (1e-2, 1e-3, 1e-4)]
    assert np.linalg.norm(slopes[-1] * typical) > 0.01, "it moves some reading, if only slowly"
    assert apart(slopes[1], slopes[2]) < 1e-2
    assert apart(slopes[0], slopes[2]) < 5e-2
    if effect.amplitude.low < 0.0:
        assert apart(footprint(effect, -typical * 1e-3), slopes[1]) < 1e-2


@SMOOTH
def test_half_a_step_changes_little_of_what_an_effect_does(effect):
    typical = effect.amplitude.typical
    coarse, fine = (footprint(effect, typical, dt=dt) for dt in (1e-3, 0.5e-3))
    assert apart(coarse, fine) < 0.012


def total(found: Replay, states: State) -> np.ndarray:
    return found.states[:, states : states + SIDES]


@OF_THE_PLANT
def test_no_air_comes_or_goes(effect):
    """In a sealed bench; where an effect loses air, it is less from step to step, and only where the effect sits."""
    found = replay(changed(BASE, effect, effect.amplitude.typical))
    mass = total(found, State.BELLOWS_MASS) + total(found, State.AUXILIARY_MASS)
    drift = np.abs(mass / mass[0] - 1.0).max(axis=0)
    losing = [] if not effect.loses_air else [0] if effect.places else [0, 1]
    assert np.all(mass[-1, losing] < mass[0, losing])
    assert np.all(np.diff(mass[:, losing], axis=0) < 0.0)
    assert np.delete(drift, losing).max(initial=0.0) < 1e-12


@every(lambda effect: effect.family in ("rubber", "gas", "flow", "rig") and not effect.loses_air)
def test_without_heat_the_gas_keeps_what_work_is_done_on_it(effect):
    found = replay(changed(ADIABATIC, effect, effect.amplitude.typical), dt=0.25e-3, duration=0.3)
    energy = total(found, State.BELLOWS_ENERGY) + total(found, State.AUXILIARY_ENERGY)
    p = found.algebraic[:, Algebraic.PRESSURE : Algebraic.PRESSURE + SIDES]
    V = found.algebraic[:, Algebraic.VOLUME : Algebraic.VOLUME + SIDES]
    work = np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(V, axis=0), axis=0)
    assert np.ptp(work, axis=0).min() > 100.0
    missing = energy[1:] - energy[0] + work
    assert np.abs(missing).max() < 2e-6 * np.ptp(work)


@every(lambda effect: effect.shown_by is ShownBy.COMMANDS)
def test_effects_of_the_commands_do_not_change_a_replay(effect):
    one, other = (replay(changed(BASE, effect, a)).readings for a in (0.0, effect.amplitude.typical))
    moved = np.ptp(one - other, axis=0) > 0.0
    assert not moved[: Sensor.VERTICAL_LEFT_FORCE].any()
    assert not effect.diagnosable


def test_air_leaks_through_a_differential_pressure_valve_from_the_fuller_side():
    effect = CATALOGUE["dpv_leak"]
    found = replay(changed(BASE, effect, effect.amplitude.typical), effect.shown_by)
    assert np.all(found.algebraic[:, Algebraic.DPV_FLOW] < 0.0)
    assert np.all(found.algebraic[:, Algebraic.LEVELING_FLOW] < 0.0), "the leveling valves let some out"
