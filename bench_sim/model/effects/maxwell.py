"""A relaxation of the rubber that the model's branches leave out: one more Maxwell branch in the shell.

    F = r k_sh q,   dq/dt = dx/dt − q/τ,   K(iω) = r k_sh iωτ/(1 + iωτ)

vertical and lateral, in both springs, x being the bellows' displacement. Its loss per cycle at a given amplitude has
one peak, at ω = 1/τ; its force does not know the pressure. Source: generalised Maxwell model of filled rubber, e.g.
Lion & Kardelky, Int. J. Plasticity 20 (2004); sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter
from bench_sim.model.effects.slots import free_slots


def add_branch(par: Any, ratio: float, time: float) -> None:
    """Append a Maxwell branch of stiffness ``ratio`` k_sh and time constant ``time`` s; none where the ratio is 0."""
    if ratio != 0.0:
        slot = free_slots(par.extra_branch_ratio, 1, "extra Maxwell branches")
        par.extra_branch_ratio[slot] = ratio
        par.extra_branch_time[slot] = time


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    add_branch(par, values["ratio"], values["time"])


EFFECT: Final = Effect(
    name="maxwell",
    family="rubber",
    title="Maxwell branch of the rubber",
    plain="the rubber relaxes like a Maxwell branch",
    amplitude=EffectParameter("ratio", "1", "1", 1.0, nominal=0.0, typical=0.3, low=0.0, high=5.0),
    change=_change,
    shapes=(
        EffectParameter(
            "time", "s", "s", 1.0, nominal=0.3, typical=0.3, low=0.005, high=30.0, logarithmic=True
        ),
    ),
    grid=tuple((tau,) for tau in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)),
    touches=frozenset({"force"}),
    confusers=("friction", "fractional", "force_lag"),
    richer=("maxwell_two", "fractional"),
    phenomenon="relaxation of the rubber",
    equation="F = r k_sh q, dq/dt = dx/dt − q/τ",
    source="generalised Maxwell model of filled rubber (Lion & Kardelky 2004); sizes assumed",
    separated_by="one amplitude at several frequencies, and hold after a step: the loss peaks at 1/(2πτ)",
)
