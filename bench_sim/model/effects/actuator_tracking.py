"""Actuator tracking: the actuators follow their commands with another natural frequency, ω = (1+e) ω₀.

A replay of the measured motion starts from what the actuators did and not from their commands: it cannot show this.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter, ShownBy


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.actuator_frequency *= 1.0 + values["error"]


EFFECT: Final = Effect(
    name="actuator_tracking",
    family="rig",
    title="actuators follow faster or slower than assumed",
    plain="the actuators follow faster or slower than assumed",
    amplitude=EffectParameter("error", "1", "%", 0.01, nominal=0.0, typical=-0.3, low=-0.8, high=1.0),
    change=_change,
    touches=frozenset({"timing"}),
    confusers=("frame_compliance",),
    equation="q̈ = ω² (q_set − q) − 2ζω q̇,  ω = (1+e) ω₀",
    source="servo valve and supply pressure set the bandwidth",
    separated_by="command against displacement in a sweep",
    shown_by=ShownBy.COMMANDS,
)
