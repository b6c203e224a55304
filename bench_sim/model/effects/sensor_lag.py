"""Sensor lag: the sensors of one kind, or the tubes to them, are slow, H = 1/(1 + (τ₀+τ)s) instead of 1/(1 + τ₀s).

Discretised for inputs along cubics through the samples (`bench_sim.model.sensors`): the readings are smooth in τ
however short it is against the step.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

from bench_sim.model.effects.channels import FORCES, PRESSURES
from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(sensors: Sequence[int], par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.sensor_lag[sensors] += values["lag"]


EFFECTS: Final = (
    Effect(
        name="force_lag",
        family="sensor",
        title="load cells and force transducers lag behind",
        plain="load cells and force transducers lag behind",
        amplitude=EffectParameter("lag", "s", "ms", 1e-3, nominal=0.0, typical=5e-3, low=0.0, high=0.1),
        change=partial(_change, FORCES),
        touches=frozenset({"sensor"}),
        confusers=("force_latency", "maxwell", "fractional"),
        phenomenon="a delay of the force readings",
        equation="τ dF_m/dt + F_m = F",
        source="first-order low-pass of a strain-gauge amplifier",
        separated_by="steel block or known mass instead of the spring; large sines up to 12.5 Hz",
    ),
    Effect(
        name="pressure_lag",
        family="sensor",
        title="pressure transmitters lag behind",
        plain="the pressure transmitters lag behind",
        amplitude=EffectParameter("lag", "s", "ms", 1e-3, nominal=0.0, typical=10e-3, low=0.0, high=0.5),
        change=partial(_change, PRESSURES),
        touches=frozenset({"sensor"}),
        confusers=("pressure_latency", "sample_and_hold", "pipe_inertia"),
        phenomenon="a delay of the pressure readings",
        equation="τ dp_m/dt + p_m = p",
        source="first-order filter of a transmitter; a volume filled through a narrow tube",
        separated_by="5 to 12 Hz at small amplitude: the force keeps its phase, all pressures lag alike",
    ),
)
