"""The orifice passes more or less than its drawing says.

    C_d ← (1 + e) C_d

in both springs. Only C_d d² can be told from dynamics, never the two factors. Source: the base model's own
coefficient, which is assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.discharge_coefficient[:] *= 1.0 + values["change"]


EFFECT: Final = Effect(
    name="discharge",
    family="flow",
    title="discharge coefficient of the orifice",
    plain="the orifice lets through more or less than assumed",
    amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.05, low=-0.5, high=0.6),
    change=_change,
    touches=frozenset({"flow"}),
    confusers=("discharge_reynolds", "auxiliary_volume", "bellows_volume"),
    richer=("discharge_reynolds", "asymmetric_orifice"),
    phenomenon="another discharge of the orifice",
    equation="C_d ← (1+e) C_d",
    source="size assumed",
    separated_by="sine around 1 Hz: frequency of the damping maximum, at two amplitudes",
)
