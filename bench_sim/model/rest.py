"""A spring at rest: gas at one temperature, relaxed rubber, no friction force, and sensors in steady state."""

from typing import Any

from bench_sim.model.compiled import compiled
from bench_sim.model.gas import energy_of, mass_of
from bench_sim.model.layout import (
    BRANCHES,
    EXTRA_BRANCHES,
    EXTRA_DASHPOTS,
    EXTRA_FRICTIONS,
    HISTORY,
    SENSORS,
    SIDES,
    State,
)
from bench_sim.model.sensors import prepare_lags


@compiled
def settled_temperature(par: Any) -> float:
    """Return the temperature (K) of walls and air at the start of a run: ambient plus ``wall_temperature_offset``."""
    return par.ambient_temperature + par.wall_temperature_offset


@compiled
def fill_chamber(x: Any, par: Any, place: int, pressure: float, volume: float, temperature: float) -> None:
    """Write mass and energy of a chamber at this pressure (Pa), volume (m³) and temperature (K). ``place`` is the
    index of its mass (BELLOWS_MASS or AUXILIARY_MASS + side).
    """
    x[place] = mass_of(pressure, volume, temperature, par.gas_constant)
    x[place + 2] = energy_of(pressure, volume, par.heat_capacity_ratio)


@compiled
def relax_rubber(x: Any, mem: Any, side: int, z: float, y: float) -> None:
    """Set the rubber of one bellows to the state long after a deflection of z m vertically and y m laterally."""
    for j in range(BRANCHES):
        x[State.VERTICAL_DASHPOT + side * BRANCHES + j] = z
        x[State.LATERAL_DASHPOT + side * BRANCHES + j] = y
    for j in range(EXTRA_BRANCHES):
        x[State.EXTRA_VERTICAL_DASHPOT + EXTRA_DASHPOTS * j + side] = z
        x[State.EXTRA_LATERAL_DASHPOT + EXTRA_DASHPOTS * j + side] = y
    for direction in range(2):
        place = z if direction == 0 else y
        mem.friction_origin[direction, side] = place
        mem.friction_last[direction, side] = place
        mem.friction_level[direction, side] = 0.0
        mem.friction_direction[direction, side] = 0.0
        mem.friction_outer_way[direction, side] = 0.0
        for e in range(EXTRA_FRICTIONS):
            mem.extra_friction_level[e, direction, side] = 0.0
    mem.bellows_vertical[side] = z
    mem.bellows_lateral[side] = y
    mem.bellows_vertical_speed[side] = 0.0
    mem.bellows_lateral_speed[side] = 0.0


@compiled
def hold_back(x: Any, side: int, behind: Any) -> None:
    """Subtract ``behind`` (EXTRA_BRANCHES, EXTRA_DASHPOTS), in m, from the positions of the extra dash-pots of one
    spring. Call it after `relax_rubber`.
    """
    for j in range(EXTRA_BRANCHES):
        x[State.EXTRA_VERTICAL_DASHPOT + EXTRA_DASHPOTS * j + side] -= behind[j, side]
        x[State.EXTRA_LATERAL_DASHPOT + EXTRA_DASHPOTS * j + side] -= behind[j, SIDES + side]


@compiled
def settle_sensors(mem: Any, par: Any, values: Any, dt: float) -> None:
    """Set every sensor to the steady state for its present value."""
    prepare_lags(mem, par, dt)
    for k in range(SENSORS):
        mem.sensor_output[k] = values[k]
        mem.sensor_input[k] = mem.sensor_input_before[k] = mem.sensor_input_earlier[k] = values[k]
        for j in range(HISTORY):
            mem.sensor_history[k, j] = values[k]
