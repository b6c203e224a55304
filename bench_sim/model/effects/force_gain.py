"""Force gain: load cells and force transducers read too much in proportion, F_m = (1+g) F."""

from collections.abc import Mapping
from typing import Any, Final

from bench_sim.model.effects.channels import FORCES
from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.sensor_gain[FORCES] += values["gain"]


EFFECT: Final = Effect(
    name="force_gain",
    family="sensor",
    title="wrong gain of load cells and force transducers",
    plain="load cells and force transducers have a wrong gain",
    amplitude=EffectParameter("gain", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.2, high=0.2),
    change=_change,
    touches=frozenset({"sensor"}),
    confusers=("pressure_gain",),
    equation="F_m = (1+g) F",
    source="calibration of a strain-gauge chain",
    separated_by="a known mass: without a reference it is not told from a wrong effective area",
)
