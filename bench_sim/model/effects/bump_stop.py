"""A lateral stop that the model does not know: linear beyond a gap.

    F_y = −k max(|y| − g, 0) sign(y),   y = y_B − y_P

on the bolster (or the car body), at the height of the lateral bump stop, beside it. Linear in k, so that a small
stop leaves a small trace; none where the gap is not used up. Source: geometry; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    if values["stiffness"] != 0.0:
        par.extra_stop_stiffness += values["stiffness"]
        par.extra_stop_gap = values["gap"]


EFFECT: Final = Effect(
    name="bump_stop",
    family="rubber",
    title="lateral bump stop",
    plain="the bolster hits a lateral bump stop",
    amplitude=EffectParameter("stiffness", "N/m", "kN/m", 1e3, nominal=0.0, typical=1e5, low=0.0, high=1e7),
    change=_change,
    shapes=(EffectParameter("gap", "m", "mm", 1e-3, nominal=10e-3, typical=10e-3, low=0.0, high=60e-3),),
    grid=((4e-3,), (8e-3,), (12e-3,), (16e-3,), (22e-3,)),
    touches=frozenset({"force"}),
    confusers=("friction", "area_slope"),
    equation="F_y = −k max(|y|−g, 0) sign y",
    source="geometry; sizes assumed",
    separated_by="slow lateral sine of growing amplitude: a knee in F_y(y), third harmonic, no loss",
)
