"""Measured tracks from tables: deviation of the rails from their nominal line, over distance or time.

The table (CSV, Parquet, Arrow) has a column ``distance`` or ``time``. It also has some of ``vertical`` (up),
``lateral`` (to the left), ``cant`` (height of the left rail above the right) and ``roll`` (left side up). Each head has
a unit, such as ``vertical [mm]``. Further columns are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

import numpy as np

from bench_protocol.account import Account
from bench_protocol.units import UNITS, m
from bench_records.layout import RecordError
from bench_records.tables.keys import FileKeys, Source
from bench_records.tables.numbers import numbers, of_the_file
from bench_records.tables.reading import read_sheet
from bench_records.tables.sheet import Sheet
from test_plans.analysis import Samples

#: Axes of the platform by name of the column, and the SI unit of the column.
WAYS: Final[Mapping[str, tuple[str, str]]] = {
    "vertical": ("platform.vertical", "m"),
    "lateral": ("platform.lateral", "m"),
    "cant": ("platform.roll", "m"),
    "roll": ("platform.roll", "rad"),
}
#: The abscissa of a table, and its SI unit.
CLOCKS: Final[Mapping[str, str]] = {"distance": "m", "time": "s"}
_NAMED: Final = re.compile(r"\s*(?P<name>[^\[(]*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?\s*")
#: Distance between the middles of the rails, to which cant refers (EN 13848-1).
BASE: Final = 1.5 * m
#: Smallest number of rows of a track.
LEAST_ROWS: Final = 8
#: A step is a gap if it is longer than the usual step by this factor.
GAP: Final = 4.0


class NoTrack(ValueError):
    """Raised if a file is not a track record. The text has file, column, line, value and correction."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackRecord:
    """A track: the motions ``ways`` (m or rad, each (n,)) by the reading of the platform, at increasing ``places``
    (n,).

    ``places`` are in m along the line, or in s if ``timed``. ``unread`` are the ignored columns.
    """

    name: str
    places: Samples
    ways: Mapping[str, Samples]
    timed: bool = False
    digest: str = ""
    unread: tuple[str, ...] = ()

    def times(self, speed: float) -> Samples:
        """Return the time (s, from 0 on) at which a train of ``speed`` (m/s) is at each place. A record over time has
        its own times.
        """
        return (self.places - self.places[0]) / (1.0 if self.timed else speed)

    def at(self, times: Samples, speed: float) -> dict[str, Samples]:
        """Return the motions at equally spaced ``times`` (s, (n,)) for a train of ``speed`` (m/s), minus their means.

        Rows are joined by straight lines and averaged over one step, so that no wave shorter than two steps appears as
        a longer one. Beyond its ends the track continues the outermost lines.
        """
        when = self.times(speed)
        half = 0.5 * (times[1] - times[0])
        edges = np.append(times - half, times[-1] + half)
        found = {}
        for name, way in self.ways.items():
            area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(when) * (way[1:] + way[:-1]))])
            k = np.clip(np.searchsorted(when, edges, "right") - 1, 0, when.size - 2)
            within, slope = edges - when[k], np.diff(way)[k] / np.diff(when)[k]
            mean = np.diff(area[k] + within * (way[k] + 0.5 * slope * within)) / np.diff(edges)
            found[name] = mean - mean.mean()
        return found


def read_track(path: Path) -> TrackRecord:
    """Read a track from a table. Raises NoTrack for an invalid file: gaps, wrong units, or places that do not
    increase.
    """
    try:
        keys = FileKeys()
        sheet = _plainly_named(read_sheet(path, keys, [], Account()))
        clock = _clock(sheet)
        columns = {name: sheet.place(name, str(path)) for name in WAYS if sheet.places(name)}
        if not columns:
            raise NoTrack(
                f"{path} has none of the columns {', '.join(WAYS)}; it has {', '.join(sheet.names)}"
            )
        if {"cant", "roll"} <= set(columns):
            raise NoTrack(f"{path} has cant and roll, which state the same; remove one of them")
        places = _column(sheet, clock, CLOCKS[clock])
        read = {name: _column(sheet, name, WAYS[name][1]) for name in columns}
    except RecordError as error:
        raise NoTrack(str(error)) from None
    _refuse_steps(sheet, clock, places)
    ways = {WAYS[name][0]: np.arctan(way / BASE) if name == "cant" else way for name, way in read.items()}
    unread = tuple(name for name in sheet.names if name != clock and name not in columns)
    digest = sha256(path.read_bytes()).hexdigest()
    return TrackRecord(str(path), places, ways, clock == "time", digest, unread)


