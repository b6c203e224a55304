"""The black box: records readings and events of the bench in the ten seconds before and after a trip or fault.

The tick writes every sample to a ring buffer. Ten seconds after the trip, the buffer is copied to the record of the
incident. The record stays until the next incident after a reset. It is read as Modbus files (function 20). File 1
describes the incident, and each other file contains the samples of one channel (see `bench_protocol.black_box`).
"""

from collections import deque
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.black_box import CHANNELS, NO_SAMPLE, SAMPLE_MAX, Incident, files_of
from bench_protocol.rates import FAST_RATE
from bench_protocol.table import TABLE
from bench_sim.model.compiled import compiled
from bench_sim.rig.controls import Happened
from bench_sim.rig.incident_story import IncidentEvent, story

BEFORE: Final = round(10.0 * FAST_RATE)
AFTER: Final = round(10.0 * FAST_RATE)
_ROOM: Final = BEFORE + 1 + AFTER
_EVENTS_MAX: Final = 200

#: State of the box; times in samples since the rig started.
_BOX: Final = np.dtype(
    [
        ("written", "<i8"),
        ("trigger", "<i8"),  # the sample of the incident that is being recorded, -1: none
    ]
)


class Tape(NamedTuple):
    """The buffer that the tick writes: the latest samples of all channels, as integer multiples of the signal's
    resolution.
    """

    box: npt.NDArray[np.void]  #: one record
    samples: npt.NDArray[np.int16]  #: (_ROOM, channels)
    rows: npt.NDArray[np.int64]  #: of the channels in the table
    steps: npt.NDArray[np.float64]  #: SI


@compiled
def write_sample(tape: Any, values: Any) -> int:
    """Write one sample of all channels. Return `Happened.RECORDED` if it completes the record of an incident."""
    box = tape.box[0]
    place = box.written % _ROOM
    for channel in range(tape.rows.size):
        steps = values[tape.rows[channel]] / tape.steps[channel]
        if np.isnan(steps):
            tape.samples[place, channel] = NO_SAMPLE
        else:
            tape.samples[place, channel] = int(np.rint(min(max(steps, -SAMPLE_MAX), SAMPLE_MAX)))
    box.written += 1
    if box.trigger >= 0 and box.written > box.trigger + AFTER:
        return int(Happened.RECORDED.value)
    return int(Happened.NOTHING.value)


class BlackBox:
    """The black box of one rig. It waits for an incident, records one, or keeps the record of one."""

    def __init__(self) -> None:
        self.tape = Tape(
            np.zeros(1, _BOX),
            np.full((_ROOM, len(CHANNELS)), NO_SAMPLE, np.int16),
            np.array([TABLE.index[name] for name in CHANNELS], np.int64),
            np.array([TABLE[name].step for name in CHANNELS]),
        )
        self._box: Any = self.tape.box[0]
        self._box["trigger"] = -1
        self._armed = True
        self._events: deque[IncidentEvent] = deque(maxlen=_EVENTS_MAX)
        self._cause = self._signal = ""
        self._tick = 0
        self._kept: Incident | None = None
        self._reported_events: tuple[IncidentEvent, ...] = ()
        self._count = 0
        self._files: dict[int, list[int]] = {}

    def note(self, tick: int, text: str) -> None:
        """Store an event at ``tick``."""
        self._events.append(IncidentEvent(tick, text))

    def trigger(self, tick: int, cause: str, signal: str = "") -> None:
        """Start the record of an incident, unless there was one since the last reset. ``tick`` is the time in ms since
        the rig started. ``signal`` is the one that exceeded its limit, or "".
        """
        if self._armed and self._box["trigger"] < 0:
            self._armed = False
            self._box["trigger"] = max(0, self._box["written"] - 1)
            self._tick, self._cause, self._signal = tick, cause, signal

    def rearm(self) -> None:
        """Allow the next incident to replace the kept record. This is called after a reset."""
        self._armed = True

    def keep(self) -> None:
        """Copy the buffer to the record of the incident, ten seconds after the trip."""
        box, tape = self._box, self.tape
        written, trigger = int(box["written"]), int(box["trigger"])
        first = max(0, trigger - BEFORE)
        order = np.arange(first, written) % _ROOM
        self._count += 1
        self._kept = Incident(
            self._count, self._tick, trigger - first, tape.samples[order].T.copy(), "", CHANNELS
        )
        self._reported_events = tuple(self._events)
        self._files = {}
        box["trigger"] = -1

    def read_file(self, number: int) -> list[int]:
        """Return the Modbus registers of one file. The list is empty if there is no such file."""
        if not self._files:
            incident = self._kept or Incident(0, 0, 0, np.zeros((len(CHANNELS), 0), np.int16), "", CHANNELS)
            if self._kept is not None:
                incident = incident._replace(
                    story=story(incident, self._cause, self._signal, self._reported_events)
                )
            self._files = files_of(incident)
        if number == 1:
            head = self._files[1]
            return [*head[:1], int(self._box["trigger"] >= 0), *head[2:]]
        return self._files.get(number, [])
