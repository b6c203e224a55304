"""The set-points of a bench and the ramps and waveform that move them, changed in compiled code under a mutex.

A Python thread that holds the mutex may have to wait for the interpreter. The thread of the cycle would then wait
too.
"""

import math
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.runtime.binding import bind, cached, inlined
from bench_protocol.runtime.calls import lock_mutex, unlock_mutex

RAMP: Final = np.dtype(
    [
        ("moving", "<i8"),
        ("start", "<f8"),
        ("end", "<f8"),
        ("step", "<f8"),  # SI per cycle, with its sign
        ("cycles", "<i8"),  # number of cycles since the start
    ]
)
#: Limits of a waveform: number of set-points, and of cycles (20 minutes).
WAVEFORM_ROWS: Final = 8
WAVEFORM_CYCLES: Final = 60_000
WAVEFORM: Final = np.dtype(
    [
        ("playing", "<i8"),
        ("count", "<i8"),  # number of set-points
        ("cycles", "<i8"),  # total
        ("cycle", "<i8"),  # since the start
    ]
)


class Setpoints(NamedTuple):
    """Set-points by table row. A single number can be read without the mutex."""

    values: npt.NDArray[np.float64]  #: SI, NaN where nothing is set yet
    ramps: npt.NDArray[np.void]  #: `RAMP`
    waveform: npt.NDArray[np.void]  #: one `WAVEFORM`
    rows: npt.NDArray[np.int64]  #: table rows of the set-points that the waveform moves, as many as its count
    track: npt.NDArray[
        np.float64
    ]  #: (rows, cycles): values of the waveform, SI; unused memory is not allocated

    @classmethod
    def of(cls, signals: int) -> "Setpoints":
        """Return the set-points of a table with ``signals`` rows, all without a value."""
        return cls(
            np.full(signals, np.nan),
            np.zeros(signals, RAMP),
            np.zeros(1, WAVEFORM),
            np.zeros(WAVEFORM_ROWS, np.int64),
            np.zeros((WAVEFORM_ROWS, WAVEFORM_CYCLES)),
        )


def entry(function: Callable[..., Any]) -> Any:
    """Compile ``function`` to run without the interpreter, so that waiting for a mutex blocks no other thread."""
    return cached(function, nogil=True)


@inlined
def advance(setpoints: Any) -> None:
    """Move every set-point with a ramp or waveform by one cycle; the last cycle reaches the end value exactly."""
    values = setpoints.values
    for row in range(setpoints.ramps.size):
        ramp = setpoints.ramps[row]
        if ramp.moving == 0:
            continue
        ramp.cycles += 1
        value = ramp.start + ramp.cycles * ramp.step
        if ramp.step == 0.0 or (value - ramp.end) * ramp.step >= 0.0:
            value = ramp.end
            ramp.moving = 0
        values[row] = value
    waveform = setpoints.waveform[0]
    if waveform.playing != 0:
        for k in range(waveform.count):
            values[setpoints.rows[k]] = setpoints.track[k, waveform.cycle]
        waveform.cycle += 1
        if waveform.cycle >= waveform.cycles:
            waveform.playing = 0


@inlined
def _release(setpoints: Any, row: int) -> None:
    """End the ramp or waveform that moves the set-point of ``row``, because another value replaces it."""
    setpoints.ramps[row].moving = 0
    waveform = setpoints.waveform[0]
    for k in range(waveform.count):
        if setpoints.rows[k] == row:
            waveform.playing = 0


@entry
def change(setpoints: Any, mutex: int, rows: Any, values: Any) -> None:
    """Set the set-points ``rows`` to ``values`` (SI) together from the next cycle on. Lock the mutex at address
    ``mutex`` meanwhile.
    """
    lock_mutex(mutex)
    for k in range(rows.size):
        _release(setpoints, rows[k])
        setpoints.values[rows[k]] = values[k]
    unlock_mutex(mutex)


@entry
def depart(setpoints: Any, mutex: int, rows: Any, ends: Any, pace: float) -> float:
    """Start ramps from the present set-points ``rows`` to ``ends``, with ``pace`` (SI per cycle). Lock the mutex at
    address ``mutex`` meanwhile.

    Returns the number of cycles of the longest ramp. Returns NaN, without a change, if a set-point has no value yet.
    """
    lock_mutex(mutex)
    longest = 0.0
    for k in range(rows.size):
        longest = max(longest, math.ceil(abs(ends[k] - setpoints.values[rows[k]]) / pace))
        if math.isnan(setpoints.values[rows[k]]):
            longest = math.nan
            break
    for k in range(0 if math.isnan(longest) else rows.size):
        _release(setpoints, rows[k])
        ramp = setpoints.ramps[rows[k]]
        ramp.start = setpoints.values[rows[k]]
        ramp.end = ends[k]
        ramp.step = math.copysign(pace, ramp.end - ramp.start)
        ramp.cycles = 0
        ramp.moving = 1
    unlock_mutex(mutex)
    return longest


@entry
def play(setpoints: Any, mutex: int, rows: Any, offsets: Any) -> bool:
    """Play ``offsets`` (SI, rows × cycles) relative to the present set-points ``rows``, one column each cycle. Lock the
    mutex at address ``mutex`` meanwhile.

    Returns False, without a change, if one of them has no value yet.
    """
    lock_mutex(mutex)
    given = True
    for k in range(rows.size):
        given = given and not math.isnan(setpoints.values[rows[k]])
    if given:
        waveform = setpoints.waveform[0]
        waveform.count, waveform.cycles = offsets.shape
        waveform.cycle = 0
        waveform.playing = 1
        for k in range(rows.size):
            setpoints.ramps[rows[k]].moving = 0
            setpoints.rows[k] = rows[k]
            start = setpoints.values[rows[k]]
            for cycle in range(offsets.shape[1]):
                setpoints.track[k, cycle] = start + offsets[k, cycle]
    unlock_mutex(mutex)
    return given


@entry
def stay(setpoints: Any, mutex: int) -> None:
    """Stop all ramps and the waveform at their present values. Lock the mutex at address ``mutex`` meanwhile."""
    lock_mutex(mutex)
    setpoints.waveform[0].playing = 0
    for row in range(setpoints.ramps.size):
        setpoints.ramps[row].moving = 0
    unlock_mutex(mutex)


@entry
def step(setpoints: Any) -> None:
    """Move the set-points by one cycle. The caller holds the mutex."""
    advance(setpoints)


_NONE: Final = Setpoints.of(0)
_ROWS: Final = np.zeros(0, np.int64)
set_values: Final = bind(change, _NONE, 0, _ROWS, _NONE.values)
start_ramps: Final = bind(depart, _NONE, 0, _ROWS, _NONE.values, 0.0)
play_waveform: Final = bind(play, _NONE, 0, _ROWS, _NONE.track)
end_moves: Final = bind(stay, _NONE, 0)
next_cycle: Final = bind(step, _NONE)
