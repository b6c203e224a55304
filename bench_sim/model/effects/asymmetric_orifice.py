"""The orifice passes more in one direction than in the other.

    C_d ← (1 + e) C_d out of the bellows, (1 − e) C_d into it

in both springs. Oscillating, the chambers part: as much mass must flow out as in, so the mean of p_b − p_a moves
against e, in proportion to the square of the motion, and its even harmonics change. Source: one edge sharp, the other
rounded or burred; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.orifice_asymmetry[:] += values["asymmetry"]


EFFECT: Final = Effect(
    name="asymmetric_orifice",
    family="flow",
    title="orifice with a direction",
    plain="the orifice lets air through better in one direction",
    amplitude=EffectParameter("asymmetry", "1", "%", 0.01, nominal=0.0, typical=0.08, low=-0.8, high=0.8),
    change=_change,
    touches=frozenset({"flow"}),
    confusers=("pressure_offset", "discharge"),
    equation="C_d ← (1 ± e) C_d",
    source="one edge sharp, one rounded; sizes assumed",
    separated_by="sine of 10 to 15 mm at 1 to 2 Hz: mean of p_b − p_a, even harmonics",
)
