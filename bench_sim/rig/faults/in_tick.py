"""Faults in the compiled tick: wrong sensor readings, and plant inputs with fixed values."""

import math
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import FAST_RATE, TICK
from bench_sim.model.compiled import compiled
from bench_sim.model.layout import INPUTS
from bench_sim.model.noise import normal, scramble

#: Readings that can be disturbed at once.
DISTURBANCES_MAX: Final = 64
_WORDS: Final = 2.0**32


class DisturbanceKind(IntEnum):
    """The kind of disturbance of a reading."""

    STUCK = 0  #: stays at ``value``, or at the first reading where that is NaN
    BIAS = 1  #: is off by ``value``
    DRIFT = 2  #: is off by ``value`` for every second
    SPIKE = 3  #: is off by ``value`` in some samples, with the probability ``chance``
    NOISE = 4  #: is off by a normal variate of the standard deviation ``value``
    LOST = 5  #: is ``value``: a rail of the transducer, or NaN
    TURNED = 6  #: has the other sign
    SWAPPED = 7  #: is that of the sensor ``value``, which has this one's


#: One disturbed reading; ``start`` is the tick from which it counts.
DISTURBANCE: Final = np.dtype(
    [
        ("sensor", "<i8"),
        ("kind", "<i8"),
        ("value", "<f8"),
        ("chance", "<f8"),
        ("start", "<i8"),
        ("seed", "<i8"),
    ]
)


class FaultArrays(NamedTuple):
    """The active faults that the tick applies, as arrays for compiled code."""

    counts: npt.NDArray[np.int64]  #: (2,): disturbed readings, held inputs; 0 costs nothing
    disturbances: npt.NDArray[np.void]
    inputs: npt.NDArray[np.float64]  #: by `Input`: the value at which it is held, NaN where it is free

    @classmethod
    def none(cls) -> "FaultArrays":
        """Return arrays without any fault."""
        return cls(np.zeros(2, np.int64), np.zeros(DISTURBANCES_MAX, DISTURBANCE), np.full(INPUTS, np.nan))


@compiled
def hold_inputs(faults: Any, u: Any) -> None:
    """Set the plant inputs with a fault to their fixed values."""
    if faults.counts[1] == 0:
        return
    for k in range(INPUTS):
        if not math.isnan(faults.inputs[k]):
            u[k] = faults.inputs[k]


@compiled
def disturb(faults: Any, tick: int, par: Any, readings: Any) -> None:
    """Change the readings (SI) of one sampling instant, in the order in which the faults were switched on.

    A reading with an offset, drift, spikes, noise or a wrong sign stays within the range of its sensor.
    """
    for row in range(faults.counts[0]):
        one = faults.disturbances[row]
        sensor = one.sensor
        reading = readings[sensor]
        kind = one.kind
        if kind == DisturbanceKind.STUCK:
            if math.isnan(one.value):
                one.value = reading
            readings[sensor] = one.value
        elif kind == DisturbanceKind.LOST:
            readings[sensor] = one.value
        elif kind == DisturbanceKind.SWAPPED:
            other = int(one.value)
            readings[sensor] = readings[other]
            readings[other] = reading
        else:
            if kind == DisturbanceKind.BIAS:
                reading += one.value
            elif kind == DisturbanceKind.DRIFT:
                reading += one.value * (tick - one.start) * TICK
            elif kind == DisturbanceKind.TURNED:
                reading = -reading
            elif kind == DisturbanceKind.NOISE:
                reading += one.value * normal(one.seed, tick, sensor)
            elif scramble(scramble(int(one.seed) + int(sensor)) ^ int(tick)) < one.chance * _WORDS:
                reading += one.value
            readings[sensor] = min(max(reading, par.sensor_low[sensor]), par.sensor_high[sensor])


def chance_of(rate: float) -> float:
    """Return the probability per sample of an event that occurs at an average ``rate`` in Hz."""
    return min(rate / FAST_RATE, 1.0)
