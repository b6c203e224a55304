"""Pressure drift: the transmitter of one bellows wanders, p_m = p + r t, with t from the start of the rig."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import BELLOWS_BY_SIDE
from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter

_MBAR_PER_HOUR: Final = 100.0 / 3600.0


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.sensor_drift[BELLOWS_BY_SIDE[place]] += values["rate"]


EFFECT: Final = Effect(
    name="pressure_drift",
    family="sensor",
    title="pressure transmitter of one bellows drifts",
    plain="the {side} pressure transmitter drifts",
    amplitude=EffectParameter(
        "rate",
        "Pa/s",
        "mbar/h",
        _MBAR_PER_HOUR,
        nominal=0.0,
        typical=100.0 * _MBAR_PER_HOUR,
        low=-3000.0 * _MBAR_PER_HOUR,
        high=3000.0 * _MBAR_PER_HOUR,
    ),
    change=_change,
    places=PLACES,
    touches=frozenset({"sensor"}),
    confusers=("leak", "leak_laminar", "heat"),
    equation="p_m = p + r t",
    source="warming-up and ageing of a transmitter; assumed linear in time",
    separated_by="a long hold: the force and the auxiliary chamber do not follow; zero vented before and after",
)
