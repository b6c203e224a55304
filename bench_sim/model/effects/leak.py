"""A hole in a bellows: air leaves it like an orifice, choked at these pressures.

    G = C ρ₀ p √(T₀/T) · iso(p_atm/p),   C = A ψ_c/(ρ₀ √(R T₀)),   ψ_c = 0.6847

A is the effective area of the hole and C its sonic conductance (ISO 6358), which passes the same choked flow as an
ideal nozzle of area A: 0.1 mm² is 1.99e-10 m³/(s·Pa). Above twice the atmosphere ln p falls on a straight line with
the time constant V/(C ρ₀ √(T₀/T) R T). Source: ISO 6358-1:2013; sizes assumed (0.1 mm² costs the 100
litres of a spring and its chamber 37 mbar a minute at AW0 and held height).
"""

from collections.abc import Mapping
from math import sqrt
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, springs
from bench_sim.model.iso6358 import ISO_DENSITY, ISO_TEMPERATURE

#: ψ of a choked nozzle for κ = 1.4.
CHOKED: Final = 0.6847


def sonic_conductance(area: float, gas_constant: float) -> float:
    """C in m³/(s·Pa) of a hole with the effective ``area`` in m²."""
    return area * CHOKED / (ISO_DENSITY * sqrt(gas_constant * ISO_TEMPERATURE))


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.leak_conductance[springs(place)] += sonic_conductance(values["area"], float(par.gas_constant))


EFFECT: Final = Effect(
    name="leak",
    family="gas",
    title="leak of a bellows (orifice)",
    plain="the {side} bellows leaks through an orifice",
    amplitude=EffectParameter("area", "m2", "mm2", 1e-6, nominal=0.0, typical=0.1e-6, low=0.0, high=20e-6),
    change=_change,
    places=PLACES,
    touches=frozenset({"gas"}),
    confusers=("leak_laminar", "heat", "creep", "pressure_drift"),
    phenomenon="a leak of the {side} bellows",
    equation="G = C ρ₀ p √(T₀/T) iso(p_atm/p), C = 0.6847 A/(ρ₀ √(R T₀))",
    source="ISO 6358-1; sizes assumed",
    separated_by="hold at two pressures, leveling valve isolated: the mass pV/(RT) goes on falling, ln p on a line",
    loses_air=True,
)
