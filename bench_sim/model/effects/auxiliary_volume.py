"""The auxiliary chamber holds more or less air than its drawing says.

    V_a ← (1 + e) V_a

in both springs. Source: the base model's own volume, which is assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.auxiliary_volume[:] *= 1.0 + values["change"]


EFFECT: Final = Effect(
    name="auxiliary_volume",
    family="gas",
    title="volume of the auxiliary chamber",
    plain="the auxiliary chambers hold more or less air than assumed",
    amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.1, low=-0.5, high=1.0),
    change=_change,
    touches=frozenset({"gas"}),
    confusers=("bellows_volume", "compliance", "discharge"),
    equation="V_a ← (1+e) V_a",
    source="size assumed",
    separated_by="slow sine, 0.1 Hz: K of both chambers together gives V_a + V_b",
)
