"""Reads numbers from the cells of tables: decimal commas, separators of thousands, and codes for missing values."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import TYPE_CHECKING, Any, Final

from bench_records.layout import RecordError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from bench_protocol.account import Account
    from bench_records.tables.keys import FileKeys, Source
    from bench_records.tables.sheet import Sheet

#: Texts for a missing number in files of common programs, in capitals.
MISSING: Final = (
    *("NAN", "-NAN", "NA", "N/A", "#N/A", "#NV", "<NA>", "NAT", "NULL", "NONE", "---", "--", "-", "?", "*", "\u2013"),
    *("#VALUE!", "#WERT!", "#DIV/0!", "#REF!", "#BEZUG!", "#NAME?", "#NUM!", "#ZAHL!", "#NULL!"),
    *("1.#QNAN", "-1.#IND", "1.#IND", "1.#QNAN0", "-1.#IND00", "NO DATA"),
)  # fmt: skip
INFINITE: Final = (
    "INF",
    "+INF",
    "-INF",
    "INFINITY",
    "+INFINITY",
    "-INFINITY",
    "\u221e",
    "-\u221e",
    "1.#INF",
    "-1.#INF",
)
_SPACES: Final = "[ '\u2019\u00a0\u2009\u202f]"  # separators of thousands in Switzerland, France and ISO
_GROUPED: Final = rf"^[-+]?[0-9]{{1,3}}({_SPACES}[0-9]{{3}})+([.,][0-9]*)?$"
_LOOKED_AT: Final = 5000
_NUMBER: Final = r"^[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?$"


@dataclass(frozen=True)
class _Evidence:
    """The first rows that show which character is the decimal separator, and the first ambiguous rows."""

    certain: dict[str, int]
    open: dict[str, int]  #: rows with an ambiguous number such as 1.250, by separator
    between: frozenset[str]  #: certain separators of thousands


@dataclass(frozen=True)
class DecimalPoint:
    """The decimal separator of a file ("" if unknown), and whether a key states it."""

    point: str
    stated: bool = False


def first(mask: Any) -> int:
    """Return the index of the first True in an Arrow mask, or -1 if there is none."""
    import pyarrow as pa
    import pyarrow.compute as pc

    return int(pc.index(mask, pa.scalar(True)).as_py())


def tidy(cells: Any) -> Any:
    """Return cells without outer spaces and with a plain minus sign. Empty cells become null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    cells = pc.replace_substring(pc.utf8_trim_whitespace(cells), "\u2212", "-")
    return pc.if_else(pc.equal(cells, ""), pa.scalar(None, cells.type), cells)


def numbers(
    sheet: Sheet,
    index: int,
    source: Source,
    decimal: DecimalPoint,
    account: Account | None,
    where: str,
) -> npt.NDArray[np.float64]:
    """Return the numbers (n,) in a column of text, with NaN for an empty cell or a text that is a code for a missing
    value.

    ``decimal`` is the decimal separator to use if the column itself does not show it. Missing and infinite values are
    counted in ``account``. Raises RecordError, with line, for a cell that is not a number or is ambiguous.
    """
    import numpy as np
    import pyarrow as pa
    import pyarrow.compute as pc

    cells = without_missing(sheet, index, account)
    if texts := [one for one in source.null or () if isinstance(one, str)]:
        coded = pc.fill_null(pc.is_in(cells, pa.array(texts, cells.type)), False)
        if account is not None and (count := pc.sum(coded).as_py()):
            account.leave_out(
                "declared code(s)", count, f"{sheet.at(first(coded))}, {sheet.columns[index].name}"
            )
        cells = pc.if_else(coded, pa.scalar(None, cells.type), cells)
    plain = in_plain_digits(cells, sheet, index, source, decimal, where)
    try:
        values = pc.cast(plain, "double")
    except pa.ArrowInvalid:
        bad = pc.and_(pc.is_valid(plain), pc.invert(pc.match_substring_regex(plain, _NUMBER)))
        at = max(first(pc.fill_null(bad, False)), 0)
        raise RecordError(_no_number(sheet, index, at, source, where)) from None
    return np.asarray(values.to_numpy(zero_copy_only=False), dtype=np.float64)


