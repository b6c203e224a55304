"""The bellows stretches under pressure: its volume grows with it.

    V = V_b(ζ, y) + C_V (p − p_ref),   p (V_b + C_V (p − p_ref)) = (κ−1) U

solved for p in closed form; p_ref is the pressure of the load case, so that rest is as without it. The stretched wall
stores energy, ½ C_V (p − p_ref)² beyond its preload, and takes none; the force p_g ∂V_b/∂ζ is the same function of
the pressure. A closed bellows has K = κ p A²/(V + κ C_V p) − p_g A_1, softer, and the more so the higher p is, which
no wrong volume can imitate under two loads. Source: 0.25 to 1 litre per bar assumed; Kuzyshyn et al. (2024) measured an
area that grows with pressure, a related effect that is not this one.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.bellows_compliance[:] += values["compliance"]


EFFECT: Final = Effect(
    name="compliance",
    family="gas",
    title="radial compliance of the bellows",
    plain="the bellows widen under pressure",
    amplitude=EffectParameter(
        "compliance", "m3/Pa", "litre/bar", 1e-8, nominal=0.0, typical=0.25e-8, low=0.0, high=4e-8
    ),
    change=_change,
    touches=frozenset({"gas"}),
    confusers=("bellows_volume", "area_slope"),
    equation="V = V_b(ζ,y) + C_V (p − p_ref)",
    source="size assumed",
    separated_by="fast sine at AW0 and at AW3: the loss of stiffness grows with the load",
)
