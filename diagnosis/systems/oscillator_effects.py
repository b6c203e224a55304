"""What an oscillator may have that its model lacks: springs, losses, rubber and its sensors; one entry for each cause.

An amplitude of 0 is absence, its ``spread`` the size that one expects. A ``shape`` (a time constant) has no meaning
without its amplitude; it is tried at the points of the ``grid``, then fitted. ``confusers`` are causes that leave a
similar trace, ``richer`` ones contain the effect as a special case.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from diagnosis.contracts import Hypothesis, Parameter


def _effect(
    name: str, unit: str, spread: float, *, family: str, low: float = -np.inf, **more: Any
) -> Hypothesis:
    amplitude = Parameter("amplitude", unit, 0.0, spread, low)
    return Hypothesis(name=name, family=family, title=name, amplitude=amplitude, **more)


def _time_constant(name: str, nominal: float) -> Parameter:
    return Parameter(name, "s", nominal, 1.5 * nominal, 0.01, 10.0, logarithmic=True)


_EFFECTS: Final = (
    _effect("cubic", "N/m³", 2e6, family="spring", confusers=("quadratic",), equation="F = a x³"),
    _effect("quadratic", "N/m²", 2e4, family="spring", equation="F = a x²"),
    _effect(
        "coulomb",
        "N",
        5.0,
        low=0.0,
        family="loss",
        confusers=("maxwell",),
        equation="F = a tanh(v/v_0)",
    ),
    _effect(
        "maxwell",
        "N/m",
        300.0,
        low=0.0,
        family="rubber",
        shapes=(_time_constant("tau", 0.1),),
        grid=((0.02,), (0.1,), (0.5,)),
        confusers=("coulomb",),
        richer=("maxwell_two",),
        phenomenon="relaxation of the rubber",
        equation="F = a (x − q), dq/dt = (x − q)/τ",
    ),
    _effect(
        "maxwell_two",
        "N/m",
        300.0,
        low=0.0,
        family="rubber",
        shapes=(
            _time_constant("tau", 0.05),
            Parameter("ratio", "1", 1.0, 1.0, 0.05, 20.0, logarithmic=True),
            _time_constant("tau_two", 0.5),
        ),
        grid=((0.03, 1.0, 0.3), (0.03, 1.0, 1.0), (0.1, 1.0, 1.0)),
        phenomenon="relaxation of the rubber",
        separated_by="free decays and slow sines, over two decades of frequency",
        equation="F = a ((x − q) + r (x − q_2)), dq/dt = (x − q)/τ, dq_2/dt = (x − q_2)/τ_2",
    ),
    _effect("lag", "s", 5e-3, low=0.0, family="sensor", equation="a ẋ_m + x_m = x"),
    _effect("force_gain", "1", 0.02, family="sensor", equation="F_m = (1 + a) F"),
    _effect("drift", "N/s", 0.1, family="sensor", equation="F_m = F + a t"),
)
#: Every cause by name.
OSCILLATOR_EFFECTS: Final[Mapping[str, Hypothesis]] = MappingProxyType(
    {effect.name: effect for effect in _EFFECTS}
)
