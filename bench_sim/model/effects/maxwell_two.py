"""Two relaxations of the rubber that the model's branches leave out.

    K(iω) = r k_sh (s iωτ₁/(1 + iωτ₁) + (1−s) iωτ₂/(1 + iωτ₂))

as `bench_sim.model.effects.maxwell`, which it contains with a share s of one. Source: as there; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.model.effects.maxwell import add_branch


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_branch(par, values["ratio"] * values["share"], values["time_fast"])
    add_branch(par, values["ratio"] * (1.0 - values["share"]), values["time_slow"])


_PAIRS = ((0.01, 0.1), (0.03, 0.3), (0.1, 1.0), (0.3, 3.0), (1.0, 10.0), (0.03, 3.0))

EFFECT: Final = Effect(
    name="maxwell_two",
    family="rubber",
    title="two Maxwell branches of the rubber",
    plain="the rubber relaxes like two Maxwell branches",
    amplitude=EffectParameter("ratio", "1", "1", 1.0, nominal=0.0, typical=0.5, low=0.0, high=5.0),
    change=_change,
    shapes=(
        EffectParameter(
            "time_fast", "s", "s", 1.0, nominal=0.1, typical=0.1, low=0.005, high=30.0, logarithmic=True
        ),
        EffectParameter(
            "time_slow", "s", "s", 1.0, nominal=1.0, typical=1.0, low=0.005, high=30.0, logarithmic=True
        ),
        EffectParameter("share", "1", "1", 1.0, nominal=0.5, typical=0.5, low=0.0, high=1.0),
    ),
    grid=tuple((fast, slow, 0.5) for fast, slow in _PAIRS),
    touches=frozenset({"force"}),
    confusers=("friction", "maxwell", "fractional"),
    phenomenon="relaxation of the rubber",
    equation="F = r k_sh (s q₁ + (1−s) q₂), dq_j/dt = dx/dt − q_j/τ_j",
    source="generalised Maxwell model of filled rubber (Lion & Kardelky 2004); sizes assumed",
    separated_by="one amplitude from 0.05 to 10 Hz: the loss has two peaks; hold after a step",
)
