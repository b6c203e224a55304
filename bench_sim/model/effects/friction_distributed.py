"""Friction in the rubber that gives way in two stages: two Berg elements with different travels.

    F = s F_max f(x; x_2,a) + (1−s) F_max f(x; x_2,b)

f as in `bench_sim.model.effects.friction`, which it contains with a share s of one. The two elements stand for the
spread of sliding limits that a bank of Jenkins elements has. Source: Iwan, J. Appl. Mech. 33 (1966) 893; Berg 1998;
sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.model.effects.friction import add_friction


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_friction(par, values["force"] * values["share"], values["travel_short"])
    add_friction(par, values["force"] * (1.0 - values["share"]), values["travel_long"])


EFFECT: Final = Effect(
    name="friction_distributed",
    family="rubber",
    title="distributed friction of the rubber",
    plain="the rubber has distributed friction",
    amplitude=EffectParameter("force", "N", "N", 1.0, nominal=0.0, typical=300.0, low=0.0, high=1e4),
    change=_change,
    shapes=(
        EffectParameter(
            "travel_short", "m", "mm", 1e-3, nominal=1e-3, typical=1e-3, low=1e-4, high=0.03, logarithmic=True
        ),
        EffectParameter(
            "travel_long", "m", "mm", 1e-3, nominal=8e-3, typical=8e-3, low=1e-4, high=0.03, logarithmic=True
        ),
        EffectParameter("share", "1", "1", 1.0, nominal=0.5, typical=0.5, low=0.0, high=1.0),
    ),
    grid=((0.3e-3, 3e-3, 0.5), (1e-3, 8e-3, 0.5), (2e-3, 20e-3, 0.5)),
    touches=frozenset({"force"}),
    confusers=("friction", "maxwell", "fractional"),
    phenomenon="friction of the rubber",
    equation="F = F_max (s f(x; x_2,a) + (1−s) f(x; x_2,b))",
    source="Iwan 1966, Berg 1998; sizes assumed",
    separated_by="one frequency at amplitudes from 0.2 to 20 mm",
)
