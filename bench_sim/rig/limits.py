"""Limit detectors of the bench. Each compares a quantity of a reading with its limit, and trips after a duration."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import FAST_RATE
from bench_protocol.table import TABLE
from bench_protocol.units import bar, kN, mm, ms
from bench_protocol.wires import Table
from bench_protocol.words import ACTUATORS, CONTROL_MODES, PLATFORM_AXES, SIDES, LimitKind, Program
from bench_sim.model.compiled import compiled
from bench_sim.rig.controls import Happened


class LimitAction(IntEnum):
    """What happens when a detector trips, from the weakest to the strongest action."""

    NONE = 0  #: the detector is switched off
    INDICATE = 1  #: the trip is only reported
    PROGRAM_HOLD = 2  #: the bench holds and the program waits; no reset is needed to continue
    PROGRAM_STOP = 3  #: the program ends; actuators and air are shut in, a fault
    INTERLOCK = 4  #: the safe position, a fault: the springs are vented
    POWER_OFF = 5  #: valves and actuators lose their power and go to the safe position


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit of one reading. Values are in the SI unit of the reading unless stated otherwise.

    ``at`` is the limit of a quantity that depends on ``kind``. UPPER and LOWER: the reading, extrapolated by ``lead``.
    ERROR: the difference between reading and set-point. RATE: the rate of change per s. TIMEOUT: the time (s) without a
    reading. With ``within``, it is also the time for which the reading is farther than ``within`` from a constant
    set-point. COUNT: how often the reading has risen above ``level``.
    """

    signal: str
    kind: LimitKind
    at: float
    action: LimitAction
    persistence: float = 20 * ms
    hysteresis: float = 0.0  #: hysteresis, and the allowed further increase after a reset beyond the limit
    latch: bool = True  #: True: tripped until a reset; False: until the reading is back within the limit
    over: float = 20 * ms  #: RATE, and UPPER and LOWER with a lead: between the two samples that are compared
    lead: float = 0.0  #: UPPER, LOWER: a fast motion must be stopped before the limit
    within: float = 0.0  #: TIMEOUT
    level: float = 0.0  #: COUNT

    def trip_message(self, judged: float) -> str:
        """Return a sentence on the trip of this limit by the value ``judged``, with its action."""
        signal = TABLE[self.signal]
        name, at, was = (
            self.signal.replace(".", " ").replace("_", " "),
            signal.show(self.at),
            signal.show(judged),
        )
        lasting = f" for {self.persistence / ms:g} ms" if self.persistence else ""
        lasting += f", predicted {self.lead / ms:g} ms ahead" if self.lead else ""
        what = {
            LimitKind.LOWER: f"below {at}{lasting}, at {was}",
            LimitKind.UPPER: f"above {at}{lasting}, at {was}",
            LimitKind.ERROR: f"more than {at} from its set-point{lasting}, by {was}",
            LimitKind.RATE: f"faster than {at}/s{lasting}, with {was}/s",
            LimitKind.TIMEOUT: f"without a valid reading for {judged:g} s",
            LimitKind.COUNT: f"over {signal.show(self.level)} for the {judged:g}th time",
        }[self.kind]
        return f"{name} {what} → {self.action.name.lower().replace('_', ' ')}"


def _span(
    signal: str, low: float, high: float, hysteresis: float, action: LimitAction, lead: float = 0.0
) -> tuple[Limit, Limit, Limit]:
    """Return lower limit, upper limit and timeout of a reading. A missing reading exceeds no limit, so it needs the
    timeout.
    """
    return (
        Limit(signal, LimitKind.LOWER, low, action, hysteresis=hysteresis),
        Limit(signal, LimitKind.UPPER, high, action, hysteresis=hysteresis, lead=lead),
        Limit(signal, LimitKind.TIMEOUT, 100 * ms, LimitAction.PROGRAM_STOP, persistence=0.0),
    )


