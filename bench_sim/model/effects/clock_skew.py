"""Clock skew: the pressures are timed by a slow clock of their own, so that they fall behind, p_m(t) = p(t − εt).

Time t runs from the start of the rig. Only the past can be delivered: a fast clock is the same as a slow one of all
other channels. The rig keeps 255 steps, 0.25 s at 1 ms; beyond that the pressures fall behind no further.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.pressure_clock_skew += values["skew"]


EFFECT: Final = Effect(
    name="clock_skew",
    family="acquisition",
    title="clock of the pressures is slow",
    plain="the clock of the pressures is slow",
    amplitude=EffectParameter("skew", "1", "ppm", 1e-6, nominal=0.0, typical=1e-4, low=0.0, high=2e-3),
    change=_change,
    touches=frozenset({"sensor", "timing"}),
    confusers=("pressure_latency", "pressure_lag"),
    equation="p_m(t) = p(t − εt)",
    source="crystals differ by 20 to 100 ppm",
    separated_by="the same motion at the start and at the end of a long recording",
)
