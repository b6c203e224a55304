"""The lever of the leveling valve follows the height later than it should.

    dx_l/dt = (ζ − x_l)/(τ_LV + e)

in both valves. Smooth in e while the valve stays open. Source: makers state 3 ± 1 s for the dash-pot; size assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter, ShownBy


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.leveling_lag[:] += values["time"]


EFFECT: Final = Effect(
    name="leveling_delay",
    family="flow",
    title="delay of the leveling valves",
    plain="the leveling valves act late",
    amplitude=EffectParameter("time", "s", "s", 1.0, nominal=0.0, typical=1.0, low=-0.9, high=10.0),
    change=_change,
    touches=frozenset({"flow", "timing"}),
    confusers=("leveling_deadband",),
    equation="dx_l/dt = (ζ − x_l)/(τ_LV + e)",
    source="makers state 3 ± 1 s; size assumed",
    separated_by="height step beyond the dead zone, valves connected: when the flow begins and how it grows",
    shown_by=ShownBy.CONNECTED_VALVES,
)