_INTERLOCK, _STOP = LimitAction.INTERLOCK, LimitAction.PROGRAM_STOP
#: Assumed limits: wide enough for every plan, narrow enough to save the springs. Only the first trip is reported.
LIMITS: Final = (
    # Upwards there is no stop but this one, and hardly a load: a bolster that is pulled up is fast.
    *(
        one
        for side in SIDES
        for one in _span(f"{side}.height", -130 * mm, 90 * mm, 2 * mm, _INTERLOCK, lead=30 * ms)
    ),
    *(
        one
        for side in SIDES
        for one in _span(f"{side}.bellows_pressure", -0.5 * bar, 9.0 * bar, 0.1 * bar, _INTERLOCK)
    ),
    *(one for side in SIDES for one in _span(f"vertical_{side}.force", -60 * kN, 190 * kN, 2.5 * kN, _STOP)),
    *_span("lateral.force", -47 * kN, 47 * kN, 1 * kN, _STOP),
    *_span("lateral.displacement", -120 * mm, 120 * mm, 2.4 * mm, _STOP),
)

DETECTOR: Final = np.dtype(
    [
        ("signal", "<i8"),
        ("kind", "<i8"),
        ("sense", "<f8"),  # -1: judge the negative of the reading
        ("at", "<f8"),
        ("samples", "<i8"),  # successive samples beyond the limit for a trip; 0: switched off
        ("hysteresis", "<f8"),
        ("latch", "<i8"),
        ("target", "<i8"),  # of the set-point that belongs to the reading, -1: none
        ("mode", "<i8"),  # control mode in which it does, -1: any
        ("over", "<i8"),  # samples
        ("lead", "<f8"),  # samples
        ("within", "<f8"),
        ("level", "<f8"),
        # memory of the detector
        ("judged", "<f8"),
        ("age", "<i8"),  # samples since the compared sample, or without a reading
        ("anchor", "<f8"),  # reading of the compared sample
        ("speed", "<f8"),  # outwards, by sample, between the last two that were compared
        ("before", "<f8"),  # and between the two before: a single reading that is off is no motion
        ("above", "<i8"),
        ("count", "<i8"),
        ("outside", "<i8"),  # samples outside in a row
        ("tripped", "<i8"),
        ("reported", "<i8"),  # 1: the trip was passed to the state machine
        ("standing", "<i8"),  # 1: was outside when it was reset, and has not come back yet
        ("bar", "<f8"),  # the limit that a standing detector uses instead
    ]
)
_TARGETS: Final = (*ACTUATORS, *(f"platform.{axis}" for axis in PLATFORM_AXES))
_ACTUATORS: Final = len(ACTUATORS)


def _aim(signal: str) -> tuple[int, int]:
    """Return the indices of the target and the control mode whose set-point ``signal`` follows, or (-1, -1) if there
    is none.
    """
    if signal in _TARGETS:
        return _TARGETS.index(signal), -1
    device, _, reading = signal.partition(".")
    if device in ACTUATORS and reading in CONTROL_MODES:
        return ACTUATORS.index(device), CONTROL_MODES.index(reading)
    return -1, -1


def detectors(table: Table, limits: tuple[Limit, ...]) -> npt.NDArray[np.void]:
    """Return ``limits`` as the array that the tick uses.

    Raises ValueError if a limit compares a reading with a set-point that this reading does not have.
    """
    rows = np.zeros(len(limits), DETECTOR)
    for row, limit in zip(rows, limits, strict=True):
        target, mode = _aim(limit.signal)
        if target < 0 and (limit.kind is LimitKind.ERROR or limit.within):
            raise ValueError(
                f"a limit of {limit.signal}: this reading has no set-point; use another kind, and remove within"
            )
        row["signal"], row["kind"] = table.index[limit.signal], limit.kind
        row["sense"] = -1.0 if limit.kind is LimitKind.LOWER else 1.0
        row["at"], row["hysteresis"], row["latch"] = limit.at * row["sense"], limit.hysteresis, limit.latch
        if limit.action is not LimitAction.NONE:
            row["samples"] = max(1, round(limit.persistence * FAST_RATE))
        row["target"], row["mode"] = target, mode
        row["over"] = max(1, round(limit.over * FAST_RATE))
        row["within"], row["level"], row["lead"] = limit.within, limit.level, limit.lead * FAST_RATE
        row["anchor"] = row["judged"] = np.nan
    return rows


