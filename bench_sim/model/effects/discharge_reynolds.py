"""The orifice passes less at small flows.

    C_d = C_d∞/(1 + k/√Re),   Re = 4|G|/(π d μ)

the customary C_d∞ (1 − k/√Re) where that is close to C_d∞, and positive where the flow turns. Re is that of the flow
with C_d∞. It breaks the rule f_peak √a = const of the damping maximum. Source: boundary layer of nozzles and short
holes (ISO 5167, Re^−½ of the nozzle); at 5 mm and 1.2 Hz Re is about 1.4e5, and k = 20 takes 5 %. Sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.orifice_reynolds[:] += values["k"]


EFFECT: Final = Effect(
    name="discharge_reynolds",
    family="flow",
    title="discharge that falls with the Reynolds number",
    plain="the orifice lets through less at low Reynolds numbers",
    amplitude=EffectParameter("k", "1", "1", 1.0, nominal=0.0, typical=20.0, low=0.0, high=300.0),
    change=_change,
    touches=frozenset({"flow"}),
    confusers=("discharge", "pipe_inertia"),
    phenomenon="another discharge of the orifice",
    equation="C_d = C_d∞/(1 + k/√Re)",
    source="boundary layer of nozzles and short holes (ISO 5167); sizes assumed",
    separated_by="sine at 1 Hz with amplitudes from 0.5 to 15 mm: f_peak √a",
)