def _no_number(sheet: Sheet, index: int, at: int, source: Source, where: str) -> str:
    cell = str(sheet.columns[index].cells[at])[:40]
    keys = (
        "correct the cell, or give the right file.delimiter, file.decimal or thousands"
        if sheet.delimiter
        else "choose a column of numbers"
    )
    return f'{where}: "{cell}" in {sheet.at(at)} is not a number; {keys}'


def without_missing(sheet: Sheet, index: int, account: Account | None) -> Any:
    """Return the cells of a column, with null for missing and infinite values. These are counted in ``account``."""
    import pyarrow as pa
    import pyarrow.compute as pc

    cells = tidy(sheet.columns[index].cells)
    capitals = pc.utf8_upper(cells)
    for words, what in ((MISSING, "cell(s) without a number"), (INFINITE, "infinite value(s)")):
        missing = pc.fill_null(pc.is_in(capitals, pa.array(words, cells.type)), False)
        count = pc.sum(missing).as_py() or 0
        if count:
            at = first(missing)
            if account is not None:
                account.leave_out(what, count, f"{sheet.at(at)}, {sheet.columns[index].name}: {cells[at]}")
            cells = pc.if_else(missing, pa.scalar(None, cells.type), cells)
    return cells


def in_plain_digits(
    cells: Any, sheet: Sheet, index: int, source: Source, decimal: DecimalPoint, where: str
) -> Any:
    """Return cells with a decimal point and without separators of thousands. Raises RecordError if they are
    ambiguous.
    """
    import pyarrow.compute as pc

    grouped = pc.fill_null(pc.match_substring_regex(cells, _GROUPED), False)
    if pc.any(grouped).as_py() and source.thousands is None:
        cells = pc.if_else(grouped, pc.replace_substring_regex(cells, _SPACES, ""), cells)
    point, between = _separators(cells, sheet, index, source, decimal, where)
    if between:
        group = re.escape(between)
        fits = (
            rf"^[-+]?([0-9]{{1,3}}({group}[0-9]{{3}})+|[0-9]*)({re.escape(point)}[0-9]*)?([eE][-+]?[0-9]+)?$"
        )
        bad = pc.and_(pc.is_valid(cells), pc.invert(pc.match_substring_regex(cells, fits)))
        if (at := first(pc.fill_null(bad, False))) >= 0:
            raise RecordError(
                f'{where}: "{cells[at]}" in {sheet.at(at)} is not a number with "{between}" between thousands and '
                f'"{point}" before decimals; correct thousands or decimal'
            )
        cells = pc.replace_substring(cells, between, "")
    return cells if point == "." else pc.replace_substring(cells, point, ".")


def _separators(
    cells: Any, sheet: Sheet, index: int, source: Source, decimal: DecimalPoint, where: str
) -> tuple[str, str]:
    """Return the decimal separator and the separator of thousands ("" for none)."""
    if source.thousands:
        opposite = {".": ",", ",": "."}.get(source.thousands)
        return source.decimal or opposite or decimal.point or ".", source.thousands
    found = evidence(cells)
    if source.decimal is None and len(found.certain) == 2:
        one, other = (f'"{cells[at]}" in {sheet.at(at)}' for at in sorted(found.certain.values()))
        raise RecordError(
            f"{where}: {one} and {other} have different decimal separators; use only one in a column"
        )
    point: str = source.decimal or "".join(found.certain)[:1] or decimal.point
    if not point:
        if found.open:
            separator, at = min(found.open.items(), key=itemgetter(1))
            cell = str(cells[at])
            raise RecordError(
                f'{where}: "{cell}" in {sheet.at(at)} may be a thousand or have three decimals; give file.decimal = '
                f'"{separator}" for {cell.replace(separator, ".")}, or file.decimal = '
                f'"{"," if separator == "." else "."}" for {cell.replace(separator, "")}'
            )
        point = "."
    other = "," if point == "." else "."
    if other in found.certain:
        at = found.certain[other]
        raise RecordError(
            f'{where}: "{cells[at]}" in {sheet.at(at)} does not match decimal = "{point}"; for this column, give '
            f'decimal = "{other}"'
        )
    # Three digits after the other separator are thousands if the column or a key defines the decimal separator.
    thousands = other in found.between or (
        other in found.open and (point in found.certain or bool(source.decimal) or decimal.stated)
    )
    if other in found.open and not thousands:
        at = found.open[other]
        raise RecordError(
            f'{where}: "{cells[at]}" in {sheet.at(at)} may be a thousand or have three decimals; give '
            f'thousands = "{other}" or decimal = "{other}" for this column'
        )
    return point, other if thousands else ""


