"""Pressure lag: the transmitters, or the tubes to them, are slow: H = 1/(1 + (τ₀+τ)s) instead of 1/(1 + τ₀s)."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import PRESSURES
from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.sensor_lag[PRESSURES] += values["lag"]


EFFECT: Final = Effect(
    name="pressure_lag",
    family="sensor",
    title="pressure transmitters lag behind",
    plain="the pressure transmitters lag behind",
    amplitude=EffectParameter("lag", "s", "ms", 1e-3, nominal=0.0, typical=10e-3, low=0.0, high=0.5),
    change=_change,
    touches=frozenset({"sensor"}),
    confusers=("pressure_latency", "sample_and_hold", "pipe_inertia"),
    equation="τ dp_m/dt + p_m = p",
    source="first-order filter of a transmitter; a volume filled through a narrow tube",
    separated_by="5 to 12 Hz at small amplitude: the force keeps its phase, all pressures lag alike",
)
