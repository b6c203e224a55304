"""Frame compliance: frame and oil give way more than assumed, 1/k = 1/k₀ + c: piston minus bolster grows by c F."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.frame_stiffness /= 1.0 + values["compliance"] * par.frame_stiffness


EFFECT: Final = Effect(
    name="frame_compliance",
    family="rig",
    title="frame is softer than assumed",
    plain="the frame is softer than assumed",
    amplitude=EffectParameter(
        "compliance", "m/N", "mm/kN", 1e-6, nominal=0.0, typical=1e-8, low=0.0, high=1e-6
    ),
    change=_change,
    touches=frozenset({"sensor"}),
    confusers=("emergency_compliance",),
    equation="d_piston − d_bolster = (1/k₀ + c) F",
    source="bolted joints, oil column",
    separated_by="laser across the spring against the transducer in the actuator",
)
