"""The set-points of a bench and the ramps on which they move, changed in compiled code that holds a gate.

Python, once it has the gate, may have to wait for the interpreter, and whatever keeps the beat with it.
"""

import math
from collections.abc import Callable
from hashlib import sha256
from importlib.resources import files
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.binding import bind, cached, inlined
from bench_protocol.system_calls import lock_mutex, unlock_mutex

RAMP: Final = np.dtype(
    [
        ("moving", "<i8"),
        ("start", "<f8"),
        ("end", "<f8"),
        ("step", "<f8"),  # SI per beat, with its sign
        ("beats", "<i8"),  # since the start
    ]
)


class Setpoints(NamedTuple):
    """Set-points by table row. A single number can be read without the gate."""

    values: npt.NDArray[np.float64]  #: SI, NaN where none was given yet
    ramps: npt.NDArray[np.void]  #: `RAMP`

    @classmethod
    def of(cls, signals: int) -> "Setpoints":
        """Return the set-points of a table with so many ``signals``; none has a value."""
        return cls(np.full(signals, np.nan), np.zeros(signals, RAMP))


def _digest() -> str:
    digest = sha256(files("drivers").joinpath("setpoints.py").read_bytes())
    for source in sorted(files("bench_protocol").iterdir(), key=lambda entry: entry.name):
        if source.name.endswith(".py"):
            digest.update(source.read_bytes())
    return digest.hexdigest()


_DIGEST: Final = _digest()


def entry(function: Callable[..., Any]) -> Any:
    """Compile ``function`` to run without the interpreter: whoever waits at a gate keeps nobody from anything else."""
    return cached(function, _DIGEST, nogil=True)


@inlined
def advance(values: Any, ramps: Any) -> None:
    """Move every set-point that is on its way by one beat; the last beat brings it to its end exactly."""
    for row in range(ramps.size):
        ramp = ramps[row]
        if ramp.moving == 0:
            continue
        ramp.beats += 1
        value = ramp.start + ramp.beats * ramp.step
        if ramp.step == 0.0 or (value - ramp.end) * ramp.step >= 0.0:
            value = ramp.end
            ramp.moving = 0
        values[row] = value


@entry
def change(setpoints: Any, gate: int, rows: Any, values: Any) -> None:
    """Let the set-points ``rows`` be ``values`` (SI) from the next beat on, together; ``gate``: its address."""
    lock_mutex(gate)
    for k in range(rows.size):
        setpoints.ramps[rows[k]].moving = 0
        setpoints.values[rows[k]] = values[k]
    unlock_mutex(gate)


@entry
def depart(setpoints: Any, gate: int, rows: Any, ends: Any, pace: float) -> float:
    """Start ramps from where the set-points ``rows`` are to ``ends``, with ``pace`` (SI per beat).

    Return how many beats the longest takes; NaN, and nothing changes, if a set-point has no value to start from.
    """
    lock_mutex(gate)
    longest = 0.0
    for k in range(rows.size):
        longest = max(longest, math.ceil(abs(ends[k] - setpoints.values[rows[k]]) / pace))
        if math.isnan(setpoints.values[rows[k]]):
            longest = math.nan
            break
    for k in range(0 if math.isnan(longest) else rows.size):
        ramp = setpoints.ramps[rows[k]]
        ramp.start = setpoints.values[rows[k]]
        ramp.end = ends[k]
        ramp.step = math.copysign(pace, ramp.end - ramp.start)
        ramp.beats = 0
        ramp.moving = 1
    unlock_mutex(gate)
    return longest


@entry
def stay(setpoints: Any, gate: int) -> None:
    """End all ramps where they are."""
    lock_mutex(gate)
    for row in range(setpoints.ramps.size):
        setpoints.ramps[row].moving = 0
    unlock_mutex(gate)


@entry
def step(setpoints: Any) -> None:
    """Move the set-points by one beat; whoever calls holds the gate."""
    advance(setpoints.values, setpoints.ramps)


_NONE: Final = Setpoints.of(0)
_ROWS: Final = np.zeros(0, np.int64)
set_values: Final = bind(change, _NONE, 0, _ROWS, _NONE.values)
start_ramps: Final = bind(depart, _NONE, 0, _ROWS, _NONE.values, 0.0)
end_ramps: Final = bind(stay, _NONE, 0)
next_beat: Final = bind(step, _NONE)
