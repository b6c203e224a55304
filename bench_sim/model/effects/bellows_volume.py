"""The bellows at design height holds more or less air than its drawing says.

    V_b ← (1 + e) V_b

in both springs. Source: the base model's own volume, which is assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.bellows_volume[:] *= 1.0 + values["change"]


EFFECT: Final = Effect(
    name="bellows_volume",
    family="gas",
    title="volume of the bellows",
    plain="the bellows hold more or less air than assumed",
    amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.1, low=-0.5, high=1.0),
    change=_change,
    touches=frozenset({"gas"}),
    confusers=("auxiliary_volume", "compliance", "discharge"),
    equation="V_b ← (1+e) V_b",
    source="size assumed",
    separated_by="fast sine, 10 to 20 Hz: K of the closed bellows gives V_b; same error at AW0 and AW3",
)
