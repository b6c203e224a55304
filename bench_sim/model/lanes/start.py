"""Converts parameters and initial state of a spring to one column of `bench_sim.model.lanes.layout`.

The column contains most inputs for the integration of this spring. Further inputs are the motion of its plates, and the
parameters of fitted surfaces and valves; see `bench_sim.model.lanes.springs.LaneSpring.key`.
"""

from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench_sim.model.algebraic import ALGEBRAICS, Algebraic
from bench_sim.model.compiled import compiled, compiled_entry
from bench_sim.model.gas import enthalpy_per_kelvin, keep_density
from bench_sim.model.lanes.layout import (
    EXTRA_FRICTION,
    EXTRA_RATIO,
    EXTRA_SPEED,
    EXTRA_TRAVEL,
    LANE_FRICTIONS,
    LANES,
    LENGTH,
    POWERS,
    STAGE,
    Lane,
    LaneState,
)
from bench_sim.model.layout import BRANCHES, EXTRA_BRANCHES, EXTRA_DASHPOTS, SIDES, State
from bench_sim.model.orifice import effective_flow_area, nozzle_constant, nozzle_slope, reynolds_per_flow
from bench_sim.model.quantities import QUANTITIES
from bench_sim.model.replay import settle
from bench_sim.model.spring import compliance, stretch, unpressed_area

#: Parameters that lanes support only with these values.
_UNKNOWN: Final = {one.name: one.default or 0.0 for one in QUANTITIES if not one.lanes}


def has_lanes(par: Any) -> bool:
    """Return whether lanes can integrate a spring with these parameters. Otherwise the scalar replay is necessary."""
    return (
        par.emergency_spring != 0.0
        and not any(np.any(par[name] != absent) for name, absent in _UNKNOWN.items())
        and not par.extra_friction[LANE_FRICTIONS:].any()
    )


@lru_cache(maxsize=8)
def power_coefficients(kappa: float) -> NDArray[np.float64]:
    """Return the coefficients (POWERS) of the polynomial for r^(1/κ). Its argument is −1 at the critical pressure
    ratio, and 1 at the ratio r = 1.
    """
    low = critical_ratio(kappa)
    series = np.polynomial.Chebyshev.interpolate(lambda r: r ** (1.0 / kappa), POWERS - 1, domain=[low, 1.0])
    return np.asarray(np.polynomial.chebyshev.cheb2poly(series.coef), dtype=np.float64)


@compiled
def critical_ratio(kappa: float) -> float:
    """Return the pressure ratio p₂/p₁ below which a nozzle is choked."""
    return (2.0 / (kappa + 1.0)) ** (kappa / (kappa - 1.0))


@compiled
def _fill_states(w: Any, i: int, x: Any, mem: Any) -> None:
    """Write the states of side ``i`` and the last friction reversal to the column."""
    w[STAGE + LaneState.MASS] = x[State.BELLOWS_MASS + i]
    w[STAGE + LaneState.ENERGY] = x[State.BELLOWS_ENERGY + i]
    w[STAGE + LaneState.AUXILIARY_MASS] = x[State.AUXILIARY_MASS + i]
    w[STAGE + LaneState.AUXILIARY_ENERGY] = x[State.AUXILIARY_ENERGY + i]
    w[STAGE + LaneState.WALL] = x[State.BELLOWS_WALL + i]
    w[STAGE + LaneState.AUXILIARY_WALL] = x[State.AUXILIARY_WALL + i]
    w[STAGE + LaneState.CREEP] = x[State.CREEP + i]
    for j in range(BRANCHES):
        w[STAGE + LaneState.DASHPOT_Z + LANES * j] = x[State.VERTICAL_DASHPOT + i * BRANCHES + j]
        w[STAGE + LaneState.DASHPOT_Y + LANES * j] = x[State.LATERAL_DASHPOT + i * BRANCHES + j]
    for j in range(EXTRA_BRANCHES):
        place = STAGE + LaneState.EXTRA + 2 * LANES * j
        w[place] = x[State.EXTRA_VERTICAL_DASHPOT + EXTRA_DASHPOTS * j + i]
        w[place + LANES] = x[State.EXTRA_LATERAL_DASHPOT + EXTRA_DASHPOTS * j + i]
    w[Lane.NOTED_Z] = mem.bellows_vertical[i]
    w[Lane.NOTED_Y] = mem.bellows_lateral[i]
    w[Lane.ORIGIN_Z] = mem.friction_origin[0, i]
    w[Lane.ORIGIN_Y] = mem.friction_origin[1, i]


