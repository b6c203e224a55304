"""Sample and hold: pressures are refreshed only every T, p_m(t) = p(t − a (t mod T)); with a = 1 they are held between.

Between 0 and 1 their age grows more slowly than time, which makes the readings smooth in a at 0.
"""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.pressure_hold += values["hold"]
    if values["hold"] > 0.0:
        par.pressure_hold_period = values["period"]


EFFECT: Final = Effect(
    name="sample_and_hold",
    family="acquisition",
    title="pressures are held between infrequent samples",
    plain="the pressures are held between infrequent samples",
    amplitude=EffectParameter("hold", "1", "%", 0.01, nominal=0.0, typical=1.0, low=0.0, high=1.0),
    change=_change,
    shapes=(
        EffectParameter(
            "period", "s", "ms", 1e-3, nominal=0.05, typical=0.05, low=0.01, high=0.2, logarithmic=True
        ),
    ),
    grid=((0.02,), (0.05,), (0.1,)),
    touches=frozenset({"sensor", "timing"}),
    confusers=("pressure_latency", "pressure_lag"),
    phenomenon="a delay of the pressure readings",
    equation="p_m(t) = p(t − a (t mod T))",
    source="a module that converts or polls more rarely than it sends",
    separated_by="a fast motion sampled at 200 Hz: stairs",
)