@compiled
def _error(c: Any, detector: Any, reading: float) -> float:
    """Return the absolute difference between ``reading`` and its set-point, or 0 if the set-point does not
    apply now.
    """
    target = detector.target
    if detector.mode >= 0 and (c.engaged == 0 or c.control[target] != detector.mode):
        return 0.0
    return abs(c.setpoint[target] + c.offset[target] - reading)


@compiled
def _compared_value(c: Any, detector: Any, reading: float) -> float:
    """Update the memory of ``detector`` by one sample. Return the value to compare with its limit."""
    kind = detector.kind
    if kind == LimitKind.ERROR:
        return _error(c, detector, reading)
    if kind == LimitKind.RATE:
        detector.age += 1
        if detector.age >= detector.over:
            detector.judged = abs(reading - detector.anchor) * FAST_RATE / detector.age
            detector.anchor = reading
            detector.age = 0
        return detector.judged
    if kind == LimitKind.TIMEOUT:
        late = np.isnan(reading)
        if detector.within > 0.0 and c.slew[detector.target] == 0 and c.program != Program.RUN:
            late = late or _error(c, detector, reading) > detector.within
        detector.age = detector.age + 1 if late else 0
        return detector.age / FAST_RATE
    if kind == LimitKind.COUNT:
        if detector.above == 0 and reading > detector.level:
            detector.above = 1
            detector.count += 1
        elif reading < detector.level - detector.hysteresis:
            detector.above = 0
        return float(detector.count)
    if detector.lead > 0.0:
        detector.age += 1
        if detector.age >= detector.over:
            detector.before = detector.speed
            detector.speed = detector.sense * (reading - detector.anchor) / detector.age
            detector.anchor = reading
            detector.age = 0
        if detector.speed > 0.0 and detector.before > 0.0:  # and not NaN
            return detector.sense * reading + detector.lead * min(detector.speed, detector.before)
    return detector.sense * reading


@compiled
def detect(c: Any, values: Any, detectors: Any) -> int:
    """Update the limit detectors by one sample. Return `Happened.LIMIT` if one of them has just tripped.

    After a reset beyond the limit, the reading may return in steps. If it increases again, the detector trips again.
    """
    happened = Happened.NOTHING.value
    for row in range(detectors.size):
        detector = detectors[row]
        if detector.samples == 0:
            continue
        judged = _compared_value(c, detector, values[detector.signal])
        detector.judged = judged
        back = detector.hysteresis if detector.kind != LimitKind.COUNT else 0.0
        bar = detector.at
        if detector.standing != 0:
            if judged <= bar - back:
                detector.standing = 0
            else:
                detector.bar = min(detector.bar, judged + back)
                bar = max(bar, detector.bar)
        if judged > bar:
            detector.outside += 1
            if detector.outside >= detector.samples and detector.tripped == 0:
                detector.tripped = 1
                happened = Happened.LIMIT.value
        else:
            detector.outside = 0
            if detector.latch == 0 and judged <= bar - back:
                detector.tripped = detector.reported = 0
    return happened


def reset_detectors(detectors: npt.NDArray[np.void]) -> None:
    """Clear all trips. Timeouts and counts begin again.

    Another reading that is still beyond its limit trips only if it moves further beyond it, by more than the
    hysteresis. So the axis can be moved back.
    """
    for name in ("tripped", "reported", "outside", "age", "count"):
        detectors[name] = 0
    lasting = ~np.isin(detectors["kind"], (LimitKind.TIMEOUT, LimitKind.COUNT))  # these begin again
    detectors["standing"] = lasting & (detectors["samples"] > 0) & (detectors["judged"] > detectors["at"])
    detectors["bar"] = detectors["judged"] + detectors["hysteresis"]
