"""Pressure latency: the pressures arrive late, p_m(t) = p(t − τ), as from a gateway that polls its transmitters."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.pressure_latency += values["delay"]


EFFECT: Final = Effect(
    name="pressure_latency",
    family="acquisition",
    title="pressures arrive late",
    plain="the pressures arrive late",
    amplitude=EffectParameter("delay", "s", "ms", 1e-3, nominal=0.0, typical=10e-3, low=0.0, high=0.1),
    change=_change,
    touches=frozenset({"sensor", "timing"}),
    confusers=("pressure_lag", "sample_and_hold", "clock_skew"),
    equation="p_m(t) = p(t − τ)",
    source="polling period of a fieldbus gateway",
    separated_by="large sines up to 12.5 Hz: a delay turns the phase and leaves the amplitude, a lag does both",
)
