"""Every form of a table in the reference page is read, refused, or read with its omissions reported."""
# ruff: noqa: E501

from __future__ import annotations

import io
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench_protocol.account import Account
from bench_records.layout import RecordError
from bench_records.tables.keys import FileKeys, Source, TimeSource
from bench_records.tables.reading import Series, read_series
from bench_records.tables.stamps import read_stamps
from tools.generate.readers_page import table

TIMES = np.arange(30) / 100.0
X = np.round(np.linspace(-20.0, 1250.25, 30), 4)
P = np.round(5.0 + 0.5 * np.sin(np.arange(30)), 3)
START = datetime(2026, 3, 19, 10, 0, tzinfo=UTC)
#: The header of a segment of a LabVIEW measurement file, and of the first.
SEGMENT = "Channels\t2\n***End_of_Header***\n"
LVM = f"LabVIEW Measurement\n***End_of_Header***\n{SEGMENT}"


def csv(
    head: str = "time,x,p",
    cells: Callable[[float, float, float], str] = lambda t, x, p: f"{t:.2f},{x:.4f},{p:.3f}",
    above: str = "",
    below: str = "",
    change: tuple[str, str] = ("", ""),
) -> bytes:
    rows = [cells(*row) for row in zip(TIMES, X, P, strict=True)]
    text = above + "\n".join([head, *rows]) + "\n" + below
    return text.replace(*change, 1).encode() if change[0] else text.encode()


def clock(form: Callable[[float], str]) -> bytes:
    return csv(cells=lambda t, x, p: f"{form(t)},{x:.4f},{p:.3f}")


def times(form: Callable[[datetime], str]) -> bytes:
    return csv(cells=lambda t, x, p: f"{form(START + timedelta(seconds=t))},{x:.4f},{p:.3f}")


def comma(number: float, digits: int = 4) -> str:
    return f"{number:.{digits}f}".replace(".", ",")


def german(t: float, x: float, p: float) -> str:
    return ";".join((comma(t, 2), comma(x), comma(p, 3)))


FRAME = pd.DataFrame({"x": X, "p": P}, index=pd.Index(TIMES, name="time"))
DATES = pd.DatetimeIndex([START + timedelta(seconds=float(t)) for t in TIMES])


def parquet(frame: pd.DataFrame) -> bytes:
    out = io.BytesIO()
    frame.to_parquet(out)
    return out.getvalue()


def arrow(frame: pd.DataFrame) -> bytes:
    out = io.BytesIO()
    frame.to_feather(out)
    return out.getvalue()


def indexed(index: Any) -> bytes:
    return parquet(pd.DataFrame({"x": X, "p": P}, index=index))


def with_time(values: Any, kind: Callable[[pd.DataFrame], bytes] = parquet) -> bytes:
    return kind(pd.DataFrame({"time": values, "x": X, "p": P}))


