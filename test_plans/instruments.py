"""Instruments of a rig: errors of every reading from data sheet and certificate, read from a TOML file.

Every value has a unit, a source and a provenance (measured, data sheet or assumed). The errors of a reading without an
instrument are unknown, so values computed from it have no uncertainty.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from datetime import date, timedelta
from functools import cache
from pathlib import Path
from typing import Any, Final

from bench_protocol.entries import EntryError, as_table, read_entry, refuse_unknown
from bench_protocol.named_files import ORDINARY_RIG, label, read_named
from bench_protocol.suggestion import did_you_mean
from bench_protocol.table import TABLE

#: The kind of its named files.
PACKAGE: Final = "instruments"

#: Validity of a calibration without a due date in the file.
INTERVAL: Final = timedelta(days=365)
#: The properties of an instrument; "signal" represents the SI unit of its readings.
PROPERTIES: Final = {
    "offset": "signal",
    "gain": "1",
    "nonlinearity": "signal",
    "lag": "s",
    "resolution": "signal",
    "noise": "signal",
}
#: Name of the file in errors.
_FILE: Final = "a file of instruments"
_PIECE: Final = ("instrument", "serial_number", "certificate", "calibrated", "due")


class InstrumentsError(ValueError):
    """Raised if a file of instruments lacks an entry or has an invalid one."""


@dataclass(frozen=True, slots=True)
class Instrument:
    """A type of instrument. The errors (SI) are half-widths of uniform distributions.

    ``resolution`` is a step, ``noise`` the standard deviation of one sample, and ``nonlinearity`` the largest deviation
    of its characteristic from the line between the ends of its range.
    """

    name: str
    type: str
    offset: float = 0.0
    gain: float = 0.0  #: a fraction of the reading
    nonlinearity: float = 0.0
    lag: float = 0.0  #: s, in addition to the lag that plans compensate
    resolution: float = 0.0
    noise: float = 0.0


@dataclass(frozen=True, slots=True)
class Piece:
    """One individual instrument, which measures one signal, and its calibration."""

    signal: str
    instrument: Instrument
    serial_number: str
    certificate: str = ""
    calibrated: date | None = None
    due: date | None = None

    @property
    def holds_until(self) -> date | None:
        """The last day on which the calibration is valid: the due date, otherwise `INTERVAL` after the calibration."""
        return self.due or (self.calibrated + INTERVAL if self.calibrated else None)

    def overdue(self, today: date | None) -> bool:
        """Return whether the calibration has expired on the date ``today``; False if ``today`` is None."""
        return bool(today and self.holds_until and today > self.holds_until)

    def trouble(self, today: date | None) -> str:
        """Return the reason why the calibration is not valid ``today``; "" if it is valid. Without a date (None) it is
        not checked whether the calibration is overdue.
        """
        piece = f"{self.signal} ({self.instrument.type}, no. {self.serial_number})"
        if not self.certificate:
            return f"{piece} has no certificate of calibration"
        if self.holds_until is None:
            return f"{piece}: calibration {self.certificate} says neither when it was nor when it is due"
        if not self.overdue(today):
            return ""
        since = (
            f"was due on {self.due}"
            if self.due
            else f"is of {self.calibrated}, {INTERVAL.days} days are assumed"
        )
        return f"{piece}: calibration {self.certificate} {since}"


@dataclass(frozen=True, slots=True)
class Instruments:
    """The instruments of a rig by signal."""

    file: str = ""
    sha256: str = ""
    pieces: Mapping[str, Piece] = field(default_factory=dict)

    def troubles(self, today: date | None, signals: Collection[str] = ()) -> list[str]:
        """Return a text for each calibration that is not valid ``today``: of the instruments of ``signals``, or
        of all.
        """
        found = []
        for name in signals or self.pieces:
            piece = self.pieces.get(name)
            found.append(
                piece.trouble(today) if piece else f"{name} has no instrument in {self.file or 'any file'}"
            )
        return [one for one in found if one]

    @property
    def facts(self) -> dict[str, Any]:
        """Entries for the record: the file, and the signal and calibration of each piece."""
        if not self.file:
            return {}
        return {
            "file": self.file,
            "sha256": self.sha256,
            "pieces": [
                {
                    "signal": piece.signal,
                    "type": piece.instrument.type,
                    "serial_number": piece.serial_number,
                    "certificate": piece.certificate,
                    "calibrated": piece.calibrated.isoformat() if piece.calibrated else "",
                    "due": piece.due.isoformat() if piece.due else "",
                }
                for piece in self.pieces.values()
            ],
        }


#: Instruments of a rig without a file of instruments.
UNKNOWN: Final = Instruments()


@cache
def ordinary() -> Instruments:
    """Return the instruments of the virtual bench."""
    return read_instruments(ORDINARY_RIG)


def read_instruments(name: str | Path, home: Path = Path()) -> Instruments:
    """Read instruments from a TOML file relative to ``home``, or from the supplied file with this name.

    Raises InstrumentsError, with file, key, value and unit, if the file cannot be read or has an invalid entry.
    """
    path, sha256, content = read_named(PACKAGE, name, home, InstrumentsError)
    try:
        return Instruments(label(path), sha256, _pieces(content))
    except EntryError as error:
        raise InstrumentsError(f"instruments {path}: {error}") from None


def _pieces(content: Mapping[str, Any]) -> dict[str, Piece]:
    refuse_unknown("", content, ("instrument", "signal"), _FILE)
    kinds, pieces = as_table("instrument", content.get("instrument", {})), {}
    for signal, entry in as_table("signal", content.get("signal", {})).items():
        key = f'signal."{signal}"'
        if signal not in TABLE.index:
            raise EntryError(f"{key} is not a signal; {did_you_mean(signal, TABLE.index)}")
        refuse_unknown(f"{key}.", as_table(key, entry), _PIECE, _FILE)
        name = entry.get("instrument")
        if name not in kinds:
            raise EntryError(
                f"{key}.instrument = {name!r} is not described; {did_you_mean(str(name), kinds)}"
            )
        for day in ("calibrated", "due"):
            if day in entry and type(entry[day]) is not date:  # a datetime is a date in Python, too
                raise EntryError(
                    f"{key}.{day} = {entry[day]!r} is not a date; write it like 2027-02-03, without quotes"
                )
        instrument = _instrument(name, kinds[name], TABLE[signal].si)
        rest = {one: entry[one] for one in _PIECE[2:] if one in entry}
        pieces[signal] = Piece(signal, instrument, str(entry.get("serial_number", "")), **rest)
    return pieces


def _instrument(name: str, entry: Mapping[str, Any], si: str) -> Instrument:
    key = f"instrument.{name}"
    refuse_unknown(f"{key}.", as_table(key, entry), ("type", *PROPERTIES), _FILE)
    values = {
        one: _value(f"{key}.{one}", entry[one], si if unit == "signal" else unit)
        for one, unit in PROPERTIES.items()
        if one in entry
    }
    return Instrument(name, str(entry.get("type", name)), **values)


def _value(key: str, raw: Any, si: str) -> float:
    entry = read_entry(key, raw, si)
    if (value := entry.si()) < 0.0:
        raise EntryError(f"{key} = {entry.parts['value']:g} {entry.unit} is not a half-width; use 0 or more")
    return value