def evidence(cells: Any) -> _Evidence:
    """Return what the cells of a column show about the separators."""
    import pyarrow.compute as pc

    # Shortcut: most columns have one separator, and a few rows show that it is the decimal one.
    there = {mark for mark in ".," if pc.any(pc.match_substring(cells, mark)).as_py()}
    if not there:
        return _Evidence({}, {}, frozenset())
    for point, other in ((".", ","), (",", ".")):
        if other not in there:
            start = cells.slice(0, _LOOKED_AT)
            shown = pc.match_substring_regex(
                start, rf"^[-+]?[0-9]*{re.escape(point)}[0-9]*([eE][-+]?[0-9]+)?$"
            )
            unclear = pc.match_substring_regex(
                start, rf"^[-+]?[1-9][0-9]{{0,2}}{re.escape(point)}[0-9]{{3}}$"
            )
            if (at := first(pc.fill_null(pc.and_(shown, pc.invert(unclear)), False))) >= 0:
                return _Evidence({point: at}, {}, frozenset())
    certain: dict[str, int] = {}
    open_: dict[str, int] = {}
    between: set[str] = set()
    for point, other in ((".", ","), (",", ".")):
        p, o = re.escape(point), re.escape(other)
        # With both separators the last one is for decimals. A separator that occurs twice is for thousands.
        last = rf"^[-+]?[0-9]{{1,3}}({o}[0-9]{{3}})+{p}[0-9]*([eE][-+]?[0-9]+)?$"
        twice = rf"^[-+]?[0-9]{{1,3}}({o}[0-9]{{3}}){{2,}}$"
        single = rf"^[-+]?[0-9]*{p}[0-9]*([eE][-+]?[0-9]+)?$"
        either = rf"^[-+]?[1-9][0-9]{{0,2}}{p}[0-9]{{3}}$"
        alone = pc.match_substring_regex(cells, single)
        unclear = pc.match_substring_regex(cells, either)
        groups = pc.or_(pc.match_substring_regex(cells, last), pc.match_substring_regex(cells, twice))
        if first(pc.fill_null(groups, False)) >= 0:
            between.add(other)
        shows = pc.or_(groups, pc.and_(alone, pc.invert(unclear)))
        if (at := first(pc.fill_null(shows, False))) >= 0:
            certain[point] = at
        if (at := first(pc.fill_null(unclear, False))) >= 0:
            open_[point] = at
    return _Evidence(certain, open_, frozenset(between))


def of_the_file(sheet: Sheet, keys: FileKeys, texts: Sequence[tuple[int, Source]]) -> DecimalPoint:
    """Return the decimal separator of a file: that of its key, otherwise the common one of its columns."""
    if keys.decimal is not None:
        return DecimalPoint(keys.decimal, stated=True)
    shown: set[str] = set()
    for index, source in texts:
        if source.thousands is None and source.decimal is None:
            shown |= set(evidence(without_missing(sheet, index, None)).certain)
    if len(shown) == 1:
        return DecimalPoint(shown.pop())
    # If commas separate columns, the point is the decimal separator; else 1.250 stays ambiguous.
    return DecimalPoint("." if not shown and sheet.delimiter in (",", " ") else "")