#: By the name of the form: the file, its suffix, keys of the file and the clock, and the expected message.
FORMS: dict[str, tuple[bytes, str, dict[str, Any], str]] = {
    "plain": (csv(), ".csv", {}, ""),
    "semicolons": (csv("time;x;p", german), ".csv", {}, ""),
    "tabs": (csv("time\tx\tp", lambda t, x, p: f"{t:.2f}\t{x:.4f}\t{p:.3f}"), ".txt", {}, ""),
    "columns": (csv("  time      x      p", lambda t, x, p: f"{t:8.2f} {x:12.4f} {p:9.3f}"), ".dat", {}, ""),
    "sep": (csv("time|x|p", lambda t, x, p: f"{t:.2f}|{x:.4f}|{p:.3f}", above="sep=|\n"), ".csv", {}, ""),
    "quotes": (csv('"time","x","p"', lambda t, x, p: f'"{t:.2f}","{x:,.4f}","{p:.3f}"'), ".csv", {}, ""),
    "thousands": (csv("time;x;p", lambda t, x, p: f"{comma(t, 2)};{f'{x:,.4f}'.translate(str.maketrans(',.', '.,'))};{comma(p, 3)}"), ".csv", {}, ""),
    "apostrophes": (csv(cells=lambda t, x, p: f"{t:.2f},{f'{x:,.4f}'.replace(',', chr(39))},{p:.3f}"), ".csv", {}, ""),
    "an open number": (csv("time;x;p", lambda t, x, p: f"{round(100 * t)};{round(x)};{p:.3f}"), ".csv", {"unit": "ms"}, r'p: "5\.\d{3}" in line \d+ may be a thousand or have three decimals; give file.decimal'),
    "spaces": (csv(" time , x , p "), ".csv", {}, ""),
    "units": (csv(above="", head="time,x,p\ns,mm,bar"), ".csv", {}, "line 2 is read as units: s, mm, bar"),
    "trailing": (csv(cells=lambda t, x, p: f"{t:.2f},{x:.4f},{p:.3f},"), ".csv", {}, "an empty field at the end of rows"),
    "empty columns": (csv("time,x,p,,,", lambda t, x, p: f"{t:.2f},{x:.4f},{p:.3f},,,"), ".csv", {}, ""),
    "more fields": (csv(change=("0.05,", "0.05,7,")), ".csv", {}, "line 7 has 4 cells, but the head has 3"),
    "fewer fields": (csv(change=("0.05,", "")), ".csv", {}, "line 7 has 2 cells, but the head has 3"),
    "twice": (csv("time,x,p,x", lambda t, x, p: f"{t:.2f},{x:.4f},{p:.3f},0"), ".csv", {}, 'x.column = "x": the columns 2 and 4 have this name; give the number'),
    "titles": (csv(above="Test 7\nOperator: A, B\n\n"), ".csv", {}, r"2 lines above the head"),
    "comments": (csv("# time,x,p", above="# made by numpy\n"), ".csv", {}, "1 line above the head"),
    "text below": (csv(below=",,\nEnd of data\n"), ".csv", {}, r"1 line of text below the values \(line 33\), 1 row of empty cells"),
    "text between": (csv(change=("\n0.05,", "\npause\n0.05,")), ".csv", {}, 'line 7, "pause", is text between rows of values'),
    "head again": (csv(below="time,x,p\n0.5,1,2\n"), ".csv", {}, "line 32 is the head again"),
    "cut": (csv() + b"0.30,1", ".csv", {}, r"1 row within which the file ends \(line 32\)"),
    "missing": (csv(below="0.30,#N/A,---\n0.31,-inf,NaN\n"), ".csv", {}, r"3 cells without a number \(the first: line 32, x: #N/A\), 1 infinite value"),
    "no number": (csv(change=("0.05,", "0.05,=1+")), ".csv", {}, 'x: "=1+.*" in line 7 is not a number'),
    "marked": (b"\xef\xbb\xbf" + csv(), ".csv", {}, ""),
    "utf-16": (csv().decode().encode("utf-16"), ".csv", {}, "the text is in UTF-16"),
    "cp1252": (csv("time;x;p;Größe".encode("cp1252").decode("latin-1"), lambda t, x, p: german(t, x, p) + ";0").decode().encode("latin-1"), ".csv", {}, "is not UTF-8 and is read as cp1252"),
    "binary": (b"time,x,p\n0,\x001,2\n", ".csv", {}, "is not a text file: line 2 has a byte 0"),
    "empty": (b"\n\n", ".csv", {}, "is empty"),
    "iso": (times(lambda t: t.strftime("%Y-%m-%d %H:%M:%S.%f")), ".csv", {}, "the record begins at 2026-03-19 10:00:00.000$"),
    "iso with zone": (times(lambda t: (t.astimezone(tz=None)).isoformat()), ".csv", {}, "the record begins at 2026-03-19 10:00:00.000 UTC"),
    "german dates": (times(lambda t: t.strftime("%d.%m.%y %H:%M:%S.%f")), ".csv", {}, "begins at 2026-03-19 10:00:00"),
    "american dates": (times(lambda t: t.strftime("%m/%d/%Y %I:%M:%S.%f %p")), ".csv", {}, "begins at 2026-03-19 10:00:00"),
    "open dates": (times(lambda t: (t - timedelta(days=10 + (t.microsecond < 150_000))).strftime("%m/%d/%Y %H:%M:%S.%f")), ".csv", {}, 'day or month may come first; give dates = "dmy" or "mdy"'),
    "month names": (times(lambda t: t.strftime("%d-%b-%Y %H:%M:%S.%f")), ".csv", {}, "begins at 2026-03-19"),
    "times of day": (times(lambda t: (t + timedelta(hours=13, minutes=59, seconds=59.9)).strftime("%H:%M:%S.%f")), ".csv", {}, "the clock passes midnight before line 12"),
    "hours and minutes": (times(lambda t: t.strftime("%H:%M")), ".csv", {}, "this may be hours and minutes, or minutes and seconds"),
    "date and time": (csv("day,time,x,p", lambda t, x, p: f"{START + timedelta(seconds=t + 50_399.9):%d.%m.%Y,%H:%M:%S.%f},{x:.4f},{p:.3f}"), ".csv", {"date": "day"}, "the columns day and time are one clock\nthe record begins at 2026-03-19 23:59:59.900"),
    "date alone": (csv("time,of day,x,p", lambda t, x, p: f"{START + timedelta(seconds=t):%Y-%m-%d,%H:%M:%S.%f},{x:.4f},{p:.3f}"), ".csv", {}, r"time.column: the column holds dates without times of day, and many .* \(the key date\)"),
    "halves apart": (csv("time,half,x,p", lambda t, x, p: f"{START + timedelta(seconds=t):%I:%M:%S.%f,%p},{x:.4f},{p:.3f}"), ".csv", {}, 'a.m. and p.m. are in a separate column, "half"'),
    "unknown unit": (csv("time,x,p\nfortnight,mm,bar"), ".csv", {}, '"fortnight" is not a known unit'),
    "two units": (csv("time,x,p\nms,mm,bar"), ".csv", {"unit": "s"}, 'the column is in ms by its head, but time.unit = "s"'),
    "unix": (csv(cells=lambda t, x, p: f"{1_700_000_000 + t:.2f},{x:.4f},{p:.3f}"), ".csv", {}, "the times are Unix times; the record begins at 2023-11-14 22:13:20.000 UTC"),
    "unix in ms": (csv(cells=lambda t, x, p: f"{1_700_000_000_000 + 1000 * t:.0f},{x:.4f},{p:.3f}"), ".csv", {}, 'is not a valid time of a record; if these are Unix times, give time.unit = "ms"'),
    "unix in ns": (csv(cells=lambda t, x, p: f"{1_700_000_000_000_000_000 + round(1e9 * t)},{x:.4f},{p:.3f}"), ".csv", {"unit": "ns"}, "Unix times"),
    "excel": (csv(cells=lambda t, x, p: f"{46100 + t / 86400:.12f},{x:.4f},{p:.3f}"), ".csv", {"unit": "d"}, "the times are days of Excel; the record begins at 2026-03-19 00:00:00"),
    "labview": (csv(cells=lambda t, x, p: f"{3_856_759_200 + t:.2f},{x:.4f},{p:.3f}"), ".csv", {}, "counts since 1904.* begins at 2026-03-19"),
    "falls": (csv(below="0.00,1,2\n0.01,1,2\n"), ".csv", {}, "the clock falls from 0.29 s to 0 s in line 32; times must not fall"),
    "stands": (csv(change=("\n0.05,", "\n0.04,")), ".csv", {}, "the clock does not advance in 1 row, first in line 7"),
    "leaps": (csv(below="3600.0,1,2\n"), ".csv", {}, "the clock leaps once, first by 3599.71 s before line 32"),
    "was set": (csv(below="1700000000,1,2\n"), ".csv", {}, "before line 32 the clock leaps by 53.1 years"),
    "no time": (csv(below=",1,2\n"), ".csv", {}, "line 32 has a value, but no time"),
    "summer time": (times(lambda t: (t.replace(month=10, day=25, hour=2, minute=59, second=59, microsecond=900_000) + (t - START) - timedelta(hours=t.microsecond > 95_000)).strftime("%Y-%m-%d %H:%M:%S.%f")), ".csv", {"zone": "Europe/Berlin"}, "begins at 2026-10-25 00:59:59.900 UTC"),
    "hours of minutes": (clock(lambda t: f"{int(3599.9 + t) // 60 % 60:02d}:{(3599.9 + t) % 60:05.2f}"), ".csv", {}, "minutes and seconds"),
    "unpadded milliseconds": (clock(lambda t: f"10:00:00.{round(1000 * t)}"), ".csv", {}, "whole milliseconds"),
    "four digits": (clock(lambda t: f"10:00:0{(round(100 * t) + 85) // 100}.{(round(100 * t) + 85) % 100 * 10:04d}"), ".csv", {}, "whole milliseconds"),
    "four digits behind a colon": (clock(lambda t: f"10:00:00:{round(1e4 * t):04d}"), ".csv", {}, "times of day"),
    "durations": (clock(lambda t: f"PT1M{2.5 + t:.2f}S"), ".csv", {}, "durations"),
    "skipped hour": (clock(lambda t: f"2026-03-29 02:59:59.{round(1e3 * t):03d}"), ".csv", {"zone": "Europe/Berlin"}, "has no 2026-03-29 02:59:59"),
    "power cut": (csv() + bytes(4096), ".csv", {}, r"1 line with bytes 0.*line 32"),
    "segments": (csv("time\tx\tp", lambda t, x, p: f"{t:.2f}\t{x:.4f}\t{p:.3f}", LVM, f"{SEGMENT}time\tx\tp\n0.3\t1\t2\n"), ".lvm", {"format": "csv"}, "line 37 ends the head of a second segment"),
    "workbook": (b"PK", ".xlsx", {}, "ssconvert a.xlsx a.csv"),
    "no clock": (csv("x,p", lambda t, x, p: f"{x:.4f},{p:.3f}"), ".csv", {"rate": 100.0}, "100 rows a second"),
    "rate beside a clock": (csv(), ".csv", {"rate": 100.0}, "has a time column, and file.rate is for tables without one"),
    "parquet": (with_time(TIMES), ".parquet", {}, ""),
    "index": (parquet(FRAME), ".parquet", {}, ""),
    "dates in the index": (indexed(DATES.rename("when")), ".parquet", {}, "the index when is the clock"),
    "nameless index": (indexed(DATES.tz_localize(None)), ".parquet", {}, "the index is the clock"),
    "timedelta": (with_time(pd.to_timedelta(TIMES, unit="s")), ".parquet", {}, ""),
    "microseconds": (with_time(DATES.as_unit("us")), ".parquet", {}, "begins at 2026-03-19 10:00:00.000 UTC"),
    "date and time in parquet": (parquet(pd.DataFrame({"day": DATES.date, "time": DATES.time, "x": X, "p": P})), ".parquet", {"date": "day"}, "the record begins at 2026-03-19 10:00:00.000"),
    "texts in parquet": (with_time([f"{t:.2f}" for t in TIMES]), ".parquet", {}, ""),
    "lists in parquet": (parquet(pd.DataFrame({"time": TIMES, "x": [[1.0]] * 30, "p": P})), ".parquet", {}, 'the column "x" holds values of the kind list'),
    "cut parquet": (parquet(FRAME)[:-40], ".parquet", {}, "is not a complete Parquet file"),
    "arrow": (with_time(TIMES, arrow), ".arrow", {}, ""),
    "feather": (with_time(DATES, arrow), ".feather", {}, "the record begins at 2026-03-19 10:00:00.000 UTC"),
}  # fmt: skip


