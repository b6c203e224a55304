"""Sensor gain: the sensors of one kind read too much in proportion, s_m = (1+g) s."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

from bench_sim.model.effects.channels import FORCES, PRESSURES
from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(sensors: Sequence[int], par: Any, place: int | None, values: Mapping[str, float]) -> None:
    par.sensor_gain[sensors] += values["gain"]


EFFECTS: Final = (
    Effect(
        name="force_gain",
        family="sensor",
        title="wrong gain of load cells and force transducers",
        plain="load cells and force transducers have a wrong gain",
        amplitude=EffectParameter("gain", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.2, high=0.2),
        change=partial(_change, FORCES),
        touches=frozenset({"sensor"}),
        confusers=("pressure_gain",),
        equation="F_m = (1+g) F",
        source="calibration of a strain-gauge chain",
        separated_by="a known mass: without a reference it is not told from a wrong effective area",
    ),
    Effect(
        name="pressure_gain",
        family="sensor",
        title="wrong gain of the pressure transmitters",
        plain="the pressure transmitters have a wrong gain",
        amplitude=EffectParameter("gain", "1", "%", 0.01, nominal=0.0, typical=0.01, low=-0.2, high=0.2),
        change=partial(_change, PRESSURES),
        touches=frozenset({"sensor"}),
        confusers=("force_gain", "area_slope"),
        equation="p_m = (1+g) p",
        source="span error of a transmitter",
        separated_by="a reference gauge, or a known mass: without one it is not told from a wrong effective area",
    ),
)
