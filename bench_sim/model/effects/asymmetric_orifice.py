"""The orifice passes more in one direction than in the other.

    C_d ← (1 + e) C_d out of the bellows, (1 − e) C_d into it

in both springs. Oscillating, the chambers part: with equal masses out and in, the mean of p_b − p_a is negative for
e > 0, as is the second harmonic's size changed. Source: one edge sharp, the other rounded or burred; sizes assumed.
"""

from collections.abc import Mapping
from typing import Any

from bench_sim.model.effects.effect import Effect, Quantity


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.orifice_asymmetry[:] += values["asymmetry"]


EFFECT = Effect(
    name="asymmetric_orifice",
    family="flow",
    title="orifice with a direction",
    amplitude=Quantity("asymmetry", "1", "%", 0.01, 0.0, 0.08, -0.8, 0.8),
    change=_change,
    touches=frozenset({"flow"}),
    confusers=("pressure_offset", "discharge"),
    equation="C_d ← (1 ± e) C_d",
    source="one edge sharp, one rounded; sizes assumed",
    separated_by="sine of 10 to 15 mm at 1 to 2 Hz: mean of p_b − p_a, even harmonics",
)
