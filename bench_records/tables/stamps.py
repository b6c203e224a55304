"""Reads dates and times of day in various formats as integer nanoseconds."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import date
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

from bench_records.layout import SECOND

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

DAY: Final = 86_400 * SECOND
_MONTHS: Final = {
    name: number
    for number, names in enumerate(
        ("jan", "feb", "mar mär mrz mae", "apr", "may mai", "jun", "jul", "aug", "sep", "oct okt", "nov", "dec dez"), 1
    )
    for name in names.split()
}  # fmt: skip
_ZONES: Final = {"": None, "z": 0, "utc": 0, "gmt": 0, "cet": 60, "mez": 60, "cest": 120, "mesz": 120}
_DATE: Final = (
    r"(?:(?:[A-Za-z]{2,10}\.?,?\s+)?"
    r"(?:(?P<iso>\d{4}[-/.]\d{1,2}[-/.]\d{1,2})|(?P<dots>\d{1,2}\.\d{1,2}\.\d{2}(?:\d{2})?)"
    r"|(?P<open>\d{1,2}[/-]\d{1,2}[/-]\d{2}(?:\d{2})?)|(?P<day>\d{1,2}\.?[-\s]?[^\W\d_]{3,9}\.?[-\s]?,?\s?\d{4})"
    r"|(?P<month>[^\W\d_]{3,9}\.?\s\d{1,2},?\s\d{4})))"
)
_TIME: Final = (
    r"(?P<h>\d{1,3}):(?P<m>\d{2})(?::(?P<s>\d{2}))?(?:[.,](?P<f>\d{1,9})\d*|:(?P<ms>\d{3,9}))?"
    r"(?:\s?(?P<half>[AaPp])\.?[Mm]\.?)?"
)
_ZONE: Final = r"(?:\s?(?P<zone>Z|z|UTC|GMT|CES?T|MES?Z|[+-]\d{2}(?::?\d{2})?))?"
_STAMP: Final = re.compile(rf"{_DATE}(?:[T\s,;_]+{_TIME}{_ZONE})?")
_OF_DAY: Final = re.compile(rf"(?:(?P<days>-?\d+) days?,?\s+\+?)?{_TIME}")
_SPAN: Final = re.compile(r"P(?:(\d+)D)?T(?=\d)(?:(\d+)H)?(?:(\d+)M)?(?:(\d+)(?:[.,](\d{1,9})\d*)?S)?")
_HOUR: Final = 3600 * SECOND
#: A decrease by a day, less a gap of up to a minute, is midnight.
_MIDNIGHT: Final = 60 * SECOND


class Stamps(NamedTuple):
    """Time stamps (n,) in ns. If ``dated``, they count from 1970; if ``zoned``, they are in UTC. ``there`` is False
    for a missing one, which is 0.
    """

    ns: npt.NDArray[np.int64]
    there: npt.NDArray[np.bool_]
    dated: bool
    zoned: bool
    remarks: Sequence[str]


class NotAStamp(Exception):
    """A cell is not a time stamp. The exception has the index of the cell, and a hint for the message.

    With ``without_zone``, the cell has a time zone, but the cell with this index has none.
    """

    def __init__(
        self,
        index: int,
        hint: str = "write times as hh:mm:ss, dates as 2026-03-19",
        without_zone: int | None = None,
    ) -> None:
        super().__init__(index, hint, without_zone)
        self.index, self.hint, self.without_zone = index, hint, without_zone

    def text(self, cells: Sequence[str | None], at: Callable[[int], str]) -> str:
        """Return the message; ``at`` returns the place of a cell in the file as text."""
        cell = f'"{cells[self.index]}" in {at(self.index)}'
        if self.without_zone is not None:
            other = f'"{cells[self.without_zone]}" in {at(self.without_zone)}'
            return f"{cell} has a time zone, but {other} has none; {self.hint}"
        return f"{cell} is not a time{' like those before it' if self.index else ''}: {self.hint}"


def looks_like_a_stamp(text: str) -> bool:
    """Return whether a text is a date, a time of day or a duration."""
    return bool(_STAMP.fullmatch(text) or _OF_DAY.fullmatch(text) or _SPAN.fullmatch(text))


def looks_like_a_date(text: str) -> bool:
    """Return whether a text is a date, without a time of day or with 00:00."""
    found = _STAMP.fullmatch(text)
    return found is not None and not (found["h"] and _time(found, 0))


def looks_like_a_time_of_day(text: str) -> bool:
    """Return whether a text is a time of day."""
    found = _OF_DAY.fullmatch(text)
    return found is not None and not found["days"]


def read_stamps(cells: Sequence[str | None], dates: Literal["dmy", "mdy"] | None = None) -> Stamps:
    """Return the time stamps in text cells. ``dates`` is the order of day and month.

    Raises NotAStamp for an invalid cell, and for an ambiguous one without ``dates``.
    """
    import numpy as np

    ns = np.zeros(len(cells), np.int64)
    there = np.array([cell is not None for cell in cells])
    example = next((cell for cell in cells if cell is not None), "")
    if _SPAN.fullmatch(example):
        for index, cell in enumerate(cells):
            if cell is not None:
                ns[index] = _span(cell, index)
        return Stamps(ns, there, dated=False, zoned=False, remarks=("the times are durations",))
    parts = np.zeros(len(cells), np.int64)
    if first := _OF_DAY.fullmatch(example):
        for index, cell in enumerate(cells):
            if cell is not None:
                ns[index] = _of_day(cell, index)
                parts[index] = _digits(_OF_DAY.fullmatch(cell))
        ns, remarks = _whole_milliseconds(ns, there, parts)
        if first["s"] is None:
            ns, there = over_midnight(ns, there, _HOUR)
            remarks.append("the times are minutes and seconds, and continue after each hour")
        return Stamps(*over_midnight(ns, there), dated=False, zoned=False, remarks=remarks)
    days = _Days(cells, dates)
    zones: dict[bool, int] = {}  # the first cell without (True) and with (False) a zone
    for index, cell in enumerate(cells):
        if cell is None:
            continue
        found = _STAMP.fullmatch(cell)
        if found is None:
            raise NotAStamp(index)
        of_day = _time(found, index) if found["h"] else 0
        if of_day > DAY or (found["h"] and not found["s"] and (found["f"] or found["ms"])):
            raise NotAStamp(index)
        offset = _zone(found["zone"])
        zones.setdefault(offset is None, index)
        parts[index] = _digits(found)
        ns[index] = days.of(found, index) * DAY + of_day - (offset or 0) * 60 * SECOND
    if len(zones) == 2:
        raise NotAStamp(zones[False], "write all times with a zone, or all without", zones[True])
    ns, remarks = _whole_milliseconds(ns, there, parts)
    return Stamps(ns, there, dated=days.known, zoned=False in zones, remarks=[*days.remarks, *remarks])


def _span(cell: str, index: int) -> int:
    """Return an ISO 8601 duration, such as PT1M2.5S, in nanoseconds."""
    found = _SPAN.fullmatch(cell)
    if found is None:
        raise NotAStamp(index, "write durations as PT1.5S")
    days, hours, minutes, seconds = (int(one or 0) for one in found.groups()[:4])
    whole = ((days * 24 + hours) * 60 + minutes) * 60 + seconds
    return whole * SECOND + int((found[5] or "").ljust(9, "0"))


def _digits(found: re.Match[str] | None) -> int:
    """Return the digits after the seconds as an integer, plus 1 000 000 000 times the number of these digits."""
    text = (found and (found["f"] or found["ms"])) or ""
    return len(text) * SECOND + int(text or 0)


def _whole_milliseconds(
    ns: npt.NDArray[np.int64], there: npt.NDArray[np.bool_], parts: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], list[str]]:
    """If the decimals of the seconds give an uneven clock, read their digits as integer milliseconds. Return the times
    and remarks.

    ``parts`` are from `_digits`. Some programs write 10:00:00.0, .10 … .990 for 0 to 990 ms, or four digits, such as
    .0990 for 990 ms.
    """
    import numpy as np

    lengths, digits = parts // SECOND, parts % SECOND
    read = digits * 10 ** (9 - lengths)
    milliseconds = ns - read + digits * (SECOND // 1000)
    odd = lengths[there]
    if odd.size < 3 or not ((odd != 3) & (odd > 0)).any() or odd.max() > 4 or digits.max() >= 1000:
        return ns, []
    steps, others = np.diff(ns[there]), np.diff(milliseconds[there])
    falls = (steps < 0) & (others >= 0)
    uneven = steps.max() > 5 * np.median(steps)
    if (falls.any() or uneven) and others.min() >= 0 and others.max() <= 2 * np.median(others):
        return milliseconds, ["the digits behind the seconds are whole milliseconds"]
    return ns, []


def _of_day(cell: str, index: int) -> int:
    found = _OF_DAY.fullmatch(cell)
    if found is None:
        raise NotAStamp(index)
    if found["s"] is None and not (found["f"] or found["ms"]):
        raise NotAStamp(
            index, "this may be hours and minutes, or minutes and seconds; write times as hh:mm:ss"
        )
    return int(found["days"] or 0) * DAY + _time(found, index)


def _time(found: re.Match[str], index: int) -> int:
    """Return a time of day in nanoseconds. Two numbers with a fraction are minutes and seconds."""
    hours, minutes, seconds = int(found["h"]), int(found["m"]), int(found["s"] or 0)
    fraction = found["f"] or found["ms"] or ""
    if found["s"] is None and fraction:
        hours, minutes, seconds = 0, hours, minutes
    if half := found["half"]:
        if not 1 <= hours <= 12:
            raise NotAStamp(index, "with a.m. and p.m., the hour must be 1 to 12")
        hours = hours % 12 + (12 if half in "Pp" else 0)
    if minutes > 59 or seconds > 60:
        raise NotAStamp(index, "the minutes must be 0 to 59, and the seconds 0 to 60")
    return (hours * 3600 + minutes * 60 + seconds) * SECOND + int(fraction.ljust(9, "0") or 0)


def _zone(text: str | None) -> int | None:
    """Return the offset of a time zone from UTC in minutes (east positive), or None if there is no zone."""
    word = (text or "").lower()
    if word in _ZONES:
        return _ZONES[word]
    digits = word[1:].replace(":", "").ljust(4, "0")
    return (int(digits[:2]) * 60 + int(digits[2:])) * (-1 if word[0] == "-" else 1)


class _Days:
    """Converts dates in cells to days since 1970. Each different text is converted once."""

    def __init__(self, cells: Sequence[str | None], dates: Literal["dmy", "mdy"] | None) -> None:
        self._known: dict[str, int] = {}
        self.remarks: list[str] = []
        self.known = True
        open_: dict[str, int] = {}
        start = _STAMP.fullmatch(next((cell for cell in cells if cell is not None), ""))
        for index, cell in enumerate(cells) if start is not None and start["open"] else ():
            found = _STAMP.fullmatch(cell) if cell is not None else None
            if found is not None and found["open"]:
                open_.setdefault(found["open"], index)
        self._order = dates or _order(open_)
        if open_ and self._order is None:
            if len(open_) > 1:
                raise NotAStamp(
                    next(iter(open_.values())),
                    'day or month may come first; give dates = "dmy" or "mdy"',
                )
            self.known, self._order = False, "dmy"
            (text,) = open_
            self.remarks.append(
                f"{text} may begin with the day or the month, so the record has no date and begins at the first row; "
                'for the date, give dates = "dmy" or "mdy"'
            )

    def of(self, found: re.Match[str], index: int) -> int:
        """Return the days since 1970 for the date in a cell."""
        if found["open"] and self._order is None:
            raise NotAStamp(index, "the column has dates of two forms; use one form")
        text = next(one for one in (found[kind] for kind in ("iso", "dots", "open", "day", "month")) if one)
        if text not in self._known:
            try:
                self._known[text] = self._days(found, text)
            except (ValueError, KeyError):
                raise NotAStamp(index, "there is no such day in the calendar; correct the date") from None
        return self._known[text]

    def _days(self, found: re.Match[str], text: str) -> int:
        numbers = [int(one) for one in re.findall(r"\d+", text)]
        if found["iso"]:
            year, month, day = numbers
        elif found["day"] or found["month"]:
            day, year = numbers
            month = _MONTHS[re.findall(r"[^\W\d_]+", text)[0].lower()[:3]]
        else:
            day, month, year = numbers
            if found["open"] and self._order == "mdy":
                day, month = month, day
            year += 2000 if year < 100 else 0
        return date(year, month, day).toordinal() - date(1970, 1, 1).toordinal()


def _order(texts: dict[str, int]) -> Literal["dmy", "mdy"] | None:
    """Return whether day or month is first in dates such as 03/09/2026. A number above 12 shows it; return None if
    there is none.

    Raises NotAStamp if the dates contradict each other.
    """
    firsts, seconds = [], []
    for text in texts:
        one, other = (int(number) for number in re.findall(r"\d+", text)[:2])
        firsts.append(one)
        seconds.append(other)
    if max(firsts, default=0) > 12 and max(seconds, default=0) > 12:
        raise NotAStamp(
            next(iter(texts.values())), "some dates begin with the day, others with the month; use one form"
        )
    if max(firsts, default=0) > 12:
        return "dmy"
    return "mdy" if max(seconds, default=0) > 12 else None


def over_midnight(
    ns: npt.NDArray[np.int64], there: npt.NDArray[np.bool_], period: int = DAY
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.bool_]]:
    """Return times of day that continue after midnight, so that they do not decrease. ``there`` (n,) marks the rows
    that have a time, and is returned unchanged.

    With another ``period`` (ns), counters that restart after this period are continued.
    """
    import numpy as np

    rows = np.flatnonzero(there)
    steps = np.diff(ns[rows])
    midnight = (steps < 0) & (
        steps + period <= np.maximum(_MIDNIGHT, 10 * np.median(np.abs(steps)) if steps.size else 0)
    )
    ns = ns.copy()
    ns[rows[1:]] += np.cumsum(midnight) * period
    return ns, there
