"""The plant's right-hand side as a sum of terms, its fixed step, and one sampling of its sensors.

``x`` is the state vector (`State`), ``mem`` the memory record (`quantities.MEMORY`), ``u`` the inputs (`Input`),
``par`` the parameter record (`quantities.PARAMETERS`). What changes abruptly (latches, friction reversals, delayed
set-points) stands in ``mem`` and is constant within a step; an effect adds its own term to `air_spring` or here.
"""

from typing import Any

import numpy as np

from bench_sim.model.actuator import actuator_term, command_actuators
from bench_sim.model.air_spring import air_spring
from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.bolster import bolster_term, platform_term
from bench_sim.model.compiled import compiled, compiled_entry, compiled_once
from bench_sim.model.gas import note_densities
from bench_sim.model.layout import SENSORS, STATES, TINY, State
from bench_sim.model.pipe import pipe_steps
from bench_sim.model.rubber import turn_friction
from bench_sim.model.sensors import follow, read_sensors, true_values
from bench_sim.model.valves import dpv_latch, leveling_latch, note_flows


@compiled_once
def evaluate(t: float, x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any) -> None:
    """dx/dt into ``dx`` (STATES), everything algebraic into ``out`` (`Algebraic`); reads ``mem``, never writes it."""
    dx[:] = 0.0
    air_spring(t, x, mem, u, par, dx, out)
    # Forces gather in the derivatives of the speeds; the bolster divides them by its mass.
    actuator_term(x, mem, par, out, dx)
    bolster_term(x, par, out, dx)
    platform_term(x, u, par, out, dx)


@compiled_entry
def derivative(t: float, x: Any, mem: Any, u: Any, par: Any, dx: Any) -> None:
    """dx/dt alone, for integrators that choose their own steps; ``mem`` stays as it is."""
    evaluate(t, x, mem, u, par, dx, np.empty(ALGEBRAICS))


@compiled
def switch_valves(x: Any, mem: Any, par: Any) -> None:
    """Latches of the leveling valves and the differential pressure valve, from the state at the start of a step."""
    for i in range(2):
        mem.leveling_latch[i] = leveling_latch(
            x[State.LEVER + i], mem.leveling_latch[i], par.leveling_deadband[i], par.leveling_hysteresis[i]
        )
    gamma = par.heat_capacity_ratio - 1.0
    difference = gamma * (
        x[State.AUXILIARY_ENERGY] / par.auxiliary_volume[0]
        - x[State.AUXILIARY_ENERGY + 1] / par.auxiliary_volume[1]
    )
    mem.dpv_latch = dpv_latch(difference, mem.dpv_latch, par.dpv_opening, par.dpv_reclosing)


@compiled
def note_solution(mem: Any, par: Any, out: Any, t: float) -> bool:
    """Keep the bellows' motion and the flows for the next step and let friction turn; True if it turned anywhere."""
    note_flows(mem, par, out)
    turned = False
    dt = t - mem.solved_time
    for i in range(2):
        z = out[Algebraic.BELLOWS_VERTICAL + i]
        y = out[Algebraic.BELLOWS_LATERAL + i]
        z_speed = out[Algebraic.BELLOWS_VERTICAL_SPEED + i]
        y_speed = out[Algebraic.BELLOWS_LATERAL_SPEED + i]
        if turn_friction(
            mem, par, 0, i, z, z_speed, mem.bellows_vertical_speed[i], par.friction_vertical_travel[i], dt
        ):
            turned = True
        if turn_friction(
            mem, par, 1, i, y, y_speed, mem.bellows_lateral_speed[i], par.friction_lateral_travel[i], dt
        ):
            turned = True
        mem.bellows_vertical[i] = z
        mem.bellows_lateral[i] = y
        mem.bellows_vertical_speed[i] = z_speed
        mem.bellows_lateral_speed[i] = y_speed
    mem.solved_time = t
    return turned


