"""Extremes of each reading of a recorded run, the steps where they occur, and the speeds of positions."""

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from bench_protocol.units import ms
from bench_records.layout import Phase
from bench_records.record import Record

#: Time between the two samples that give a speed: less than the shortest wave, more than the steps of the transducers.
SPEED_OVER: Final = 20 * ms


class Extreme(msgspec.Struct, frozen=True):
    """The lowest and highest value of a reading (SI, or SI per second for a speed), with time (s) and step."""

    signal: str
    unit: str  #: display unit
    scale: float  #: SI value of one display unit
    low: float
    low_at: float
    low_in: str
    high: float
    high_at: float
    high_in: str
    is_speed: bool = False


def step_at(phases: Sequence[Phase], time: float) -> str:
    """Return the step of a run at ``time`` (s): its part, and the finest phase in it; "" outside all of them.

    A sample at the very end of a step belongs to this step.
    """
    inside = sorted(
        (phase for phase in phases if phase.start < time <= phase.end or phase.start == time == 0.0),
        key=lambda phase: phase.level,
    )
    return " › ".join(dict.fromkeys((inside[0].name, inside[-1].name))) if inside else ""


def envelope(record: Record, phases: Sequence[Phase], until: float = float("inf")) -> list[Extreme]:
    """Return the extremes of all readings of ``record`` up to ``until`` (s), and of the speeds of lengths.

    A reading without a sample is left out.
    """
    found, speeds = [], []
    for signal in record.signals.values():
        if not signal.quantity or signal.names:
            continue
        times, values = record.series(signal.name)
        known = np.isfinite(values) & (times <= until)
        times, values = times[known], values[known]
        if not times.size:
            continue
        found.append(_extreme(signal.name, signal.unit, signal.scale, times, values, phases))
        if signal.unit == "mm" and times.size > 1:
            over = max(1, round(SPEED_OVER / float(np.median(np.diff(times)))))
            if times.size > over:
                speed = (values[over:] - values[:-over]) / (times[over:] - times[:-over])
                speeds.append(
                    _extreme(
                        signal.name, f"{signal.unit}/s", signal.scale, times[over:], speed, phases, speed=True
                    )
                )
    return found + speeds


def _extreme(
    name: str,
    unit: str,
    scale: float,
    times: np.ndarray,
    values: np.ndarray,
    phases: Sequence[Phase],
    *,
    speed: bool = False,
) -> Extreme:
    low, high = int(values.argmin()), int(values.argmax())
    low_at, high_at = float(times[low]), float(times[high])
    return Extreme(
        name,
        unit,
        scale,
        float(values[low]),
        low_at,
        step_at(phases, low_at),
        float(values[high]),
        high_at,
        step_at(phases, high_at),
        speed,
    )
