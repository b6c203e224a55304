"""Dirt blocks a part of the orifice of one spring.

    C_d ← (1 − e) C_d

on its side alone. With a fault it begins in the middle of a run (`astb rig fault`). Source: swarf and rubber crumbs in
the pipe; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter, springs


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.discharge_coefficient[springs(place)] *= 1.0 - values["share"]


EFFECT: Final = Effect(
    name="blocked_orifice",
    family="flow",
    title="partly blocked orifice of one spring",
    plain="the orifice of the {side} spring is partly blocked",
    amplitude=EffectParameter("share", "1", "%", 0.01, nominal=0.0, typical=0.1, low=0.0, high=0.99),
    change=_change,
    places=PLACES,
    touches=frozenset({"flow"}),
    confusers=("discharge", "asymmetric_orifice"),
    equation="C_d ← (1 − e) C_d on one side",
    source="swarf in the pipe; sizes assumed",
    separated_by="sine around 1 Hz: the damping of the two springs parts",
)
