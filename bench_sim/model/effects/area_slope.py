"""The effective area changes with height otherwise than assumed.

    A_1 ← A_1 + e,   A_e = A_0 + A_1 ζ

in both springs: a stiffness −p_g e, without loss, at any frequency. Source: isobaric test of EN 13597; the base
model's own slope is assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.effective_area_slope[:] += values["slope"]


EFFECT: Final = Effect(
    name="area_slope",
    family="gas",
    title="slope of the effective area",
    plain="the effective area changes with height",
    amplitude=EffectParameter("slope", "m", "m", 1.0, nominal=0.0, typical=0.1, low=-0.2, high=0.2),
    change=_change,
    touches=frozenset({"force", "gas"}),
    confusers=("compliance", "force_gain", "bellows_volume"),
    equation="A_e = A_0 + (A_1 + e) ζ",
    source="EN 13597, isobaric test; size assumed",
    separated_by="heights held at constant pressure: F/p_g against ζ",
)
