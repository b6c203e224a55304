"""Emergency-spring compliance: the rubber stack in series gives way more or less, 1/k = (1+e)/k₀ in both directions."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.emergency_stiffness_vertical /= 1.0 + values["error"]
    par.emergency_stiffness_lateral /= 1.0 + values["error"]


EFFECT: Final = Effect(
    name="emergency_compliance",
    family="rig",
    title="emergency springs are softer or harder than assumed",
    plain="the emergency springs are softer or harder than assumed",
    amplitude=EffectParameter("error", "1", "%", 0.01, nominal=0.0, typical=0.3, low=-0.8, high=4.0),
    change=_change,
    touches=frozenset({"force"}),
    confusers=("frame_compliance", "bellows_volume"),
    equation="ζ_b = ζ + (1+e) (F_z − P)/k₀,  y_b = y + (1+e) F_y/k₀",
    source="layered rubber; static and dynamic stiffness differ by up to a half",
    separated_by="laser across the spring: the frame's compliance is not seen there; both load cases",
)
