"""The air of one spring under imposed motion: the compiled functions of the model compared with the same equations in
C.
"""

import ctypes
import tempfile
from math import cos, pi, sin
from pathlib import Path
from typing import Any

import numpy as np

from astb_studies.benchmarks import gcc
from astb_studies.benchmarks.measure import Effort, Section, Skipped, compare, cpu, interleaved
from bench_protocol.runtime.binding import bind
from bench_protocol.units import Hz, mm, ms
from bench_sim.model.compiled import compiled, compiled_entry
from bench_sim.model.gas import density_factor, energy_of, mass_of, temperature, transfer, wall_heat
from bench_sim.model.orifice import effective_flow_area, orifice_between
from bench_sim.parameters import load

STEPS = 50_000
STEP = 1 * ms
AMPLITUDE, FREQUENCY = 5 * mm, 1 * Hz
#: Two results whose difference is this small (relative) come from the same equations.
SAME = 1e-9


@compiled
def slope(t: float, x: Any, par: Any, dx: Any) -> None:
    """dx/dt of x = (m_b, m_a, U_b, U_a, T_wall b, T_wall a): flow, heat and work, in the model's own functions."""
    kappa = par.heat_capacity_ratio
    R = par.gas_constant
    omega = 2.0 * pi * FREQUENCY
    area = par.effective_area[0]
    V = par.bellows_volume[0] + area * AMPLITUDE * sin(omega * t)
    V_a = par.auxiliary_volume[0]
    p = (kappa - 1.0) * x[2] / V
    T = temperature(x[0], x[2], R, kappa)
    T_a = temperature(x[1], x[3], R, kappa)
    flow = orifice_between(
        p,
        T,
        (kappa - 1.0) * x[3] / V_a,
        T_a,
        effective_flow_area(par.orifice_diameter[0], par.discharge_coefficient[0]),
        R,
        kappa,
        par.laminar_limit,
    )
    dx[:] = 0.0
    transfer(dx, 0, 1, flow, kappa / (kappa - 1.0) * R * (T if flow > 0.0 else T_a))
    # No density is known beforehand: both sides take the power, as C does.
    hS = par.bellows_heat_transfer[0] * density_factor(x[0] / V, 0.0, 0.0, par)
    wall_heat(x, par, 0, 0, 4, T, hS, dx)
    hS = par.auxiliary_heat_transfer[0] * density_factor(x[1] / V_a, 0.0, 0.0, par)
    wall_heat(x, par, 0, 1, 5, T_a, hS, dx)
    dx[2] -= p * area * AMPLITUDE * omega * cos(omega * t)


@compiled_entry
def run_steps(x: Any, parameters: Any, dt: float, steps: int) -> None:
    """Take ``steps`` Runge-Kutta steps in place."""
    par = parameters[0]
    work = np.empty((4, 6))
    y = x.copy()
    for n in range(steps):
        t = n * dt
        slope(t, x, par, work[0])
        for k in range(4):
            y[k] = x[k] + 0.5 * dt * work[0, k]
        slope(t + 0.5 * dt, y, par, work[1])
        for k in range(4):
            y[k] = x[k] + 0.5 * dt * work[1, k]
        slope(t + 0.5 * dt, y, par, work[2])
        for k in range(4):
            y[k] = x[k] + dt * work[2, k]
        slope(t + dt, y, par, work[3])
        for k in range(4):
            x[k] += dt / 6.0 * (work[0, k] + 2.0 * (work[1, k] + work[2, k]) + work[3, k])


def run(effort: Effort) -> Section:
    """Measure both loops; the control is skipped without gcc."""
    par = load("astb").under("AW0").record
    parameters = np.array([par]).view(np.recarray)
    start = at_rest(par)
    step = bind(run_steps, start, parameters, STEP, STEPS)
    x = np.empty(6)

    def ours() -> None:
        x[:] = start
        step(x, parameters, STEP, STEPS)

    title = "Air of one spring: two chambers, orifice, heat (step of 1 ms)"
    with tempfile.TemporaryDirectory() as directory:
        try:
            library = ctypes.CDLL(str(gcc.compiled("gas.c", Path(directory), "-shared", "-fPIC")))
        except Skipped as reason:
            return Section(title, (), (f"Skipped: {reason}.",))
        y, constants = np.empty(4), np.array(c_constants(par))
        pointer = ctypes.POINTER(ctypes.c_double)

        def control() -> None:
            y[:] = start[:4]
            library.run(
                y.ctypes.data_as(pointer),
                constants.ctypes.data_as(pointer),
                ctypes.c_double(STEP),
                ctypes.c_long(STEPS),
            )

        found = interleaved(
            effort.repetitions, {"ours": lambda: cpu(ours, STEPS), "control": lambda: cpu(control, STEPS)}
        )
    difference = float(np.max(np.abs(x[:4] / y - 1.0)))
    if difference > SAME:
        raise AssertionError(
            f"after {STEPS} steps, C and numba differ by {difference:.1e}, so their equations differ"
        )
    row = compare("one step, numba", found["ours"], "C, gcc -O2", found["control"])
    note = f"Both loops end in the same state, to {difference:.0e}. Processor time of one thread."
    return Section(title, (row,), (note,))


def at_rest(par: Any) -> Any:
    """Return the state under the preload at ambient temperature."""
    p = par.nominal_preload[0] / par.effective_area[0] + par.atmospheric_pressure
    T, R, kappa = par.ambient_temperature, par.gas_constant, par.heat_capacity_ratio
    V, V_a = par.bellows_volume[0], par.auxiliary_volume[0]
    masses = mass_of(p, V, T, R), mass_of(p, V_a, T, R)
    return np.array([*masses, energy_of(p, V, kappa), energy_of(p, V_a, kappa), T, T])


def c_constants(par: Any) -> list[float]:
    """Return the members of ``Gas`` in gas.c."""
    return [
        par.gas_constant,
        par.heat_capacity_ratio,
        par.laminar_limit,
        effective_flow_area(par.orifice_diameter[0], par.discharge_coefficient[0]),
        par.bellows_heat_transfer[0],
        par.auxiliary_heat_transfer[0],
        par.ambient_temperature,
        par.ambient_temperature,
        par.heat_reference_density,
        par.heat_density_exponent,
        par.bellows_volume[0],
        par.effective_area[0],
        par.auxiliary_volume[0],
        AMPLITUDE,
        2.0 * pi * FREQUENCY,
    ]