@compiled_once
def begin_step(x: Any, mem: Any, u: Any, par: Any, dt: float, slope: Any, out: Any, values: Any) -> None:
    """Everything that happens once per step, and the slope at its start."""
    command_actuators(x, mem, u, par, dt)
    switch_valves(x, mem, par)
    evaluate(mem.time, x, mem, u, par, slope, out)
    if note_solution(mem, par, out, mem.time):
        evaluate(mem.time, x, mem, u, par, slope, out)
    note_densities(x, mem, par, out)
    true_values(x, mem, par, out, values)
    follow(mem, par, values, dt)


@compiled
def runge_kutta(x: Any, mem: Any, u: Any, par: Any, dt: float, work: Any, out: Any) -> None:
    """The classical Runge-Kutta step of fourth order from the slope in ``work[0]``; moves time on."""
    t = mem.time
    half = 0.5 * dt
    for k in range(STATES):
        work[4, k] = x[k] + half * work[0, k]
    evaluate(t + half, work[4], mem, u, par, work[1], out)
    for k in range(STATES):
        work[4, k] = x[k] + half * work[1, k]
    evaluate(t + half, work[4], mem, u, par, work[2], out)
    for k in range(STATES):
        work[4, k] = x[k] + dt * work[2, k]
    evaluate(t + dt, work[4], mem, u, par, work[3], out)
    for k in range(STATES):
        new = x[k] + dt / 6.0 * (work[0, k] + 2.0 * (work[1, k] + work[2, k]) + work[3, k])
        x[k] = new if abs(new) > TINY else 0.0
    mem.time = t + dt


@compiled
def step(
    x: Any, mem: Any, u: Any, par: Any, dt: float, pieces: int, work: Any, out: Any, values: Any
) -> None:
    """One fixed step in place, integrated in ``pieces``; the rest is the caller's working memory.

    Shapes: ``work`` (5, STATES), ``out`` (ALGEBRAICS), ``values`` (SENSORS).
    """
    begin_step(x, mem, u, par, dt, work[0], out, values)
    for piece in range(pieces):
        if piece > 0:
            evaluate(mem.time, x, mem, u, par, work[0], out)
        runge_kutta(x, mem, u, par, dt / pieces, work, out)
    mem.step += 1


@compiled_entry
def advance_many(x: Any, mem: Any, u: Any, par: Any, dt: float, steps: int) -> None:
    """``steps`` fixed steps in place with the inputs held; a fitted pipe divides what is integrated (`pipe_steps`)."""
    work = np.empty((5, STATES))
    out = np.empty(ALGEBRAICS)
    values = np.empty(SENSORS)
    pieces = pipe_steps(par, dt)
    for _ in range(steps):
        step(x, mem, u, par, dt, pieces, work, out, values)


@compiled_entry
def advance(x: Any, mem: Any, u: Any, par: Any, dt: float) -> None:
    """One fixed step in place with the inputs held."""
    advance_many(x, mem, u, par, dt, 1)


@compiled_once
def observe(x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any, values: Any) -> None:
    """Slope, algebraic quantities and ideal readings of the present state; changes nothing else."""
    evaluate(mem.time, x, mem, u, par, dx, out)
    true_values(x, mem, par, out, values)


@compiled_entry
def measure(x: Any, mem: Any, u: Any, par: Any, counter: int, readings: Any) -> None:
    """Readings of all sensors at this instant (SI, `Sensor`); changes nothing else, so it may be called at any rate."""
    values = np.empty(SENSORS)
    observe(x, mem, u, par, np.empty(STATES), np.empty(ALGEBRAICS), values)
    read_sensors(mem, par, values, counter, readings)


@compiled_entry
def advance_plant(x: Any, memory: Any, u: Any, parameters: Any, dt: float, steps: int) -> None:
    """`advance_many` with both records in arrays of one, which cross from Python ten times faster than records do."""
    advance_many(x, memory[0], u, parameters[0], dt, steps)


@compiled_entry
def measure_plant(x: Any, memory: Any, u: Any, parameters: Any, counter: int, readings: Any) -> None:
    """`measure` with both records in arrays of one."""
    measure(x, memory[0], u, parameters[0], counter, readings)
