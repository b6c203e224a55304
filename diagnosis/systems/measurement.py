"""Effects of measurement that a model of the system lacks: gain, offset, drift, lag, delay, held samples.

Each is a cause for one signal, with a name such as ``lag.force``. For an output, the effect converts the value y of the
model to the reading. For an input, the inverse of the effect converts the recorded value u_m to the value u that drives
the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from diagnosis.contracts import Array, Effects, Hypothesis, Parameter
from diagnosis.systems.piston import lagged

#: Names of the causes, before the dot and the name of their signal.
KINDS: Final = ("gain", "offset", "drift", "lag", "latency", "held")
#: Time (s) in which an offset builds up by drift.
_DRIFT_TIME: Final = 60.0
#: An ordinary relative error of a gain.
_GAIN: Final = 0.02
#: Recorded inputs are differentiated along parabolas through so many samples to either side.
_REACH: Final = 3


@dataclass(frozen=True, slots=True)
class Measured:
    """A measured signal: ``size`` is a typical error of its zero (SI), ``delay`` of its timing (s)."""

    name: str
    unit: str
    kind: Literal["input", "output"]
    size: float
    delay: float
    display: str = ""
    scale: float = 1.0


def measurement_effects(signals: Sequence[Measured]) -> Mapping[str, Hypothesis]:
    """Return all measurement effects of the signals by name."""
    return MappingProxyType({one.name: one for signal in signals for one in _errors_of_signal(signal)})


def _errors_of_signal(signal: Measured) -> list[Hypothesis]:
    shown, output = signal.display or signal.unit, signal.kind == "output"
    gain = Parameter("gain", "1", 0.0, _GAIN, -0.9, 10.0, display="%", scale=0.01)
    offset = Parameter("offset", signal.unit, 0.0, signal.size, display=shown, scale=signal.scale)
    rate = Parameter(
        "rate",
        f"{signal.unit}/s",
        0.0,
        signal.size / _DRIFT_TIME,
        display=f"{shown}/s",
        scale=signal.scale,
    )
    name = signal.name
    every = [
        _error(signal, "gain", gain, f"wrong gain of {name}", f"the gain of {name} is wrong", "(1 + a) {}"),
        _error(signal, "offset", offset, f"offset of {name}", f"{name} has an offset", "{} + a"),
        _error(signal, "drift", rate, f"drift of {name}", f"{name} drifts", "{} + a t"),
        _late(signal, "lag", f"{name} lags behind", "a ẏ_m + y_m = y" if output else "u = u_m + a u̇_m"),
        _late(
            signal, "latency", f"{name} arrives late", "y_m(t) = y(t − a)" if output else "u(t) = u_m(t + a)"
        ),
    ]
    return [*every, _held(signal)] if output else every


def _error(
    signal: Measured, cause: str, amplitude: Parameter, title: str, plain: str, law: str
) -> Hypothesis:
    return Hypothesis(
        f"{cause}.{signal.name}",
        "sensor",
        title,
        amplitude,
        touches=frozenset({"sensor"}),
        equation=f"y_m = {law.format('y')}" if signal.kind == "output" else f"u = {law.format('u_m')}",
        plain=plain,
    )


def _late(signal: Measured, cause: str, plain: str, equation: str) -> Hypothesis:
    other = {"lag": "latency", "latency": "lag"}[cause]
    parameter = {"lag": "lag", "latency": "delay"}[cause]
    amplitude = Parameter(
        parameter, "s", 0.0, signal.delay, 0.0, step=0.02 * signal.delay, display="ms", scale=1e-3, along="time"
    )  # fmt: skip
    return Hypothesis(
        f"{cause}.{signal.name}",
        "sensor" if cause == "lag" else "acquisition",
        f"{cause} of {signal.name}",
        amplitude,
        touches=frozenset({"sensor", "timing"}),
        confusers=(f"{other}.{signal.name}",),
        phenomenon=f"a delay of {signal.name}",
        equation=equation,
        plain=plain,
        separated_by="faster motion, sampled finely",
    )


def _held(signal: Measured) -> Hypothesis:
    period = Parameter(
        "period",
        "s",
        10.0 * signal.delay,
        10.0 * signal.delay,
        2.0 * signal.delay,
        100.0 * signal.delay,
        logarithmic=True,
        display="ms",
        scale=1e-3,
    )
    return Hypothesis(
        f"held.{signal.name}",
        "acquisition",
        f"{signal.name} is held between infrequent samples",
        Parameter("hold", "1", 0.0, 1.0, 0.0, 1.0, display="%", scale=0.01),
        (period,),
        ((4.0 * signal.delay,), (10.0 * signal.delay,), (25.0 * signal.delay,)),
        frozenset({"sensor", "timing"}),
        (f"latency.{signal.name}", f"lag.{signal.name}"),
        phenomenon=f"a delay of {signal.name}",
        equation="y_m(t) = y(t − a (t mod T))",
        plain=f"{signal.name} is held between infrequent samples",
        separated_by="fast motion: stairs",
    )


def read_as(name: str, values: Array, time: Array, effects: Effects) -> Array:
    """Return the readings (n,) of an output with ``values`` (n,), after all measurement effects. ``time`` (n,) is
    equidistant, from the start of the record.
    """
    step = float(time[1] - time[0])
    y = values
    if lag := _value(effects, "lag", name, "lag"):
        y = lagged(y, lag, step)
    late: Array = np.full(time.shape, _value(effects, "latency", name, "delay"))
    if held := effects.get(f"held.{name}"):
        late = late + held["hold"] * np.mod(time + 1e-6, held["period"])
    if late.any():
        y = _interpolate(y, time, time - late)
    return _shifted(name, y, time, effects)


def driven_by(name: str, values: Array, time: Array, effects: Effects) -> Array:
    """Return the true input (n,) of a model from the recorded ``values`` (n,): the inverse of the measurement effects.
    ``time`` (n,) is equidistant.
    """
    u = values
    if late := _value(effects, "latency", name, "delay"):
        u = _interpolate(u, time, time + late)
    if lag := _value(effects, "lag", name, "lag"):
        u = u + lag * _rate(u, float(time[1] - time[0]))
    return _shifted(name, u, time, effects)


def _shifted(name: str, values: Array, time: Array, effects: Effects) -> Array:
    if gain := _value(effects, "gain", name, "gain"):
        values = (1.0 + gain) * values
    if offset := _value(effects, "offset", name, "offset"):
        values = values + offset
    if rate := _value(effects, "drift", name, "rate"):
        values = values + rate * time
    return values


def _value(effects: Effects, kind: str, name: str, parameter: str) -> float:
    return effects.get(f"{kind}.{name}", {}).get(parameter, 0.0)


def _interpolate(values: Array, time: Array, wanted: Array) -> Array:
    """Return a signal at the times ``wanted``, by a cubic spline. Outside of its range it is constant."""
    return CubicSpline(time, values)(np.clip(wanted, time[0], time[-1]))


def _rate(values: Array, step: float) -> Array:
    window = min(2 * _REACH + 1, (len(values) - 1) // 2 * 2 + 1)
    return savgol_filter(values, window, 2, deriv=1, delta=step)
