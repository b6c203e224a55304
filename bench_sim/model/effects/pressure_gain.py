"""Pressure gain: all transmitters read too much in proportion, p_m = (1+g) p."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import PRESSURES
from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.sensor_gain[PRESSURES] += values["gain"]


EFFECT: Final = Effect(
    name="pressure_gain",
    family="sensor",
    title="wrong gain of the pressure transmitters",
    plain="the pressure transmitters have a wrong gain",
    amplitude=EffectParameter("gain", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.2, high=0.2),
    change=_change,
    touches=frozenset({"sensor"}),
    confusers=("force_gain", "area_slope"),
    equation="p_m = (1+g) p",
    source="span error of a transmitter",
    separated_by="a reference gauge, or a known mass: without one it is not told from a wrong effective area",
)
