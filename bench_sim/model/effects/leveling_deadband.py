"""The leveling valve opens earlier or later than it should.

    δ ← δ + e

in both valves; the hysteresis stays. While a valve stays open its opening, (|x| − δ + δ_h)/Δ, is smooth in e; whether
and when it opens is not. Source: adjustment and wear; size assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter, ShownBy


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.leveling_deadband[:] += values["change"]


EFFECT: Final = Effect(
    name="leveling_deadband",
    family="flow",
    title="deadband of the leveling valves",
    plain="the leveling valves have another deadband",
    amplitude=EffectParameter("change", "m", "mm", 1e-3, nominal=0.0, typical=2e-3, low=-3e-3, high=20e-3),
    change=_change,
    touches=frozenset({"flow"}),
    confusers=("leveling_delay", "leak"),
    equation="δ ← δ + e",
    source="adjustment and wear; size assumed",
    separated_by="slow height ramp through both ends of the dead zone, valves connected",
    shown_by=ShownBy.CONNECTED_VALVES,
)
