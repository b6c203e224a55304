"""Friction in the rubber beyond the spring's own: one more Berg element.

    F = F_s + (x − x_s)/(x_2 (1 − α) + (x − x_s)) · (F_max − F_s),   x > x_s, and the same with the signs turned

in both directions of both springs; x is the bellows' displacement, α = F_s/F_max at the last reversal. It turns where
the spring's own friction turns. Its loop does not depend on the rate; loss per cycle, large against x_2: 4 F_max x_0.
Source: Berg, Veh. Syst. Dyn. 30 (1998) 197; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.model.effects.slots import free_slots


def add_friction(par: Any, force: float, travel: float) -> None:
    """Append a Berg element of ``force`` N with x_2 = ``travel`` m; none where the force is 0."""
    if force != 0.0:
        slot = free_slots(par.extra_friction, 1, "extra friction elements")
        par.extra_friction[slot] = force
        par.extra_friction_travel[slot] = travel


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_friction(par, values["force"], values["travel"])


EFFECT: Final = Effect(
    name="friction",
    family="rubber",
    title="Berg friction of the rubber",
    plain="the rubber has Berg friction",
    amplitude=EffectParameter("force", "N", "N", 1.0, nominal=0.0, typical=200.0, low=0.0, high=1e4),
    change=_change,
    shapes=(
        EffectParameter(
            "travel", "m", "mm", 1e-3, nominal=3e-3, typical=3e-3, low=1e-4, high=0.03, logarithmic=True
        ),
    ),
    grid=((0.5e-3,), (1.5e-3,), (5e-3,), (15e-3,)),
    touches=frozenset({"force"}),
    confusers=("maxwell", "fractional", "force_lag"),
    richer=("friction_distributed",),
    phenomenon="friction of the rubber",
    equation="F = F_s + (x−x_s)/(x_2(1−α) + x−x_s) · (F_max−F_s)",
    source="Berg 1998; sizes assumed",
    separated_by="quasi-static loop at two speeds (same width), and one frequency at several amplitudes",
)
