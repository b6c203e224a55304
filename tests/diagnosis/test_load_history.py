"""What rubber remembers of earlier loads: closed forms, and a replay that goes on where another one ended."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.layout import INPUTS, Input
from bench_sim.model.replay import DIRECTIONS, Gas, Motion, replay
from bench_sim.parameters import load
from bench_sim.parameters.effects import with_effects
from diagnosis.systems.air_spring_parity import CELLS
from diagnosis.systems.load_history import MEMORIES, remembered, remembered_loads

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
    told = remembered_loads(recorded(), at, at + LATE, load())
    exact = LOW * (1.0 - np.exp(-(at + LATE) / memory))
    if at > CHANGE:
        exact += (HIGH - LOW) * (1.0 - np.exp(-(at - CHANGE) / memory))
    # Between the memories that are told, an eighth of a decade of a curve over two decades.
    close = 1e-6 if memory in MEMORIES else 0.02
    for side in ("left", "right"):
        assert remembered(told, side, memory) == pytest.approx(exact, rel=close)


def test_what_lies_ahead_is_not_remembered():
    assert all(value <= LOW for value in remembered_loads(recorded(), 100.0, 120.0, load()).values())


def test_without_load_cells_nothing_is_told_and_no_load_is_assumed():
    assert remembered_loads(recorded(missing=CELLS[2:3]), 100.0, 120.0, load()) == {}
    assert remembered({}, "left", 100.0) == 0.0


#: Of both sides: pressures and temperatures of the bellows, then of the auxiliary chambers.
PRESSURES = [Algebraic.PRESSURE + i for i in range(2)] + [Algebraic.AUXILIARY_PRESSURE + i for i in range(2)]
TEMPERATURES = [Algebraic.TEMPERATURE + i for i in range(2)]
TEMPERATURES += [Algebraic.AUXILIARY_TEMPERATURE + i for i in range(2)]


def test_a_spring_that_has_crept_goes_on_from_there():
    """A replay of a hold from its middle is the second half of the whole, if it is told how far the first half crept.

    Without rubber and walls that remember of their own, which a replay finds at rest.
    """
    bare = {"maxwell_ratio": 0.0, "friction_vertical": 0.0, "wall_heat_capacity": 0.0}
    bare |= {"sensor_noise": 0.0, "sensor_resolution": 0.0, "sensor_lag": 0.0}
    record = with_effects(load("astb").with_values(**bare), {"creep": {"ratio": 0.1, "time": 30.0}}).record
    step, n = 5e-3, 8001
    middle = n // 2
    inputs = np.zeros((n, INPUTS))
    inputs[:, [Input.LEFT_RESERVOIR_VALVE, Input.RIGHT_RESERVOIR_VALVE]] = 1.0

    def held(samples, gas, crept=None):
        rows = np.zeros((samples, ALGEBRAICS))
        motion = Motion.through(np.zeros((samples, DIRECTIONS)), step)
        replay(record, motion, inputs[:samples], np.full(samples, 9e5), gas, crept=crept, rows=rows)
        return rows

    whole = held(n, Gas(np.full(4, 3e5), np.full(4, record.ambient_temperature)))
    force = [Algebraic.STACK_VERTICAL, Algebraic.STACK_VERTICAL + 1]
    edges = np.exp(-step * np.arange(middle, -1, -1) / 30.0)
    crept = 0.1 * np.diff(edges) @ whole[:middle, force] / record.emergency_stiffness_vertical
    began = Gas(whole[middle, PRESSURES], whole[middle, TEMPERATURES])
    moved = np.ptp(whole[:, force[0]])
    assert moved > 100.0
    told, fresh = held(n - middle, began, crept), held(n - middle, began)
    assert np.abs(told - whole[middle:])[:, force].max() < 0.01 * moved
    assert np.abs(fresh - whole[middle:])[:, force].max() > 0.1 * moved