@compiled
def _fill_rubber(w: Any, i: int, par: Any) -> None:
    """Write the parameters of the rubber (stiffness, relaxation, friction), of the emergency spring (compliance, creep,
    preload) and of the contact.
    """
    w[Lane.RATIOS] = 0.0
    for j in range(BRANCHES):
        w[Lane.RATIO + LANES * j] = par.maxwell_ratio[j]
        w[Lane.SPEED + LANES * j] = 1.0 / par.maxwell_time[j]
        w[Lane.RATIOS] += par.maxwell_ratio[j]
    for j in range(EXTRA_BRANCHES):
        w[EXTRA_RATIO + LANES * j] = par.extra_branch_ratio[j]
        w[EXTRA_SPEED + LANES * j] = 1.0 / par.extra_branch_time[j]
        w[Lane.RATIOS] += par.extra_branch_ratio[j]
    for e in range(LANE_FRICTIONS):
        w[EXTRA_FRICTION + LANES * e] = par.extra_friction[e]
        w[EXTRA_TRAVEL + LANES * e] = par.extra_friction_travel[e]
    w[Lane.SHELL_Z] = par.shell_stiffness_vertical[i]
    w[Lane.SHELL_Y] = par.shell_stiffness_lateral[i]
    w[Lane.FRICTION_Z] = par.friction_vertical[i]
    w[Lane.FRICTION_Z_SLOPE] = par.friction_vertical_slope[i]
    w[Lane.FRICTION_Z_TRAVEL] = par.friction_vertical_travel[i]
    w[Lane.FRICTION_Y] = par.friction_lateral[i]
    w[Lane.FRICTION_Y_SLOPE] = par.friction_lateral_slope[i]
    w[Lane.FRICTION_Y_TRAVEL] = par.friction_lateral_travel[i]
    w[Lane.SMALL_LOOP] = par.friction_small_loop
    w[Lane.CONTACT_HEIGHT] = par.contact_height
    w[Lane.CONTACT_STIFFNESS] = par.contact_stiffness
    w[Lane.PRELOAD] = par.nominal_preload[i]
    w[Lane.GIVE_Z] = 1.0 / par.emergency_stiffness_vertical[i] if par.emergency_spring != 0.0 else 0.0
    w[Lane.GIVE_Y] = 1.0 / par.emergency_stiffness_lateral[i] if par.emergency_spring != 0.0 else 0.0
    w[Lane.CREEP_GAIN] = par.creep_ratio[i] / par.emergency_stiffness_vertical[i]
    w[Lane.CREEP_RATE] = 1.0 / par.creep_time[i] if par.creep_ratio[i] != 0.0 else 0.0


