"""Quantisation: force and pressure channels have coarse converters, steps of a share of their range.

Readings jump with the step, so that nothing is differentiable in it: the rig can be given this effect, a diagnosis sees
it as noise.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from bench_sim.model.effects.channels import FORCES, PRESSURES
from bench_sim.model.effects.effect import Effect, EffectParameter


def _change(par: Any, place: int | None, values: Mapping[str, float]) -> None:
    channels = [*FORCES, *PRESSURES]
    span = par.sensor_high[channels] - par.sensor_low[channels]
    par.sensor_resolution[channels] = np.maximum(par.sensor_resolution[channels], values["step"] * span)


EFFECT: Final = Effect(
    name="quantisation",
    family="acquisition",
    title="coarse converters of forces and pressures",
    plain="the converters of forces and pressures are coarse",
    amplitude=EffectParameter("step", "1", "%", 0.01, nominal=0.0, typical=2.0**-12, low=0.0, high=0.01),
    change=_change,
    touches=frozenset({"sensor"}),
    equation="s_m = q ⌊s/q + ½⌋,  q = step · range",
    source="12 bits are a step of 0.024 % of the range",
    separated_by="a histogram of the readings at rest",
    smooth=False,
)
