"""The gas in a chamber: mass and internal energy change by flow, wall heat and work.

    dm/dt = Σ G_in − Σ G_out
    dU/dt = Σ G_in c_p T_up − Σ G_out c_p T − p dV/dt + hS (T_w − T),   U = m c_v T,   p = (κ−1) U / V

Mass and internal energy are the states because both are conserved. A Runge-Kutta step keeps their sums exactly.
"""

from typing import Any

from bench_sim.model.algebraic import Algebraic
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import State


@compiled
def temperature(mass: float, energy: float, R: float, kappa: float) -> float:
    """Return T = (κ−1) U / (m R) in K."""
    return (kappa - 1.0) * energy / (mass * R)


@compiled
def pressure(energy: float, volume: float, kappa: float) -> float:
    """Return p = (κ−1) U / V in Pa."""
    return (kappa - 1.0) * energy / volume


@compiled
def enthalpy_per_kelvin(par: Any) -> float:
    """Return c_p = κ R/(κ−1) in J/(kg K), the enthalpy of a flow per kilogram and kelvin."""
    kappa = par.heat_capacity_ratio
    return kappa / (kappa - 1.0) * par.gas_constant


@compiled
def energy_of(pressure: float, volume: float, kappa: float) -> float:
    """Return U = p V / (κ−1) in J."""
    return pressure * volume / (kappa - 1.0)


@compiled
def mass_of(pressure: float, volume: float, T: float, R: float) -> float:
    """Return m = p V / (R T) in kg."""
    return pressure * volume / (R * T)


@compiled
def density_factor(density: float, known_density: float, known_factor: float, par: Any) -> float:
    """Return (ρ/ρ_ref)^n. The exponent n is assumed to be that of turbulent natural convection.

    Within a step the density is close to ``known_density``, the density at its start. For this case a series is exact
    enough, and takes a fifth of the time of the power.
    """
    n = par.heat_density_exponent
    if abs(density - known_density) < 0.01 * known_density:
        return density_series(density / known_density, known_factor, n)
    return (density / par.heat_reference_density) ** n


@compiled
def density_series(ratio: float, factor: float, n: float) -> float:
    """Return ``factor`` · (1+ε)^n by the series 1 + nε + n(n−1)/2 ε² + n(n−1)(n−2)/6 ε³, accurate to 1e-9. ``ratio``
    is 1+ε.
    """
    e = ratio - 1.0
    return factor * (1.0 + n * e * (1.0 + 0.5 * (n - 1.0) * e * (1.0 + (n - 2.0) / 3.0 * e)))


@compiled
def upstream_enthalpy(flow: float, T_1: float, T_2: float, c_p: float) -> float:
    """Return c_p T in J/kg of the chamber that air leaves. A positive ``flow`` leaves chamber 1."""
    return c_p * (T_1 if flow > 0.0 else T_2)


@compiled
def heat_inward(hS: float, wall: float, T: float) -> float:
    """Return the heat hS (T_w − T) in W from the wall into the gas."""
    return hS * (wall - T)


@compiled
def wall_speed(heat: float, wall: float, outer: float, ambient: float, per_capacity: float) -> float:
    """Return the rate dT_w/dt of the wall temperature in K/s: C_w dT_w/dt = −hS (T_w−T) + (hS)_o (T_amb−T_w). ``heat``
    is hS (T_w−T) in W, ``outer`` is (hS)_o in W/K, ``ambient`` is T_amb in K, and ``per_capacity`` is 1/C_w in K/J.
    """
    return per_capacity * (outer * (ambient - wall) - heat)


@compiled
def transfer(dx: Any, source: int, sink: int, flow: float, enthalpy: float) -> None:
    """Move ``flow`` kg/s with ``enthalpy`` J/kg from ``source`` to ``sink``, which are the indices of the masses in
    ``dx``.

    The energy of a chamber is two elements after its mass (`State`).
    """
    dx[source] -= flow
    dx[sink] += flow
    dx[source + 2] -= flow * enthalpy
    dx[sink + 2] += flow * enthalpy


@compiled
def wall_heat(
    x: Any, par: Any, side: int, mass_state: int, wall_state: int, T: float, hS: float, dx: Any
) -> float:
    """Return the heat from the wall into the gas in W. Add it to the derivative of the gas energy, and the resulting
    temperature rate to that of the wall. ``hS`` is in W/K; ``mass_state`` and ``wall_state`` are indices in ``x``.

    A wall without heat capacity (0 J/K) keeps its initial temperature (`bench_sim.model.rest`).
    """
    heat = heat_inward(hS, x[wall_state], T)
    dx[mass_state + 2] += heat
    capacity = par.wall_heat_capacity[side]
    if capacity > 0.0:
        outer = par.wall_outer_heat_transfer[side]
        dx[wall_state] += wall_speed(heat, x[wall_state], outer, par.ambient_temperature, 1.0 / capacity)
    return heat


@compiled
def heat_term(x: Any, mem: Any, par: Any, out: Any, dx: Any) -> None:
    """Add the heat exchange of the four chambers with their walls: hS (T_w − T), hS = (hS)_ref (ρ/ρ_ref)^n."""
    for i in range(2):
        density = x[State.BELLOWS_MASS + i] / out[Algebraic.VOLUME + i]
        factor = density_factor(density, mem.heat_density[i], mem.heat_factor[i], par)
        out[Algebraic.HEAT + i] = wall_heat(
            x,
            par,
            i,
            State.BELLOWS_MASS + i,
            State.BELLOWS_WALL + i,
            out[Algebraic.TEMPERATURE + i],
            par.bellows_heat_transfer[i] * factor,
            dx,
        )
        density = x[State.AUXILIARY_MASS + i] / par.auxiliary_volume[i]
        factor = density_factor(density, mem.heat_density[2 + i], mem.heat_factor[2 + i], par)
        out[Algebraic.AUXILIARY_HEAT + i] = wall_heat(
            x,
            par,
            i,
            State.AUXILIARY_MASS + i,
            State.AUXILIARY_WALL + i,
            out[Algebraic.AUXILIARY_TEMPERATURE + i],
            par.auxiliary_heat_transfer[i] * factor,
            dx,
        )


@compiled
def note_densities(x: Any, mem: Any, par: Any, out: Any) -> None:
    """At the start of a step, store the density of each chamber and its factor (`density_factor`), if the density has
    changed by more than a thousandth.
    """
    for i in range(2):
        keep_density(mem, par, i, x[State.BELLOWS_MASS + i] / out[Algebraic.VOLUME + i])
        keep_density(mem, par, 2 + i, x[State.AUXILIARY_MASS + i] / par.auxiliary_volume[i])


@compiled
def has_moved(density: float, known: float) -> bool:
    """Return whether a density differs from the ``known`` density by more than a thousandth."""
    return bool(abs(density - known) > 1e-3 * density)


@compiled
def keep_density(mem: Any, par: Any, chamber: int, density: float) -> None:
    """Store a density and compute its factor, if it differs from the stored density by more than a thousandth."""
    if has_moved(density, mem.heat_density[chamber]):
        mem.heat_density[chamber] = density
        mem.heat_factor[chamber] = (density / par.heat_reference_density) ** par.heat_density_exponent
