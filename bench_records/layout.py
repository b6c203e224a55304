"""The format of a record on disk: its files, columns and metadata.

A record is one directory. During the run it contains the stream ``record.arrows`` (Arrow IPC). After a run that was
killed, this stream remains, and can be read up to its last complete batch. After a complete run the directory contains
``record.parquet`` with the columns

* ``time_ns``: int64, nanoseconds on the clock of the run;
* ``signal``: dictionary of string, the signal's name in the table of signals;
* ``value``: float64 in SI units; NaN if the rig had no value;

and key-value metadata. Each entry of the meta data is a JSON value under ``astb.<key>``. The entries ``astb.format``,
``astb.start_ns``, ``astb.signals`` and ``astb.events`` are always present.
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
    """A record cannot be written or read. The text states the record, the reason and a remedy."""


class SignalInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """Description of one signal for readers of the record.

    ``scale`` is the SI value of one display unit (``1e-3`` for ``mm``), so ``value / scale`` is the displayed value.
    Signals of one ``quantity`` share a panel of the report. A signal without a quantity is recorded, but not drawn.
    ``names`` maps the values of a discrete signal to words, and the report draws such a signal as a strip.
    """

    name: str
    unit: str = ""
    scale: float = 1.0
    label: str = ""
    quantity: str = ""
    names: dict[int, str] = {}

    def __post_init__(self) -> None:
        if not self.name:
            raise RecordError("a signal has an empty name; give each signal a name")
        if not (0.0 < self.scale < float("inf")):
            raise RecordError(
                f"{self.name}: scale = {self.scale}; the scale of the unit must be positive and finite"
            )

    @property
    def title(self) -> str:
        """Return the label, or the name if there is no label."""
        return self.label or self.name

    @property
    def shown_unit(self) -> str:
        """Return the display unit. Temperatures are recorded in kelvin and displayed in degrees Celsius."""
        return "degC" if self.unit == "K" else self.unit

    def shown(self, value: Any) -> Any:
        """Return a value, or an array of values, converted from SI to the display unit."""
        return (value - (ICE if self.unit == "K" else 0.0)) / self.scale


class RecordedEvent(msgspec.Struct, frozen=True, omit_defaults=True):
    """An event at one instant. ``kind`` is one word, such as state, trip, check or phase."""

    time_ns: int
    kind: str
    text: str
    data: dict[str, Any] = {}


class Phase(msgspec.Struct, frozen=True, omit_defaults=True):
    """A named part of the run, in seconds since the start of the record. Phases of level 0 are set-up, main and
    tear-down.
    """

    name: str
    start: float
    end: float
    level: int = 0

    @property
    def duration(self) -> float:
        """Return the length in seconds."""
        return self.end - self.start


class Condition(msgspec.Struct, frozen=True):
    """A precondition of a plan, and the state that was found. ``met`` is None if this could not be determined."""

    text: str
    met: bool | None
    found: str


def phases_of(events: list[RecordedEvent], start_ns: int, end_ns: int) -> list[Phase]:
    """Return the phases between begin and end events, in the order of their begin. Start and end of the record are in
    ns.

    If the end event of a phase is missing because the run was interrupted, the phase ends with the record, or with the
    phase around it.
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
            # Inner phases that an exception left open end together with the outer one.
            while still_open[-1][1].text != event.text:
                finish(event.time_ns)
            finish(event.time_ns)
    while still_open:
        finish(end_ns)
    return [phase for _, phase in sorted(zip(order, finished, strict=True), key=lambda pair: pair[0])]


def put(path: Path, data: bytes) -> None:
    """Write a file under another name and rename it when it is complete. So a reader never finds an incomplete file."""
    unfinished = path.with_name(path.name + ".part")
    with whole(unfinished, path):
        unfinished.write_bytes(data)


@contextmanager
def whole(unfinished: Path, path: Path) -> Iterator[None]:
    """Rename the file ``unfinished`` to ``path`` after the ``with`` block has written it. Delete it if that fails."""
    try:
        yield
        unfinished.replace(path)
    except BaseException:
        with suppress(OSError):
            unfinished.unlink()
        raise


def encode(value: Any) -> bytes:
    """Return a value as JSON. Keys are sorted and NaN is null, so equal values give equal bytes."""
    return msgspec.json.encode(msgspec.to_builtins(value, str_keys=True), order="sorted")


def flat(column: Any) -> Any:
    """Return a column of an Arrow table as one array. Arrow stores a column in chunks, even if there is only one."""
    whole = column.combine_chunks() if hasattr(column, "combine_chunks") else column
    return whole.chunk(0) if hasattr(whole, "chunk") else whole


def as_array(column: Any) -> npt.NDArray[Any]:
    """Return the numbers of a column without missing values as an array, without a copy. Arrow's ``to_numpy`` would
    import pandas (0.5 s).
    """
    import numpy as np

    return np.from_dlpack(flat(column))
