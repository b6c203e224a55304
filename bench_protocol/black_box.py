"""Format of the rig's black box on the wire: Modbus files of 16-bit registers (function 20).

File 1, the incident::

    register   0        1          2       3-4    5        6        7       8         9      10 ...
               format   recording  number  tick   samples  trigger  period  channels  bytes  story in UTF-8

``recording`` is 1 while the next incident is being recorded; ``number`` counts the incidents since the rig started, 0
before the first; ``tick`` is the rig's own time of the incident in ms, high word first; ``trigger`` is the index of the
sample of the incident, ``period`` the time between samples in ms, ``bytes`` the length of the story. The files from 2
on are the samples of one channel each, in the order of `CHANNELS`: signed multiples of the signal's step, 0x8000 for
none.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from bench_protocol.rates import FAST_RATE
from bench_protocol.signals import Kind
from bench_protocol.table import TABLE
from bench_protocol.units import ms

_FORMAT: Final = 1
_HEAD: Final = 10
INDEX_FILE: Final = 1
_FIRST_CHANNEL: Final = 2
NO_SAMPLE: Final = -0x8000
SAMPLE_MAX: Final = 0x7FFF
_PERIOD: Final = round(1.0 / (FAST_RATE * ms))

#: All measurements, and the state of the bench.
CHANNELS: Final = (
    *(signal.name for signal in TABLE.of_kind(Kind.MEASUREMENT)),
    "rig.state",
    "rig.program",
    "rig.reason",
)


class Incident(NamedTuple):
    """One record of the black box."""

    number: int  #: counted from 1; 0: there is none
    tick: int  #: the rig's own time of the incident (ms)
    trigger: int  #: the sample at which it happened
    samples: npt.NDArray[np.int16]  #: (channels, n), in steps
    story: str
    channels: tuple[str, ...]

    @property
    def times(self) -> npt.NDArray[np.float64]:
        """The times of the samples relative to the incident (s): (n,)."""
        return (np.arange(self.samples.shape[1]) - self.trigger) / FAST_RATE

    def values(self, name: str) -> npt.NDArray[np.float64]:
        """Return the samples of a channel (SI), NaN without a reading: (n,)."""
        raw = self.samples[self.channels.index(name)]
        return np.where(raw == NO_SAMPLE, np.nan, raw * TABLE[name].step)


def files_of(incident: Incident) -> dict[int, list[int]]:
    """Return the register contents of all files of ``incident``, by file number."""
    text = incident.story.encode()
    words = np.frombuffer(text + bytes(len(text) % 2), ">u2")
    count = incident.samples.shape[1]
    head = [_FORMAT, 0, incident.number & 0xFFFF, incident.tick >> 16 & 0xFFFF, incident.tick & 0xFFFF]
    head += [count, incident.trigger, _PERIOD, len(incident.channels), len(text)]
    files = {INDEX_FILE: [*head, *words.tolist()]}
    if count:
        for channel, samples in enumerate(incident.samples):
            files[_FIRST_CHANNEL + channel] = samples.view(np.uint16).tolist()
    return files


#: Reads ``count`` registers of a file: (file, record, count).
ReadFile = Callable[[int, int, int], Sequence[int]]


class Head(NamedTuple):
    """The fields of file 1 before the report of the incident."""

    recording: bool
    number: int
    tick: int
    samples: int
    trigger: int
    channels: int
    story: int  #: bytes


def read_head(read: ReadFile) -> Head:
    """Return the head of file 1. Raises ValueError if it has another format."""
    form, recording, number, high, low, count, trigger, period, channels, size = read(INDEX_FILE, 0, _HEAD)
    if form != _FORMAT or period != _PERIOD or channels > len(CHANNELS):
        raise ValueError(
            f"the black box has format {form}, {channels} channels every {period} ms, which this "
            "version cannot read; use the version of ASTB that the rig uses"
        )
    return Head(bool(recording), number, high << 16 | low, count, trigger, channels, size)


def read_incident(read: ReadFile, at_once: int) -> Incident:
    """Return the incident in the black box; its number is 0 if there is none. A request reads up to ``at_once``
    registers.
    """
    head = read_head(read)

    def registers(file: int, first: int, count: int) -> npt.NDArray[np.uint16]:
        parts = [
            read(file, at, min(at_once, first + count - at)) for at in range(first, first + count, at_once)
        ]
        return np.array([word for part in parts for word in part], np.uint16)

    text = registers(INDEX_FILE, _HEAD, (head.story + 1) // 2).astype(">u2").tobytes()[: head.story]
    samples = np.zeros((head.channels, head.samples), np.int16)
    for channel in range(head.channels if head.samples else 0):
        samples[channel] = registers(_FIRST_CHANNEL + channel, 0, head.samples).view(np.int16)
    return Incident(head.number, head.tick, head.trigger, samples, text.decode(), CHANNELS[: head.channels])
