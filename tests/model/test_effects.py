"""What every effect of the catalogue owes: absent at zero, smooth from there, and no gas or energy out of nothing."""

from dataclasses import dataclass

import numpy as np
import pytest

from bench_protocol.units import WRITTEN_UNITS, mm
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.effects.effect import Effect
from bench_sim.model.experiments import LATERAL, ROLL, VERTICAL, Shape, impose_motion
from bench_sim.model.layout import SENSORS, SIDES, STATES, Input, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.model.quantities import PARAMETERS
from bench_sim.parameters import load

#: Readings without noise and converters: both would hide what is small.
BASE = load("astb").with_values(sensor_noise=np.zeros(SENSORS), sensor_resolution=np.zeros(SENSORS))
ADIABATIC = BASE.with_values(bellows_heat_transfer=0, auxiliary_heat_transfer=0)
FAMILIES = ("rubber", "gas", "flow", "sensor", "acquisition", "rig")

#: Effects that show only while valves are connected; the others are looked at in a sealed bench.
OF_VALVES = {"leveling_deadband", "leveling_delay", "dpv_leak"}
#: Effects through which air leaves the bench.
LEAKS = {"leak", "leak_laminar"}
#: Readings that jump with the amplitude.
JUMPING = {"quantisation"}
#: No imposed motion shows them.
UNSEEN = {"actuator_tracking"}

ALL = pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE)
SEEN = pytest.mark.parametrize("effect", [e for e in CATALOGUE.values() if e.name not in UNSEEN | JUMPING])
PLANT = pytest.mark.parametrize(
    "effect", [e for e in CATALOGUE.values() if e.family in ("rubber", "gas", "flow", "rig")]
)


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


def replay(record, effect: Effect, *, dt=1e-3, duration=0.6, every=10e-3) -> Replay:
    """Move the bolster by hand in all directions, the platform by its command; sample the sensors every 10 ms."""
    plant = Plant.at_rest(record, dt=dt)
    offset = 0.0
    for valve in (Input.LEFT_LEVELING, Input.RIGHT_LEVELING):
        plant.inputs[valve] = float(effect.name in OF_VALVES)
    if effect.name in OF_VALVES:
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
    per = round(every / dt)
    count = round(duration / every)
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
    with_, without = (replay(changed(BASE, effect, a), effect, **options).readings for a in (amplitude, 0.0))
    return (with_ - without) / SCALE / amplitude


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


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


@SEEN
def test_an_effect_is_continuously_differentiable_at_zero(effect):
    typical = effect.amplitude.typical
    slopes = [footprint(effect, typical * share) for share in (1e-2, 1e-3, 1e-4)]
    assert np.linalg.norm(slopes[-1] * typical) > 0.01, "it moves some reading, if only slowly"
    assert apart(slopes[1], slopes[2]) < 1e-2
    assert apart(slopes[0], slopes[2]) < 5e-2
    if effect.amplitude.low < 0.0:
        assert apart(footprint(effect, -typical * 1e-3), slopes[1]) < 1e-2


@SEEN
def test_half_a_step_changes_little_of_what_an_effect_does(effect):
    typical = effect.amplitude.typical
    coarse, fine = (footprint(effect, typical, dt=dt) for dt in (1e-3, 0.5e-3))
    assert apart(coarse, fine) < 0.012


def total(found: Replay, states: State) -> np.ndarray:
    return found.states[:, states : states + SIDES]


@PLANT
def test_no_air_comes_or_goes(effect):
    record = changed(BASE, effect, effect.amplitude.typical)
    found = replay(record, CATALOGUE["heat"] if effect.name != "dpv_leak" else effect)
    mass = total(found, State.BELLOWS_MASS) + total(found, State.AUXILIARY_MASS)
    if effect.name == "dpv_leak":  # the leveling valves let some out
        left, right = (
            found.algebraic[:, Algebraic.DPV_FLOW + 0],
            found.algebraic[:, Algebraic.LEVELING_FLOW],
        )
        assert np.all(left < 0.0), "from the fuller side to the other"
        assert np.all(right < 0.0)
        return
    drift = np.abs(mass / mass[0] - 1.0).max(axis=0)
    if effect.name in LEAKS:
        assert mass[-1, 0] < mass[0, 0]
        assert np.all(np.diff(mass[:, 0]) < 0.0)
        drift = drift[1:]
    assert drift.max() < 1e-12


@PLANT
def test_without_heat_the_gas_keeps_what_work_is_done_on_it(effect):
    if effect.name in LEAKS | {"dpv_leak"}:
        pytest.skip("air carries energy away")
    found = replay(
        changed(ADIABATIC, effect, effect.amplitude.typical), CATALOGUE["heat"], dt=0.25e-3, duration=0.3
    )
    energy = total(found, State.BELLOWS_ENERGY) + total(found, State.AUXILIARY_ENERGY)
    p = found.algebraic[:, Algebraic.PRESSURE : Algebraic.PRESSURE + SIDES]
    V = found.algebraic[:, Algebraic.VOLUME : Algebraic.VOLUME + SIDES]
    work = np.cumsum(0.5 * (p[1:] + p[:-1]) * np.diff(V, axis=0), axis=0)
    assert np.ptp(work, axis=0).min() > 100.0
    missing = energy[1:] - energy[0] + work
    assert np.abs(missing).max() < 2e-6 * np.ptp(work)


def test_unseen_effects_are_the_ones_that_say_so():
    assert {effect.name for effect in CATALOGUE.values() if not effect.diagnosable} == UNSEEN | JUMPING
    unseen = CATALOGUE["actuator_tracking"]
    one, other = (replay(changed(BASE, unseen, a), unseen).readings for a in (0.0, 0.3))
    moved = np.ptp(one - other, axis=0) > 0.0
    assert not moved[: Sensor.VERTICAL_LEFT_FORCE].any()