def read(path: Path, keys: dict[str, Any]) -> tuple[dict[str, Series], Account]:
    account = Account()
    of_time = {key: value for key, value in keys.items() if key in ("unit", "date")}
    time = TimeSource(**of_time)
    file = FileKeys(**{key: value for key, value in keys.items() if key not in of_time})
    found = read_series(path, file, time, {"x": Source(column="x"), "p": Source(column="p")}, account)
    return found, account


@pytest.mark.parametrize("form", table("tables").forms, ids=lambda form: form.name)
def test_every_form_of_a_table_is_what_the_page_says(form, tmp_path) -> None:
    content, suffix, keys, said = FORMS[form.name]
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    if form.outcome == "refused":
        with pytest.raises(RecordError, match=said) as refused:
            read(path, keys)
        assert str(path) in str(refused.value)
        return
    found, account = read(path, keys)
    for name, values in (("x", X), ("p", P)):
        series = found[name]
        np.testing.assert_allclose(series.values[:30], values, rtol=1e-12)
        coarse = form.name in ("excel", "stands")
        np.testing.assert_allclose(series.times[:30] - series.times[0], TIMES, atol=0.011 if coarse else 2e-7)
    assert bool(account.counts) == (form.outcome == "left out"), account.lines()
    text = "\n".join(account.lines())
    assert re.search(said, text, re.MULTILINE), text
    assert text or not said


def test_the_page_lists_every_form() -> None:
    assert [form.name for form in table("tables").forms] == list(FORMS)


@given(
    step=st.sampled_from([1, 2, 5, 10, 40, 100, 1000]),
    begin=st.integers(0, 10**6),
    gap=st.integers(0, 3000),
    digits=st.sampled_from([0, 3, 4, 6]),
)
def test_decimals_behind_seconds_stay_decimals(step: int, begin: int, gap: int, digits: int) -> None:
    """Whatever a clock skips, and whether zeros stand at its end."""
    ms = begin + step * np.arange(50) + gap * (np.arange(50) > 25)
    cells = []
    for one in ms.tolist():
        fraction = f"{one % 1000:03d}000"
        fraction = fraction[:digits] if digits else fraction.rstrip("0")
        second = one // 1000
        cells.append(
            f"{second // 3600:02d}:{second // 60 % 60:02d}:{second % 60:02d}"
            + f".{fraction}" * bool(fraction)
        )
    found = read_stamps(cells)
    np.testing.assert_array_equal(found.ns, ms * 10**6)
