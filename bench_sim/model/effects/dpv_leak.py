"""The differential pressure valve does not close: its seat leaks.

    G = C ρ₀ p₁ √(T₀/T₁) iso(p₂/p₁) between the auxiliary chambers, at any difference,   C = A ψ_c/(ρ₀ √(R T₀))

while the valve is connected; A as in `bench_sim.model.effects.leak`. A difference between left and right decays to
zero. Source: ISO 6358-1; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter, ShownBy
from bench_sim.model.effects.leak import sonic_conductance


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.dpv_leak += sonic_conductance(values["area"], float(par.gas_constant))


EFFECT: Final = Effect(
    name="dpv_leak",
    family="flow",
    title="leaking differential pressure valve",
    plain="the differential pressure valve leaks",
    amplitude=EffectParameter("area", "m2", "mm2", 1e-6, nominal=0.0, typical=1e-6, low=0.0, high=50e-6),
    change=_change,
    touches=frozenset({"gas", "flow"}),
    confusers=("leak", "leak_laminar"),
    equation="G = C ρ₀ p₁ √(T₀/T₁) iso(p₂/p₁) between the auxiliary chambers",
    source="ISO 6358-1; sizes assumed",
    separated_by="hold with unequal pressures, valve connected and isolated: one side loses what the other gains",
    shown_by=ShownBy.CONNECTED_VALVES,
)
