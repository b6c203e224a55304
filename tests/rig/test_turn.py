"""A running bench has other parameters from an instant on: its state stays, and new effects begin softly."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench_protocol.units import mm
from bench_sim.model.effects import CATALOGUE
from bench_sim.model.layout import STATES, Input, Mode, Sensor, State
from bench_sim.model.plant import Plant
from bench_sim.parameters import ParameterError, load
from bench_sim.parameters.effects import with_effects
from bench_sim.rig.faults.insertion import ParameterFaults
from bench_sim.rig.turn import VOLUMES, differing, take

SOUND = load("astb").with_values(sensor_noise=0.0, sensor_resolution=0.0)
PLACED = [
    f"{name}.{place}" if place else name
    for name, effect in CATALOGUE.items()
    for place in effect.places or ("",)
]
RELAXES = ("maxwell", "maxwell_two", "fractional", "creep")


def moved(steps: int, parameters=SOUND) -> Plant:
    """A bench that has been moved up and down for so many steps."""
    plant = Plant.at_rest(parameters.record, seed=3)
    for actuator in (0, 1):
        plant.inputs[Input.VERTICAL_LEFT_MODE + actuator] = Mode.DISPLACEMENT
    for step in range(steps):
        plant.inputs[Input.VERTICAL_LEFT_COMMAND : Input.VERTICAL_LEFT_COMMAND + 2] = (
            20 * mm * np.sin(step / 60)
        )
        plant.step()
        plant.measure()
    return plant


def given_to(plant: Plant, other) -> list[str]:
    names = differing(plant.parameters, other.record)
    take(plant, {name: np.array(other.record[name]) for name in names})
    return names


@pytest.mark.parametrize("name", PLACED)
def test_whatever_begins_neither_air_nor_heat_nor_motion_comes_from_nowhere(name):
    effect = CATALOGUE[name.partition(".")[0]]
    plant = moved(700)
    state, before = plant.state.copy(), plant.ideal()
    given_to(plant, with_effects(SOUND, {name: {effect.amplitude.name: effect.amplitude.typical}}))
    kept = slice(0, State.EXTRA_VERTICAL_DASHPOT)
    assert plant.state[kept].tolist() == state[kept].tolist()
    jump = np.abs(plant.ideal() - before)
    if effect.name in RELAXES:
        assert jump[Sensor.LOAD_CELL_1 : Sensor.LOAD_CELL_4 + 1].max() < 5.0, "it pulls at nothing yet"
    if effect.family in ("flow", "sensor", "acquisition"):
        assert jump.max() < 1e-9, "what flows or reads otherwise finds the same state"
    plant.step(300)
    assert np.isfinite(plant.measure()).all() and np.isfinite(plant.state[:STATES]).all()


@pytest.mark.parametrize(
    ("name", "sensor", "step"),
    [
        ("force_latency", Sensor.LOAD_CELL_1, 150.0),
        ("pressure_latency", Sensor.LEFT_BELLOWS_PRESSURE, 1000.0),
        ("displacement_latency", Sensor.LEFT_HEIGHT, 0.4 * mm),
    ],
)
def test_a_reading_with_a_new_delay_stays_constant_first(name, sensor, step):
    """``step`` is what the reading changes by in a step at most: so near is when it is as old as it should be."""
    effect = CATALOGUE[name]
    plant, on_time = moved(700), moved(700)
    late = round(effect.amplitude.typical / plant.dt)
    given_to(plant, with_effects(SOUND, {name: {effect.amplitude.name: effect.amplitude.typical}}))
    prompt = [on_time.measure()[sensor]]
    for passed in range(1, 40):
        plant.step()
        on_time.step()
        prompt.append(on_time.measure()[sensor])
        assert abs(plant.measure()[sensor] - prompt[max(passed - late, 0)]) < step, passed
    assert np.abs(np.array(prompt[late:]) - prompt[:-late]).max() > 2 * step, "and it moves meanwhile"


def test_a_fault_persists_during_a_change_of_parameters():
    plant = Plant.at_rest(SOUND.record)
    par, faults = plant.parameters, ParameterFaults(plant.parameters)
    sound = par.leak_conductance.tolist()

    def leak(record) -> None:
        record.leak_conductance[0] += 1e-9

    mend = faults.change(("leak_conductance",), leak)
    faults.under(lambda: take(plant, {"leak_conductance": np.array([4e-9, 0.0])}))
    assert par.leak_conductance.tolist() == [5e-9, 0.0] != sound
    mend()
    assert par.leak_conductance.tolist() == [4e-9, 0.0]


def test_rubber_that_ends_leaves_to_the_rest_what_it_remembers():
    two = with_effects(SOUND, {"maxwell": {"ratio": 0.4, "time": 0.3}, "maxwell_two": {"ratio": 0.2}})
    plant = moved(700, two)
    first = int(State.EXTRA_VERTICAL_DASHPOT)
    fast, slow = (plant.state[first + 4 * k : first + 4 * k + 4].tolist() for k in (1, 2))
    assert fast != slow != plant.state[first : first + 4].tolist()
    given_to(plant, with_effects(SOUND, {"maxwell": {"ratio": 0.0}, "maxwell_two": {"ratio": 0.2}}))
    assert [plant.state[first + 4 * k : first + 4 * k + 4].tolist() for k in (0, 1)] == [fast, slow]


def test_a_drift_starts_at_zero():
    plant, sound = moved(700), moved(700)
    given_to(plant, with_effects(SOUND, {"pressure_drift.left": {"rate": 50.0}}))
    place = Sensor.LEFT_BELLOWS_PRESSURE
    assert plant.measure()[place] == pytest.approx(sound.measure()[place], abs=1.0)
    for one in (plant, sound):
        one.step(1000)
    assert plant.measure()[place] - sound.measure()[place] == pytest.approx(50.0, abs=25.1)


@given(share=st.floats(-0.3, 0.6), chamber=st.sampled_from(("bellows_volume", "auxiliary_volume")))
@settings(max_examples=10, deadline=None)
def test_another_volume_keeps_the_gas_and_changes_its_pressure(share, chamber):
    plant = moved(300)
    mass, energy = plant.state[State.AUXILIARY_MASS], plant.state[State.AUXILIARY_ENERGY]
    absolute = plant.truth()["auxiliary_pressure[0]"]
    names = given_to(plant, SOUND.with_values(**{chamber: SOUND.record[chamber] * (1.0 + share)}))
    assert VOLUMES.issuperset(names)
    assert (plant.state[State.AUXILIARY_MASS], plant.state[State.AUXILIARY_ENERGY]) == (mass, energy)
    if chamber == "auxiliary_volume":
        assert plant.truth()["auxiliary_pressure[0]"] == pytest.approx(absolute / (1.0 + share))


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("gas_constant", "the gas in the springs keeps its mass"),
        ("wall_heat_capacity", "would change without a heat flow"),
        ("spring_half_spacing", "the geometry of the rig cannot change"),
        ("nominal_preload", "plates and shims"),
        ("sensor_accuracy", "when the rig is built"),
    ],
)
def test_fixed_parameters_of_a_running_bench_are_refused_with_the_remedy(name, why):
    with pytest.raises(ParameterError, match=rf"{name} cannot .*{why}.*\[simulation.change\]"):
        differing(SOUND.record, SOUND.with_values(**{name: 1.01 * SOUND.record[name] + 1e-3}).record)
