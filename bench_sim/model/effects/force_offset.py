"""Force offset: the load cells under one spring read too much, F_m = F + b, half of it on each of the two."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import CELLS_BY_SIDE
from bench_sim.model.effects.effect import PLACES, Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    assert place is not None
    par.sensor_bias[CELLS_BY_SIDE[place]] += 0.5 * values["offset"]


EFFECT: Final = Effect(
    name="force_offset",
    family="sensor",
    title="zero error of the load cells under one spring",
    plain="the load cells under the {side} spring have a zero error",
    amplitude=EffectParameter("offset", "N", "N", 1.0, nominal=0.0, typical=1000.0, low=-2e4, high=2e4),
    change=_change,
    places=PLACES,
    touches=frozenset({"sensor"}),
    confusers=("pressure_offset",),
    equation="F_m = F + b",
    source="zero of a strain-gauge bridge, tare not taken",
    separated_by="the empty, vented bench: what is read there is the offset",
)