def _plainly_named(sheet: Sheet) -> Sheet:
    """Split the header of each column, such as "Vertical [mm]", into a name in lower case and a unit. Changes the
    ``sheet`` and returns it.
    """
    for column in sheet.columns:
        if found := _NAMED.fullmatch(column.name):
            column.name = found["name"].lower()
            column.unit = column.unit or (found["unit"] or "").strip()
    return sheet


def _clock(sheet: Sheet) -> str:
    found = [name for name in CLOCKS if sheet.places(name)]
    if len(found) == 1:
        return found[0]
    which = "both" if found else "neither"
    raise NoTrack(f"{sheet.path} has {which} of the columns distance and time; give exactly one of them")


def _column(sheet: Sheet, name: str, si: str) -> Samples:
    """Return a column in SI. Raises NoTrack without a unit, with a wrong one, or for cells without a number."""
    index = sheet.place(name, str(sheet.path))
    column, where = sheet.columns[index], f"{sheet.path}: {name}"
    right = ", ".join(one for one in ("mm", "m", "km", "s", "ms", "mrad", "rad") if _factor(one, si))
    factor = _factor(column.unit, si)
    if factor is None:
        text = f"has the unit {column.unit!r}" if column.unit else "has no unit"
        raise NoTrack(f'{where} {text}; use a head such as "{name} [{right.partition(",")[0]}]" ({right})')
    if column.kind == "text":
        source = Source(column=index + 1)
        values = numbers(sheet, index, source, of_the_file(sheet, FileKeys(), [(index, source)]), None, where)
    elif column.kind == "number":
        values = np.asarray(column.cells, np.float64)
    else:
        raise NoTrack(f"{where} has {column.what or column.kind} instead of numbers; use a column of numbers")
    if values.size < LEAST_ROWS:
        raise NoTrack(f"{sheet.path} has {values.size} rows; a track needs {LEAST_ROWS} or more")
    lacking = np.flatnonzero(~np.isfinite(values))
    if lacking.size:
        more = f", and in {lacking.size - 1} more" if lacking.size > 1 else ""
        raise NoTrack(
            f"{where} has no number in {sheet.at(int(lacking[0]))}{more}; fill the gap, or cut the file there"
        )
    return values * factor


def _factor(unit: str, si: str) -> float | None:
    if unit == "km":
        return 1000.0 if si == "m" else None
    one = UNITS.get({"µm": "um", "°": "deg"}.get(unit, unit))
    return one.factor if one is not None and one.si == si else None


def _refuse_steps(sheet: Sheet, clock: str, places: Samples) -> None:
    unit = CLOCKS[clock]
    rises = np.diff(places)
    if (rises <= 0.0).any():
        at = int(np.argmax(rises <= 0.0)) + 1
        how = "stands still at" if rises[at - 1] == 0.0 else f"falls from {places[at - 1]:.10g} to"
        raise NoTrack(
            f"{sheet.path}: {clock} {how} {places[at]:.10g} {unit} in {sheet.at(at)}; it must rise "
            "from row to row"
        )
    usual = float(np.median(rises))
    at = int(np.argmax(rises))
    if rises[at] > GAP * usual:
        raise NoTrack(
            f"{sheet.path}: {clock} jumps by {rises[at]:.4g} {unit} in {sheet.at(at + 1)}, where rows are mostly "
            f"{usual:.4g} {unit} apart: a gap; cut the file there"
        )
