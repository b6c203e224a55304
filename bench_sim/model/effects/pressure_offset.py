"""Pressure offset: the transmitter of one bellows is off zero, p_m = p + b."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import BELLOWS_BY_SIDE
from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.sensor_bias[BELLOWS_BY_SIDE[place]] += values["offset"]


EFFECT: Final = Effect(
    name="pressure_offset",
    family="sensor",
    title="zero error of the pressure transmitter of one bellows",
    plain="the {side} pressure transmitter has a zero error",
    amplitude=EffectParameter("offset", "Pa", "mbar", 100.0, nominal=0.0, typical=10e3, low=-1e5, high=1e5),
    change=_change,
    places=PLACES,
    touches=frozenset({"sensor"}),
    confusers=("force_offset", "pressure_drift"),
    equation="p_m = p + b",
    source="zero of a transmitter",
    separated_by="the vented bench; bellows and auxiliary chamber at rest, which have the same pressure",
)
