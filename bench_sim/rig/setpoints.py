"""Limits of range and speed for all set-points of the rig, from any source."""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import PACE, TICK
from bench_protocol.table import TABLE
from bench_protocol.units import kN, m, rad, s
from bench_protocol.words import ACTUATORS, CONTROL_MODES, PLATFORM_AXES
from bench_sim.model.compiled import compiled
from bench_sim.rig.controls import TARGETS


@dataclass(frozen=True, slots=True)
class SetpointPace:
    """The largest speeds of one set-point, in SI units per second."""

    target: str  #: an actuator, or an axis of the platform as ``platform.roll``
    mode: str  #: the controlled quantity: ``force`` or ``displacement``
    unit: str  #: display unit, per second
    travel: float  #: at most, on the way to a new goal
    wave: float  #: largest peak of a wave of the function generator
    source: str


_LET_GO: Final = (
    "assumed: loaded springs that are let go rise with 0.2 m/s at most, which the limits of height catch"
)
_STOP: Final = "assumed: an actuator that a limit stops has overrun it by 8 mm at most"
_VALVE: Final = "waves: flow of the servo-valve"
PACES: Final = (
    *(SetpointPace(one, "force", "kN", PACE["N"], 50 * kN / s, _LET_GO) for one in ACTUATORS),
    *(
        SetpointPace(one, "displacement", "mm", PACE["m"], 0.6 * m / s, f"{_STOP}; {_VALVE}")
        for one in ACTUATORS
    ),
    *(
        SetpointPace(f"platform.{axis}", "displacement", unit, PACE[si], 0.6 * rad / s, f"{_STOP}; {_VALVE}")
        for axis, unit, si in zip(PLATFORM_AXES, ("mm", "mm", "mrad"), ("m", "m", "rad"), strict=True)
    ),
)


def _row(name: str) -> tuple[SetpointPace | None, ...]:
    return tuple(
        next((pace for pace in PACES if (pace.target, pace.mode) == (name, mode)), None)
        for mode in CONTROL_MODES
    )


#: By target and control mode; None if the target cannot move in this mode.
_TABLE: Final = (*(_row(name) for name in ACTUATORS), *(_row(f"platform.{axis}") for axis in PLATFORM_AXES))
assert len(_TABLE) == TARGETS
#: The same for the tick: the longest step of a set-point in one of them.
_STEPS: Final = np.array([[pace.travel * TICK if pace else math.inf for pace in row] for row in _TABLE])
_DISPLACEMENT: Final = CONTROL_MODES.index("displacement")
#: By target, in displacement control: its set-point, the longest step of a wave, and how far it goes.
DISPLACEMENTS: Final = (
    *(f"{one}.displacement_setpoint" for one in ACTUATORS),
    *(f"platform.{axis}_setpoint" for axis in PLATFORM_AXES),
)
LONGEST_WAVE_STEP: Final = np.array([pace.wave * TICK for row in _TABLE if (pace := row[_DISPLACEMENT])])
REACH: Final = np.array([TABLE[name].high for name in DISPLACEMENTS])
_ACTUATORS: Final = len(ACTUATORS)


def too_fast(target: int, mode: int, speed: float) -> bool:
    """Return whether waves with this peak ``speed`` (SI) are too fast for ``target`` in the control ``mode``."""
    pace = _TABLE[target][mode]
    return pace is not None and speed > pace.wave


@compiled
def travel(c: Any) -> None:
    """Move every set-point by one tick towards its goal. A straight line reaches the goal in ``slew`` ticks.

    If this would exceed the largest speed, the set-point moves at that speed and reaches its goal later.
    """
    for row in range(TARGETS):
        if c.slew[row] > 0:
            mode = c.control[row] if row < _ACTUATORS else _DISPLACEMENT
            longest = _STEPS[row, mode]
            way = (c.goal[row] - c.setpoint[row]) / c.slew[row]
            if -longest <= way <= longest:
                c.setpoint[row] += way
                c.slew[row] -= 1
            else:
                c.setpoint[row] += math.copysign(longest, way)
    if c.wind_slew > 0:
        c.wind += (c.wind_goal - c.wind) / c.wind_slew
        c.wind_slew -= 1


def frames_of_setpoints() -> npt.NDArray[np.int64]:
    """Return, for each table row, the number of set-points in the frame that begins with this row. It is 0 for other
    rows.
    """
    fields = np.zeros(len(TABLE.signals), np.int64)
    for message in TABLE.messages:
        if all(field.signal.endswith("_setpoint") for field in message.fields):
            fields[TABLE.index[message.fields[0].signal]] = len(message.fields)
    return fields


def ranges() -> npt.NDArray[np.float64]:
    """Return the lowest and the highest valid value for each table row (SI), (n, 2), with a tolerance of
    half a step.
    """
    return np.array([(one.low - 0.5 * one.step, one.high + 0.5 * one.step) for one in TABLE.signals])


@compiled
def outside(signals: Any, values: Any, first: int, count: int, ranges: Any) -> bool:
    """Return whether one of ``count`` samples, from ``first`` on, is out of its range. NaN means "no change" and is
    allowed.
    """
    for k in range(first, first + count):
        row = signals[k]
        if values[k] < ranges[row, 0] or values[k] > ranges[row, 1]:
            return True
    return False
