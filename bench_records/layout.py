"""The shape of a record on disk: its files, its columns, and the small things that travel as metadata.

A record is one directory.  While the run lasts, and for good if it was killed, it holds ``record.arrows`` (an Arrow
IPC stream: whatever has been written can be read, wherever the file breaks off); afterwards ``record.parquet``
with the columns

* ``time_ns``: int64, nanoseconds on the clock of the run;
* ``signal``: dictionary of string, the signal's name in the table of signals;
* ``value``: float64 in SI units; NaN where the rig had none to give;

and key-value metadata: one JSON value under ``astb.<key>`` for each entry of the meta data, with ``astb.format``,
``astb.start_ns``, ``astb.signals`` and ``astb.events`` always present.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

if TYPE_CHECKING:
    import numpy.typing as npt

FORMAT = "astb record 1"
STREAM = "record.arrows"
PARQUET = "record.parquet"
META = "meta.json"
RESULT = "result.json"
REPORT = "report.html"
JUNIT = "junit.xml"
PREFIX = "astb."
RESERVED = frozenset({"format", "start_ns", "signals", "events"})

SECOND = 1_000_000_000
#: 0 °C in K.
ICE = 273.15


class RecordError(Exception):
    """A record that cannot be written or read; the text says which, why, and what would help."""


class SignalInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a reader of the record must know of one signal.

    ``scale`` is the SI value of one display unit (``1e-3`` for ``mm``), so ``value / scale`` is what people read.
    Signals of one ``quantity`` share a panel of the report; without a quantity a signal is recorded, not drawn.
    ``names`` gives a discrete signal's values their words and makes it a strip instead of a line.
    """

    name: str
    unit: str = ""
    scale: float = 1.0
    label: str = ""
    quantity: str = ""
    names: dict[int, str] = {}

    def __post_init__(self) -> None:
        if not self.name:
            raise RecordError("a signal has an empty name; the record finds signals by name")
        if not (0.0 < self.scale < float("inf")):
            raise RecordError(
                f"{self.name}: scale = {self.scale} is no size of a unit; it must be positive and finite"
            )

    @property
    def title(self) -> str:
        """The label where there is one, else the name."""
        return self.label or self.name

    @property
    def shown_unit(self) -> str:
        """The unit in which people read it: what is recorded in kelvin is a temperature, told in degrees Celsius."""
        return "degC" if self.unit == "K" else self.unit

    def shown(self, value: Any) -> Any:
        """Return a value, or an array of values (SI), in the unit in which people read it."""
        return (value - (ICE if self.unit == "K" else 0.0)) / self.scale


class RecordedEvent(msgspec.Struct, frozen=True, omit_defaults=True):
    """Something that happened at one instant: ``kind`` is one word (state, trip, check, phase, ...)."""

    time_ns: int
    kind: str
    text: str
    data: dict[str, Any] = {}


class Phase(msgspec.Struct, frozen=True, omit_defaults=True):
    """A named stretch of the run, in seconds since the record began; level 0 holds set-up, main and tear-down."""

    name: str
    start: float
    end: float
    level: int = 0

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.end - self.start


class Condition(msgspec.Struct, frozen=True):
    """What had to be so before a plan began, and what was found; ``met`` is None where nothing told it."""

    text: str
    met: bool | None
    found: str


def phases_of(events: list[RecordedEvent], start_ns: int, end_ns: int) -> list[Phase]:
    """The phases told by begin and end events, in the order in which they began.

    A phase that nobody ended, because the run was cut off, ends with the record.
    """
    finished: list[Phase] = []
    order: list[int] = []
    still_open: list[tuple[int, RecordedEvent]] = []

    def finish(end: int) -> None:
        index, begin = still_open.pop()
        order.append(index)
        begun = (begin.time_ns - start_ns) / SECOND
        finished.append(Phase(begin.text, begun, max(begun, (end - start_ns) / SECOND), len(still_open)))

    for index, event in enumerate(events):
        if event.kind != "phase":
            continue
        if event.data.get("edge") == "begin":
            still_open.append((index, event))
        elif any(begin.text == event.text for _, begin in still_open):
            # What an exception left open inside a phase ends together with it.
            while still_open[-1][1].text != event.text:
                finish(event.time_ns)
            finish(event.time_ns)
    while still_open:
        finish(end_ns)
    return [phase for _, phase in sorted(zip(order, finished, strict=True), key=lambda pair: pair[0])]


def put(path: Path, data: bytes) -> None:
    """Write a file under another name until it is whole: whoever finds it finds all of it."""
    unfinished = path.with_name(path.name + ".part")
    with whole(unfinished, path):
        unfinished.write_bytes(data)


@contextmanager
def whole(unfinished: Path, path: Path) -> Iterator[None]:
    """Let a file be written as ``unfinished``, and then be ``path``; of one that cannot be, nothing is left."""
    try:
        yield
        unfinished.replace(path)
    except BaseException:
        with suppress(OSError):
            unfinished.unlink()
        raise


def encode(value: Any) -> bytes:
    """One value as JSON whose bytes depend on the value alone (keys sorted, NaN as null)."""
    return msgspec.json.encode(msgspec.to_builtins(value, str_keys=True), order="sorted")


def flat(column: Any) -> Any:
    """A column of an Arrow table as one array: Arrow gives it in chunks, even where there is only one."""
    whole = column.combine_chunks() if hasattr(column, "combine_chunks") else column
    return whole.chunk(0) if hasattr(whole, "chunk") else whole


def as_array(column: Any) -> npt.NDArray[Any]:
    """The numbers of a column without gaps, not copied. Arrow's own ``to_numpy`` would import pandas: half a second."""
    import numpy as np

    return np.from_dlpack(flat(column))
