"""Excel workbooks: a run with its checks, its curves and its record at one rate, or the trends of checks."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.extras import installed, lacking
from bench_records.layout import RecordError

if TYPE_CHECKING:
    from bench_records.curves import Curve
    from bench_records.record import Record
    from bench_records.result import Check, Result
    from bench_records.trend import Trend

#: Rows that a sheet has, its head included.
ROWS: Final = 1 << 20
#: Texts from users are written as texts, not as formulas or links.
_OPTIONS: Final = {
    "strings_to_formulas": False,
    "strings_to_urls": False,
    "nan_inf_to_errors": True,
    "in_memory": True,
}
_BAD: Final = ("fail", "error")
_CHECK: Final = (
    *(
        "phase",
        "check",
        "value",
        "± U",
        "unit",
        "low",
        "high",
        "verdict",
        "probability of conformity",
        "note",
    ),
    "purpose",
)
_CURVE: Final = ("group", "curve", "x", "unit of x", "y", "unit of y", "± U", "low", "high")
_TREND: Final = (
    *("check", "when (UTC)", "run", "plan", "phase", "rig", "value", "± U", "unit", "low", "high"),
    "verdict",
)
_TRENDS: Final = ("check", "unit", "runs", "mean", "scatter", "drift a day", "± 95 %", "drift is seen")


@contextmanager
def workbook(path: Path) -> Iterator[Any]:
    """Yield a workbook of xlsxwriter. After the ``with`` block it is written to ``path``.

    Raises RecordError if the extra `excel` is not installed, and OSError if the file cannot be written.
    """
    if not installed("excel"):
        raise RecordError(lacking("excel", "tables for Excel"))
    import xlsxwriter

    made = io.BytesIO()
    with xlsxwriter.Workbook(made, _OPTIONS) as book:
        yield book
    path.write_bytes(made.getvalue())


def write_row(sheet: Any, place: int, values: Sequence[Any], *form: Any) -> None:
    """Write values to a row of a sheet. Texts stay texts, numbers stay numbers, and an unknown value gives an empty
    cell.
    """
    for column, value in enumerate(values):
        if isinstance(value, str):
            sheet.write_string(place, column, value, *form)
        elif isinstance(value, datetime):
            sheet.write_datetime(place, column, value, *form)
        elif value is not None and math.isfinite(value):
            sheet.write_number(place, column, value, *form)


def write_run(record: Record, result: Result | None, path: Path, rate: float, names: Sequence[str]) -> int:
    """Write a run: facts, checks, curves, and its record at ``rate`` (Hz). Return the number of rows of the record.

    Raises RecordError for an unknown name, if a sheet cannot have that many rows, or if the extra `excel` is not
    installed.
    """
    from bench_records.exchange import table_of

    frame = table_of(record, rate, names)
    if len(frame) >= ROWS:
        fits = (ROWS - 1) / max(record.duration, 1.0)
        raise RecordError(
            f"the table has {len(frame)} rows, but a sheet of Excel has {ROWS}; use a rate of at most {fits:.3g} Hz"
        )
    with workbook(path) as book:
        if result is not None:
            _sheet(book, "run", ("what", ""), _facts(result))
            bad = book.add_format({"bg_color": "#fcd9d6"})
            rows = [(_check_row(one), [bad] if one.verdict.value in _BAD else []) for one in result.checks]
            _sheet(book, "checks", _CHECK, (row for row, _ in rows), [form for _, form in rows])
            if result.curves:
                _sheet(book, "curves", _CURVE, (row for one in result.curves for row in _curve_rows(one)))
        columns = (str(frame.index.name), *frame.columns)
        _sheet(book, "record", columns, frame.itertuples(name=None))
    return len(frame)


def write_trends_book(trends: Sequence[Trend], path: Path) -> None:
    """Write trends: one sheet with a summary of each, and one with all values. Raises RecordError if the extra
    `excel` is not installed.
    """
    with workbook(path) as book:
        _sheet(book, "trends", _TRENDS, map(_trend_row, trends))
        date = book.add_format({"num_format": "yyyy-mm-dd hh:mm:ss"})
        sheet = _sheet(book, "values", _TREND, (row for one in trends for row in _value_rows(one)))
        sheet.set_column(1, 1, 19, date)


def _sheet(
    book: Any, name: str, heads: Sequence[str], rows: Iterable[Sequence[Any]], forms: Sequence[list[Any]] = ()
) -> Any:
    sheet = book.add_worksheet(name)
    sheet.write_row(0, 0, heads, book.add_format({"bold": True, "text_wrap": True, "valign": "top"}))
    count = 0
    for count, row in enumerate(rows, 1):
        write_row(sheet, count, row, *(forms[count - 1] if forms else ()))
    sheet.freeze_panes(1, 0)
    sheet.autofilter(0, 0, count, len(heads) - 1)
    return sheet


def _facts(result: Result) -> list[tuple[str, Any]]:
    facts = {
        "plan": result.plan,
        "title": result.title,
        "verdict": result.verdict.value,
        "reason": result.reason,
        "began (UTC)": result.began,
        "rig": result.rig,
        "specimen": str(result.specimen or ""),
        "operator": result.operator,
        "surroundings": result.ambient,
        "seed": result.seed,
        **result.parameters,
    }
    return [(name, value) for name, value in facts.items() if value not in (None, "")]


def _in_display_unit(value: float | None, scale: float) -> float | None:
    return None if value is None else value / scale


def _check_row(one: Check) -> tuple[Any, ...]:
    sizes = (_in_display_unit(n, one.scale) for n in (one.number, one.expanded))
    limits = (_in_display_unit(n, one.scale) for n in (one.low, one.high))
    note = one.note or one.without
    return (
        one.phase,
        one.name,
        *sizes,
        one.unit,
        *limits,
        one.verdict.value,
        one.conformity,
        note,
        one.about,
    )


def _curve_rows(one: Curve) -> Iterator[tuple[Any, ...]]:
    for place, (x, y) in enumerate(zip(one.xs, one.ys, strict=True)):
        expanded, low, high = (some[place] if some else None for some in (one.expanded, one.lows, one.highs))
        yield (
            one.group,
            one.name,
            None if x is None else one.x.shown(x),
            one.x.unit,
            None if y is None else one.y.shown(y),
            one.y.unit,
            _in_display_unit(expanded, one.y.scale),
            *(None if n is None else one.y.shown(n) for n in (low, high)),
        )


def _trend_row(one: Trend) -> tuple[Any, ...]:
    last = one.checks[-1]
    sizes = (
        one.mean,
        one.scatter,
        *((one.drift.per_day, one.drift.half_width) if one.drift else (None, None)),
    )
    seen = "" if one.drift is None else "yes" if one.drift.is_seen else "no"
    return (one.name, last.unit, len(one.checks), *(_in_display_unit(n, last.scale) for n in sizes), seen)


def _value_rows(trend: Trend) -> Iterator[tuple[Any, ...]]:
    for one in trend.checks:
        began = datetime.fromisoformat(one.run.began).replace(tzinfo=None)
        value, expanded, low, high = (
            _in_display_unit(n, one.scale) for n in (one.value, one.expanded, one.low, one.high)
        )
        where = (one.run.directory, one.run.plan, one.phase, one.run.rig)
        yield trend.name, began, *where, value, expanded, one.unit, low, high, one.verdict