@compiled
def _fill_gas(w: Any, i: int, par: Any) -> None:
    """Write the parameters of volumes, areas and heat transfer."""
    w[Lane.V_0] = par.bellows_volume[i]
    w[Lane.A_0] = unpressed_area(par, i)
    w[Lane.A_1] = par.effective_area_slope[i]
    w[Lane.KAPPA_0] = par.membrane_length[i]
    w[Lane.KAPPA_1] = par.membrane_length_slope[i]
    w[Lane.PER_TRAVEL] = 1.0 / par.membrane_travel[i]
    w[Lane.GROWTH] = par.effective_area_growth[i]
    w[Lane.STRETCH] = compliance(par, i, 0.0)
    w[Lane.STRETCH_AT_0] = stretch(par, i, 0.0, 0.0)
    w[Lane.ATMOSPHERE] = par.atmospheric_pressure
    w[Lane.GAS_CONSTANT] = par.gas_constant
    w[Lane.HEAT_RATIO] = par.heat_capacity_ratio
    w[Lane.HEAT_CAPACITY] = enthalpy_per_kelvin(par)
    w[Lane.AMBIENT] = par.ambient_temperature
    w[Lane.AUXILIARY_VOLUME] = par.auxiliary_volume[i]
    w[Lane.HEAT] = par.bellows_heat_transfer[i]
    w[Lane.AUXILIARY_HEAT] = par.auxiliary_heat_transfer[i]
    w[Lane.HEAT_EXPONENT] = par.heat_density_exponent
    w[Lane.HEAT_DENSITY] = par.heat_reference_density
    C = par.wall_heat_capacity[i]
    w[Lane.WALL_RATE] = 1.0 / C if C > 0.0 else 0.0
    w[Lane.WALL_OUTER] = par.wall_outer_heat_transfer[i]


@compiled
def _fill_flow(w: Any, i: int, par: Any, powers: Any) -> None:
    """Write the parameters of orifice, connection and leaks."""
    kappa = par.heat_capacity_ratio
    w[Lane.ORIFICE] = effective_flow_area(par.orifice_diameter[i], par.discharge_coefficient[i])
    w[Lane.ASYMMETRY] = par.orifice_asymmetry[i]
    w[Lane.REYNOLDS] = par.orifice_reynolds[i]
    w[Lane.INERTANCE] = par.flow_inertance[i]
    w[Lane.REYNOLDS_PER_FLOW] = reynolds_per_flow(par.orifice_diameter[i])
    w[Lane.LAMINAR] = par.laminar_limit
    w[Lane.PSI_LAMINAR] = nozzle_slope(par.laminar_limit, kappa)
    w[Lane.PSI_FACTOR] = nozzle_constant(kappa)
    w[Lane.CRITICAL] = critical_ratio(kappa)
    w[Lane.LEAK] = par.leak_conductance[i]
    w[Lane.LEAK_CRITICAL] = par.leak_critical_ratio
    w[Lane.LEAK_LAMINAR] = par.leak_laminar[i]
    for k in range(POWERS):
        w[Lane.POWER + LANES * k] = powers[k]


@compiled_entry
def begin_springs(
    x: Any, memory: Any, parameters: Any, gas: Any, before: Any, powers: Any, columns: Any
) -> None:
    """Compute the state of rest of both springs at the positions in ``x``, and write one column for each spring to
    ``columns`` (shape (SIDES, LENGTH // LANES)).

    ``x`` and ``memory`` are changed. ``memory`` and ``parameters`` are arrays of one element. ``gas`` and ``before``
    are those of `bench_sim.model.replay`, and ``powers`` are from `power_coefficients`.
    """
    mem = memory[0]
    par = parameters[0]
    w = np.zeros(LENGTH)
    out = np.zeros(ALGEBRAICS)
    settle(x, mem, par, gas, before, out)
    for i in range(SIDES):
        _fill_states(w, i, x, mem)
        _fill_rubber(w, i, par)
        _fill_gas(w, i, par)
        _fill_flow(w, i, par, powers)
        keep_density(mem, par, i, x[State.BELLOWS_MASS + i] / out[Algebraic.VOLUME + i])
        keep_density(mem, par, 2 + i, x[State.AUXILIARY_MASS + i] / par.auxiliary_volume[i])
        w[Lane.DENSITY] = mem.heat_density[i]
        w[Lane.DENSITY_FACTOR] = mem.heat_factor[i]
        w[Lane.AUXILIARY_DENSITY] = mem.heat_density[2 + i]
        w[Lane.AUXILIARY_DENSITY_FACTOR] = mem.heat_factor[2 + i]
        columns[i] = w[::LANES]
