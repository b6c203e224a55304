"""Platen inertia: the load cells also accelerate what lies on them, F_m = F + m a_P, as the platform moves.

A rig that compensates it, or whose platform rests, does not show it.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.platen_mass += values["mass"]


EFFECT: Final = Effect(
    name="platen_inertia",
    family="rig",
    title="load cells measure the platform's inertia",
    plain="the load cells measure the platform's inertia",
    amplitude=EffectParameter("mass", "kg", "kg", 1.0, nominal=0.0, typical=100.0, low=0.0, high=2000.0),
    change=_change,
    touches=frozenset({"sensor"}),
    confusers=("force_lag", "force_latency"),
    equation="F_z,m = F_z + m z̈_P,  F_y,m = F_y + m ÿ_P",
    source="Newton",
    separated_by="the platform shaken without spring: force grows with ω²",
)
