"""The bench: its right-hand side as a sum of terms, its fixed step, and the readings of its sensors.

``x`` is the state vector (`State`), ``mem`` the memory record (`quantities.MEMORY`), ``u`` the inputs (`Input`),
``par`` the parameter record (`quantities.PARAMETERS`). Discontinuous quantities (valve states, friction reversals,
delayed set-points) are in ``mem`` and constant within a step. The terms of optional effects (`bench_sim.model.effects`)
are part of `air_spring` or of this module.
"""

from typing import Any

import numpy as np

from bench_sim.model.actuator import actuator_term, command_actuators
from bench_sim.model.air_spring import air_spring
from bench_sim.model.algebraic import ALGEBRAICS
from bench_sim.model.bolster import bolster_term, platform_term
from bench_sim.model.compiled import compiled, compiled_entry, compiled_once, compiled_within
from bench_sim.model.layout import SENSORS, STATES
from bench_sim.model.runge_kutta import integrate, step_scheme
from bench_sim.model.sensors import follow, read_sensors, true_values
from bench_sim.model.step_start import begin


@compiled
def evaluate(ahead: float, x: Any, mem: Any, u: Any, par: Any, given: Any, dx: Any, out: Any) -> None:
    """Compute the right-hand side of the bench (`bench_sim.model.runge_kutta`). ``given`` is empty."""
    air_spring(mem.time + ahead, x, mem, u, par, dx, out)
    # Forces are summed in the derivatives of the speeds; `bolster_term` divides the sums by the mass.
    actuator_term(x, mem, par, out, dx)
    bolster_term(x, par, out, dx)
    platform_term(x, u, par, out, dx)


@compiled_entry
def derivative(t: float, x: Any, mem: Any, u: Any, par: Any, dx: Any) -> None:
    """Write dx/dt at ``t`` s, for integrators that choose their own steps. ``mem`` does not change."""
    dx[:] = 0.0
    evaluate(t - mem.time, x, mem, u, par, (), dx, np.empty(ALGEBRAICS))


@compiled_within
def begin_step(
    slope: Any, x: Any, mem: Any, u: Any, par: Any, given: Any, dt: float, dx: Any, out: Any, values: Any
) -> None:
    """Carry out the actions at the start of a step (`bench_sim.model.step_start`), and write the slope there to
    ``dx``.
    """
    command_actuators(x, mem, u, par, dt)
    begin(slope, x, mem, u, par, given, dx, out)
    true_values(x, mem, par, out, values)
    follow(mem, par, values, dt)


@compiled_within
def step(
    x: Any,
    mem: Any,
    u: Any,
    par: Any,
    dt: float,
    scheme: tuple[int, int],
    work: Any,
    out: Any,
    values: Any,
) -> None:
    """Take one fixed step of ``dt`` s in place. ``scheme`` is that of `step_scheme`, and the caller provides the
    working memory.

    Shapes: ``work`` (5, STATES), ``out`` (ALGEBRAICS), ``values`` (SENSORS).
    """
    begin_step(evaluate, x, mem, u, par, (), dt, work[0], out, values)
    integrate(evaluate, dt, scheme, x, mem, u, par, (), work, out)
    mem.step += 1


@compiled_once
def observe(x: Any, mem: Any, u: Any, par: Any, dx: Any, out: Any, values: Any) -> None:
    """Write slope, algebraic variables and ideal readings of the present state. State and memory do not change."""
    evaluate(0.0, x, mem, u, par, (), dx, out)
    true_values(x, mem, par, out, values)


@compiled_entry
def measure(x: Any, mem: Any, u: Any, par: Any, counter: int, readings: Any) -> None:
    """Write the readings of all sensors (SI, `Sensor`). ``counter`` determines the noise. State and memory do not
    change, so calls at any rate are possible.
    """
    values = np.empty(SENSORS)
    observe(x, mem, u, par, np.empty(STATES), np.empty(ALGEBRAICS), values)
    read_sensors(mem, par, values, counter, readings)


@compiled_entry
def advance_plant(x: Any, memory: Any, u: Any, parameters: Any, dt: float, steps: int) -> None:
    """Take ``steps`` fixed steps of ``dt`` s in place with constant inputs. With a pipe, each step is divided
    (`pipe_steps`).

    Both records are passed as arrays of one element, because numba takes them from Python ten times faster than
    records.
    """
    mem, par = memory[0], parameters[0]
    work = np.empty((5, STATES))
    out = np.empty(ALGEBRAICS)
    values = np.empty(SENSORS)
    scheme = step_scheme(par, dt)
    for _ in range(steps):
        step(x, mem, u, par, dt, scheme, work, out, values)


@compiled_entry
def measure_plant(x: Any, memory: Any, u: Any, parameters: Any, counter: int, readings: Any) -> None:
    """Write the readings like `measure`, with both records passed as arrays of one element."""
    measure(x, memory[0], u, parameters[0], counter, readings)
