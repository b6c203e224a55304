"""Heat passes between gas and walls better or worse than assumed.

    hS ← (1 + e) hS

in all four chambers. It shifts the frequency at which the gas turns from isothermal to adiabatic, and the time
constant m c_v/(hS) with which pressure settles after a step. Source: the base model's own heat exchange, whose size
is assumed (published transitions lie between 0.001 and 0.1 Hz: Pelz & Buttenbender 2004).
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.bellows_heat_transfer[:] *= 1.0 + values["change"]
    par.auxiliary_heat_transfer[:] *= 1.0 + values["change"]


EFFECT: Final = Effect(
    name="heat",
    family="gas",
    title="heat exchange with the walls",
    plain="the walls exchange more or less heat than assumed",
    amplitude=EffectParameter("change", "1", "%", 0.01, nominal=0.0, typical=0.5, low=-0.95, high=9.0),
    change=_change,
    touches=frozenset({"gas"}),
    confusers=("leak", "leak_laminar", "creep"),
    equation="hS ← (1+e) hS",
    source="published transitions 0.001 to 0.1 Hz (Pelz & Buttenbender 2004); size assumed",
    separated_by="hold after a step: an exponential of 10 to 20 s that ends; slow sine from 0.003 to 0.1 Hz",
)
