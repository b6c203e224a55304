"""Limit detectors of the bench: which reading may go how far, for how long, and what happens then."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from bench_protocol.units import bar, kN, mm, ms
from bench_protocol.wires import Table


class LimitAction(IntEnum):
    """What a tripped detector does."""

    INDICATE = 0
    HOLD = 1
    POWER_OFF = 2


@dataclass(frozen=True, slots=True)
class Limit:
    """A detector on one signal: trips when the reading stays outside for ``persistence`` seconds; latched."""

    signal: str
    low: float
    high: float
    persistence: float
    action: LimitAction


#: Assumed limits: wide enough for every plan, narrow enough to save the springs. Only the first trip is reported.
LIMITS: Final = (
    *(
        Limit(f"{side}.height", -130 * mm, 90 * mm, 20 * ms, LimitAction.POWER_OFF)
        for side in ("left", "right")
    ),
    *(
        Limit(f"{side}.bellows_pressure", -0.5 * bar, 9.0 * bar, 20 * ms, LimitAction.POWER_OFF)
        for side in ("left", "right")
    ),
    *(
        Limit(f"vertical_{side}.force", -60 * kN, 190 * kN, 20 * ms, LimitAction.HOLD)
        for side in ("left", "right")
    ),
    Limit("lateral.force", -47 * kN, 47 * kN, 20 * ms, LimitAction.HOLD),
    Limit("lateral.displacement", -120 * mm, 120 * mm, 20 * ms, LimitAction.HOLD),
)

DETECTOR: Final = np.dtype(
    [
        ("signal", "<i8"),
        ("low", "<f8"),
        ("high", "<f8"),
        ("samples", "<i8"),
        ("outside", "<i8"),  # samples outside in a row
        ("tripped", "<i8"),
        ("standing", "<i8"),  # 1: was outside when it was reset, and has not come back yet
        ("slack", "<f8"),  # how far a standing reading may go out again
        ("lowest", "<f8"),  # where a standing detector trips instead
        ("highest", "<f8"),
    ]
)
#: A standing reading may move outwards by this part of its range, or noise would trip it.
_SLACK: Final = 0.01


def detectors(table: Table, limits: tuple[Limit, ...], rate: float) -> npt.NDArray[np.void]:
    """Compile ``limits`` into the array that the tick reads; ``rate`` is that of the readings in Hz."""
    rows = np.zeros(len(limits), DETECTOR)
    for row, limit in enumerate(limits):
        samples = max(1, round(limit.persistence * rate))
        slack = _SLACK * (limit.high - limit.low)
        rows[row] = (table.index[limit.signal], limit.low, limit.high, samples, 0, 0, 0, slack, 0.0, 0.0)
    return rows


def reset_detectors(detectors: npt.NDArray[np.void], values: npt.NDArray[np.float64]) -> None:
    """Clear what has tripped, given all signals by table row (SI).

    What is still outside is standing from now on: it trips only if it goes farther out, so that the way back is open.
    """
    readings = values[detectors["signal"]]
    detectors["tripped"] = detectors["outside"] = 0
    detectors["standing"] = (readings < detectors["low"]) | (readings > detectors["high"])
    detectors["lowest"] = readings - detectors["slack"]
    detectors["highest"] = readings + detectors["slack"]
