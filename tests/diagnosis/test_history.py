"""What rubber remembers of earlier loads: closed forms, and a replay that goes on where another one ended."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.layout import INPUTS, Input
from bench_sim.model.replay import DIRECTIONS, Before, Gas, Motion, replay
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects
from diagnosis.systems.air_spring.history import (
    MEMORIES,
    SHEAR,
    Past,
    behind,
    remembered,
    remembered_loads,
    remembered_places,
)
from diagnosis.systems.air_spring.parity import CELLS

#: The record begins so long after the bench was switched on, and the load of each spring grows at CHANGE (s, N).
LATE, CHANGE, LOW, HIGH = 20.0, 150.0, 50e3, 140e3


def recorded(missing=()):
    """A record of load cells ten times a second that carry both springs evenly, with a gap and a few lost samples."""
    time = np.arange(0.0, 400.0, 0.1)
    cell = np.where(time < CHANGE, LOW, HIGH) / 2.0
    cell[500:520] = np.nan
    kept = (time < 200.0) | (time > 230.0)
    nothing = np.zeros(int(kept.sum()))
    signals = {name: cell[kept] if name in CELLS[:4] else nothing for name in CELLS if name not in missing}
    return SimpleNamespace(signals=signals, series=lambda name: (time[kept], signals[name]))


@pytest.mark.parametrize("memory", [*MEMORIES, 5.0, 55.0, 550.0, 2000.0])
@pytest.mark.parametrize("at", [100.0, 180.0, 390.0])
def test_a_load_that_was_raised_is_remembered_as_an_exponential(memory, at):
    told = remembered_loads(Past(recorded(), at, at + LATE), load())
    exact = LOW * (1.0 - np.exp(-(at + LATE) / memory))
    if at > CHANGE:
        exact += (HIGH - LOW) * (1.0 - np.exp(-(at - CHANGE) / memory))
    # Between the stated memories, an eighth of a decade of a curve over two decades.
    close = 1e-6 if memory in MEMORIES else 0.02
    for side in ("left", "right"):
        assert remembered(told, side, memory) == pytest.approx(exact, rel=close)


def test_later_motion_is_not_part_of_the_history():
    assert all(value <= LOW for value in remembered_loads(Past(recorded(), 100.0, 120.0), load()).values())


def test_no_load_is_assumed_without_load_cells():
    assert remembered_loads(Past(recorded(missing=CELLS[2:3]), 100.0, 120.0), load()) == {}
    assert remembered({}, "left", 100.0) == 0.0


#: Of both sides: pressures and temperatures of the bellows, then of the auxiliary chambers.
PRESSURES = [Algebraic.PRESSURE + i for i in range(2)] + [Algebraic.AUXILIARY_PRESSURE + i for i in range(2)]
TEMPERATURES = [Algebraic.TEMPERATURE + i for i in range(2)]
TEMPERATURES += [Algebraic.AUXILIARY_TEMPERATURE + i for i in range(2)]


def test_a_spring_that_has_crept_goes_on_from_there():
    """A replay of a hold from its middle is the second half of the whole, if it receives how far the first half crept.

    Without rubber and walls that remember of their own, which a replay finds at rest.
    """
    bare = {"maxwell_ratio": 0.0, "friction_vertical": 0.0, "wall_heat_capacity": 0.0}
    bare |= {"sensor_noise": 0.0, "sensor_resolution": 0.0, "sensor_lag": 0.0}
    record = with_effects(load("astb").with_values(**bare), {"creep": {"ratio": 0.1, "time": 30.0}}).record
    step, n = 5e-3, 8001
    middle = n // 2
    inputs = np.zeros((n, INPUTS))
    inputs[:, [Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 1.0

    def held(samples, gas, before=None):
        rows = np.zeros((samples, ALGEBRAICS))
        motion = Motion.through(np.zeros((samples, DIRECTIONS)), step)
        replay(record, motion, inputs[:samples], np.full(samples, 9e5), gas, before=before, rows=rows)
        return rows

    whole = held(n, Gas(np.full(4, 3e5), np.full(4, record.ambient_temperature)))
    force = [Algebraic.STACK_VERTICAL, Algebraic.STACK_VERTICAL + 1]
    edges = np.exp(-step * np.arange(middle, -1, -1) / 30.0)
    crept = 0.1 * np.diff(edges) @ whole[:middle, force] / record.emergency_stiffness_vertical
    began = Gas(whole[middle, PRESSURES], whole[middle, TEMPERATURES])
    moved = np.ptp(whole[:, force[0]])
    assert moved > 100.0
    told, fresh = held(n - middle, began, Before.at_rest()._replace(crept=crept)), held(n - middle, began)
    assert np.abs(told - whole[middle:])[:, force].max() < 0.01 * moved
    assert np.abs(fresh - whole[middle:])[:, force].max() > 0.1 * moved


#: Heights of the left and right spring and their load before and after the change: the right one was filled then.
STOOD = {"left": (10e-3, 10e-3), "right": (-50e-3, -5e-3)}


def filled(missing=()):
    """A record of springs of which one is filled at CHANGE, when they are also shimmed for another load."""
    time = np.arange(0.0, 400.0, 0.1)
    cell = np.where(time < CHANGE, LOW, HIGH) / 2.0
    signals = {f"{side}.height": np.where(time < CHANGE, *STOOD[side]) for side in STOOD}
    signals |= {name: cell if name in CELLS[:4] else np.zeros(len(time)) for name in CELLS}
    signals["lateral.displacement"] = np.where(time < CHANGE, 0.0, 4e-3)
    signals = {name: values for name, values in signals.items() if name not in missing}
    return SimpleNamespace(signals=signals, series=lambda name: (time, signals[name]))


def shimmed(times):
    return np.where(times < CHANGE - 0.01, LOW, HIGH)


@pytest.mark.parametrize("memory", [*MEMORIES, 5.0, 55.0, 550.0, 2000.0])
def test_dash_pots_lag_exponentially_after_a_change(memory):
    """The emergency springs give more under the higher load, and the shims make up for it: the bellows feel neither."""
    at = 390.0
    told = remembered_places(Past(filled(), at, at + LATE), load(), shimmed)
    left = np.exp(-(at - CHANGE) / memory)
    close = 1e-6 if memory in MEMORIES else 0.02
    par = load().record
    roll = 0.5 * (STOOD["left"][1] - STOOD["right"][1] - STOOD["left"][0] + STOOD["right"][0])
    arm = par.lateral_actuator_height + par.centre_height
    sheared = 4e-3 + arm * roll / par.spring_half_spacing
    for place, rise in (("left", 0.0), ("right", 45e-3), (SHEAR, sheared)):
        assert behind(told, place, memory) == pytest.approx(rise * left, abs=max(close * abs(rise), 1e-12))


def test_without_load_cells_the_emergency_spring_is_rigid():
    told = remembered_places(Past(filled(missing=CELLS[:1]), 390.0, 410.0), load(), shimmed)
    assert behind(told, "right", 300.0) == pytest.approx(45e-3 * np.exp(-240.0 / 300.0), rel=1e-6)
    assert remembered_places(Past(filled(missing=("left.height",)), 390.0, 410.0), load(), shimmed) == {}
    assert behind({}, "left", 300.0) == 0.0


def test_fast_dash_pots_have_followed():
    told = remembered_places(Past(filled(), 150.2, 170.2), load(), shimmed)
    assert behind(told, "right", 0.3) == behind(told, "right", 1e-3) == 0.0
    assert 0.0 < behind(told, "right", 1.0) < behind(told, "right", 3.0)


def test_a_slow_branch_continues_from_its_initial_state():
    """A replay of a hold after a lift is the end of the whole, if it receives how far the dash-pots were behind."""
    bare = {"maxwell_ratio": 0.0, "wall_heat_capacity": 0.0}
    bare |= {f"friction_{way}{part}": 0.0 for way in ("vertical", "lateral") for part in ("", "_slope")}
    bare |= {"sensor_noise": 0.0, "sensor_resolution": 0.0, "sensor_lag": 0.0}
    two = {"ratio": 0.6, "share": 0.5, "time_fast": 4.0, "time_slow": 30.0}
    record = with_effects(load("astb").with_values(**bare), {"maxwell_two": two}).record
    step, n = 5e-3, 4001
    middle = n // 2
    inputs = np.zeros((n, INPUTS))
    inputs[:, [Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 1.0
    lift = np.zeros((n, DIRECTIONS))
    lift[:, :2] = np.clip(np.arange(n) / 1000.0, 0.0, 1.0)[:, None] * (4e-3, 6e-3)

    def moved(part, gas, before=None):
        motion = Motion.through(lift[part], step)
        rows = np.zeros((len(lift[part]), ALGEBRAICS))
        replay(record, motion, inputs[part], np.full(len(rows), 9e5), gas, before=before, rows=rows)
        return rows

    whole = moved(slice(n), Gas(np.full(4, 3e5), np.full(4, record.ambient_temperature)))
    z, y = whole[:, Algebraic.BELLOWS_VERTICAL], whole[:, Algebraic.BELLOWS_LATERAL]
    before = Before.at_rest()
    for j in range(2):
        edge = np.exp(-step * np.arange(middle, -1, -1) / record.extra_branch_time[j])
        for direction, x in enumerate((z, y)):
            means = 0.5 * (x[:middle] + x[1 : middle + 1])
            before.behind[j, 2 * direction : 2 * direction + 2] = (
                x[middle] - np.diff(edge) @ means - edge[0] * x[0]
            )
    began = Gas(whole[middle, PRESSURES], whole[middle, TEMPERATURES])
    told, fresh = moved(slice(middle, n), began, before), moved(slice(middle, n), began)
    for force in (Algebraic.STACK_VERTICAL, Algebraic.STACK_LATERAL):
        missed = np.abs(fresh - whole[middle:])[:, force].max()
        assert missed > 20.0
        assert np.abs(told - whole[middle:])[:, force].max() < 0.01 * missed
