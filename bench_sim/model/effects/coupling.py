"""Coupling: the spring's roll couples more or less with its lateral force than assumed, K_yφ = (1+e) K_yφ,0."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.coupling_sign *= 1.0 + values["error"]


EFFECT: Final = Effect(
    name="coupling",
    family="rig",
    title="lateral-roll coupling differs from the assumed one",
    plain="the coupling between shear and roll is not the assumed one",
    amplitude=EffectParameter("error", "1", "%", 0.01, nominal=0.0, typical=0.3, low=-1.0, high=2.0),
    change=_change,
    touches=frozenset({"force"}),
    confusers=("crosstalk",),
    equation="F_y −= σ K_yφ φ_s tanh(θ/φ_s),  M −= σ K_yφ y sech²(θ/φ_s)",
    source="Facchinetti, Mazzola, Alfi and Bruni 2010: shear and roll of an air spring act on each other",
    separated_by="lateral sweeps at fixed roll angles: odd in the angle, with a reciprocal moment",
)
