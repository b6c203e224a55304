"""The parts of a report for its signatures: operator, specimen, date, place, instruments, and checksums of
the files.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any, Final, NamedTuple

from bench_records.checksums import sha256_of
from bench_records.layout import PARQUET, RESULT
from bench_records.record import Record
from bench_records.result import Result
from bench_records.typography import THIN_SPACE, plain, seconds

#: Roles of the signatures.
ROLES: Final = ("tested by", "checked by", "approved by")
#: The last date of the calendar; as a due date it means "never due".
NO_DAY: Final = date.max.isoformat()
NEVER: Final = "no due date"
#: Number of characters of the record's checksum in the footer of every page.
SHORT: Final = 12


class Entry(NamedTuple):
    """One fact in the head of a report. If the text is empty, there is a line to fill in by hand."""

    name: str
    text: str


class Instrument(NamedTuple):
    """An instrument, and the names of the readings that it measured."""

    readings: str
    type: str
    serial_number: str
    certificate: str
    calibrated: str
    due: str


def identification(record: Record, result: Result, duration: float) -> list[Entry]:
    """Return the entries of the first table in a report: the standard entries, even if empty, and further ones of
    this run.
    """
    meta, specimen = record.meta, result.specimen
    virtual = meta.get("time") == "virtual"
    entries = [
        Entry("date", "none (virtual time)" if virtual else _date(str(meta.get("date", "")))),
        Entry("operator", str(meta.get("operator", ""))),
        Entry("specimen", specimen.type if specimen else ""),
        Entry("serial number", specimen.serial_number if specimen else ""),
        Entry("drawing", specimen.drawing if specimen else ""),
        Entry("ambient", str(meta.get("ambient", ""))),
    ]
    timing = result.timing
    more = {
        "rig": result.rig,
        "parameter set": _named(meta.get("parameters")),
        **{f"{name.replace('_', ' ')}": text for name, text in result.parameters.items()},
        "software": ", commit ".join(filter(None, (_version(meta), str(meta.get("commit", ""))))),
        "duration": seconds(duration),
        "recorded samples": f"{len(record):,}".replace(",", THIN_SPACE),
        "random seed": "" if result.seed is None else str(result.seed),
        "late ticks": str(timing.late) if timing and timing.max is not None else "",
    }
    return entries + [Entry(name, text) for name, text in more.items() if text]


def instruments_of(meta: Mapping[str, Any]) -> list[Instrument]:
    """Return the instruments of a run, each once, with all its readings."""
    instruments = meta.get("instruments", {})
    found: dict[tuple[str, ...], list[str]] = {}
    for piece in instruments.get("pieces", ()) if isinstance(instruments, dict) else ():
        key = tuple(
            str(piece.get(name, "")) for name in ("type", "serial_number", "certificate", "calibrated", "due")
        )
        found.setdefault(key, []).append(str(piece.get("signal", "")).replace(".", " ").replace("_", " "))
    rows = [Instrument(", ".join(readings), *key) for key, readings in found.items()]
    return [one._replace(due=NEVER) if one.due == NO_DAY else one for one in rows]


def files_of(directory: Path) -> list[tuple[str, str]]:
    """Return the names of the source files of a report, with their checksums."""
    return [(name, sha256_of(directory / name)) for name in (PARQUET, RESULT) if (directory / name).exists()]


def footing(result: Result, files: list[tuple[str, str]]) -> str:
    """Return the footer of every printed page, escaped for a string in a style sheet.

    All characters except letters and digits are escaped by their number, so no text can end the string.
    """
    record = next((f"record {checksum[:SHORT]}" for name, checksum in files if name == PARQUET), "")
    serial = f"no. {result.specimen.serial_number}" if result.specimen else ""
    text = "  ·  ".join(filter(None, (result.plan, serial, record)))
    return "".join(one if one.isascii() and one.isalnum() else f"\\{ord(one):x} " for one in text)


def _date(text: str) -> str:
    return text.replace("T", " ").replace("Z", " UTC")


def _named(parameters: Any) -> str:
    return str(parameters.get("name", "")) if isinstance(parameters, dict) else ""


def _version(meta: Mapping[str, Any]) -> str:
    versions = meta.get("versions", {})
    return f"astb {plain(versions['astb'])}" if isinstance(versions, dict) and "astb" in versions else ""
