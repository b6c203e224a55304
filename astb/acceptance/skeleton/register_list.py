"""Reads the points of a rig from a list of its Modbus registers, in the common forms of such lists."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

from astb.acceptance.skeleton.list_scales import (
    LeftOut,
    are_exponents,
    comma_in,
    factor_of,
    kind_of,
    null_of,
    scale_of,
    shared_registers,
    size_units,
    sized_type,
    unread_scaling,
)
from astb.acceptance.skeleton.list_words import (
    ACCESS,
    COLUMNS,
    DEVICES,
    DIGIT,
    OPEN,
    READ_BY,
    TABLES,
    WRITING,
)
from astb.acceptance.skeleton.points import DescribedPoint
from astb.acceptance.skeleton.written_units import unit_of
from bench_protocol.account import Account
from bench_protocol.input_limits import DESCRIPTION_BYTES, check_size
from bench_protocol.os_errors import file_errors
from bench_records.layout import RecordError
from bench_records.tables.text_table import cells_of, text_lines
from drivers.errors import WiringError

#: Ways to count addresses: as on the wire, from 1 in each table, or as Modicon numbers.
Counting = Literal["wire", "one", "modicon"]

#: Maximum number of digits of an address, for all ways to count.
_DIGITS: Final = 12


@dataclass(frozen=True)
class RegisterList:
    """The content of a list: its points, and notes on its interpretation."""

    points: list[DescribedPoint]
    notes: list[str]


@dataclass(frozen=True)
class _Row:
    line: int
    name: str
    table: str
    address: str
    type: str
    scale: str
    factor: str
    exponent: str
    size: str
    null: str
    divisor: str
    order: str
    function: str
    bit: str
    unit: str
    access: str
    text: str
    open: str = ""  #: unknown columns that may change its number


@dataclass(frozen=True)
class _Conventions:
    """The conventions of the cells of one list."""

    transport: str
    counting: Counting
    twice: set[str]  #: names that several points have
    commas: bool  #: decimal commas
    heads: Mapping[str, str]
    exponents: bool  #: in the column of factors
    size_units: set[int]  #: number of size units in one register


def read_register_list(path: Path, transport: str = "plc", counting: Counting | None = None) -> RegisterList:
    """Return the points of a list of registers, with notes on how it was read.

    ``counting`` states how the list counts addresses; without it, this is detected. Raises WiringError, with row and
    column, for wrong cells and for ambiguous addresses.
    """
    account = Account()
    try:
        with file_errors(path, WiringError):
            check_size(path, DESCRIPTION_BYTES)
        lines = text_lines(path, "", account)
    except RecordError as error:
        raise WiringError(str(error)) from None
    rows, heads, notes = _rows(path, lines)
    notes = [*account.taken, *notes]
    if not rows:
        raise WiringError(f"{path}: there is no row below the head; each register needs a row")
    rows = [_with_bit(f"{path}, row {row.line}", row) for row in rows]
    if any(row.bit for row in rows):
        notes.append("The bits of a register are assumed to be numbered from 0, the lowest bit.")
    tables = {row.line: _table(f"{path}, row {row.line}", row, rows) for row in rows}
    counted = counting or _counting(path, rows, tables)
    if counted == "modicon":
        first = next((row for row in rows if tables[row.line] in ("input", "holding")), rows[0])
        at = _address(f"{path}, row {first.line}", first, tables[first.line], counted)
        notes.append(
            f"The addresses are read as Modicon numbers: {first.address} is {tables[first.line]} register {at} on the "
            "wire. If they are addresses on the wire, give --addresses wire."
        )
    elif counted == "one":
        notes.append("The addresses are assumed to begin at 1: on the wire, each is one less.")
    access = _access(path, rows, tables)
    if any(one is None for one in access.values()):
        notes.append(
            "The list does not state for all holding registers and coils whether they are read or written; add a "
            'column R/W. A reading needs group = "fast".'
        )
    sizes = [(row.size, _registers(row)) for row in rows if row.size]
    conventions = _Conventions(
        transport,
        counted,
        {name for name, count in Counter(_name(row.name) for row in rows).items() if count > 1},
        comma_in([text for row in rows for text in (row.scale, row.factor, row.divisor)]),
        heads,
        are_exponents([row.factor for row in rows]),
        size_units(heads.get("size", ""), sizes),
    )
    if conventions.exponents:
        notes.append(f"The column {heads['factor']} is read as exponents of ten: -1 is a scale of 0.1.")
    points, left_out = _points(path, rows, tables, access, conventions)
    return RegisterList(points, notes + left_out)


def _points(
    path: Path,
    rows: Sequence[_Row],
    tables: Mapping[int, str],
    access: Mapping[int, tuple[bool, bool] | None],
    conventions: _Conventions,
) -> tuple[list[DescribedPoint], list[str]]:
    """Return the points, and texts that name skipped points and shared registers."""
    points: list[DescribedPoint] = []
    places: dict[str, tuple[str, int, int, str]] = {}
    left_out: dict[str, list[str]] = {}
    for row in rows:
        name = f"{row.name} (row {row.line})"
        try:
            point, places[name] = _point(
                f"{path}, row {row.line}", row, tables[row.line], access[row.line], conventions
            )
        except LeftOut as reason:
            left_out.setdefault(str(reason), []).append(name)
        else:
            points.append(point)
    notes = [f"Left out: {', '.join(names)}: {reason}." for reason, names in left_out.items()]
    return points, notes + [f"{note}." for note in shared_registers(places)]


def _rows(path: Path, lines: Sequence[str]) -> tuple[list[_Row], dict[str, str], list[str]]:
    """Return the rows with an address, the names of the columns, and a text about unread columns."""
    delimiter, head, found = _head(path, lines)
    notes = (
        [f"Lines above the head of the list: {head}."] if any(line.strip() for line in lines[:head]) else []
    )
    names = next(cells_of([lines[head]], delimiter))[1]
    _refuse_open(path, lines[head + 1 :], delimiter, names)
    unread = [name for index, name in enumerate(names) if name and index not in found.values()]
    if unread:
        notes.append(f"Columns of the list that were not read: {', '.join(unread)}.")
    width = len(names)
    rows, titles = [], 0
    for number, cells in cells_of(lines[head + 1 :], delimiter):
        line = head + 1 + number
        if len(cells) > width and any(cells[width:]):
            raise WiringError(
                f"{path}, row {line}: the row has {len(cells)} cells, but the head has {width}; "
                "correct the row"
            )
        row = {key: cells[index] if index < len(cells) else "" for key, index in found.items()}
        if not any(row.values()):
            continue
        if not row["address"] and sum(map(bool, cells)) == 1:
            titles += 1  # of a section
            continue
        unread_one = unread_scaling(names, list(found.values()), cells)
        rows.append(_Row(line, **{key: row.get(key, "") for key in COLUMNS}, open=unread_one))
    if titles:
        notes.append(f"Rows with a single cell, read as titles: {titles}.")
    return rows, {key: names[index] for key, index in found.items()}, notes


def _refuse_open(path: Path, lines: Sequence[str], delimiter: str, names: Sequence[str]) -> None:
    """Raise WiringError for unread columns that change numbers, and for lists of several devices."""
    rows = [row for _, row in cells_of(lines, delimiter)]
    for index, name in enumerate(names):
        cells = {row[index] for row in rows if len(row) > index and row[index]}
        nothing, right = OPEN.get(_plain(name), ("", ""))
        if right and cells - {nothing, f"{nothing}.0", f"{nothing},0"}:
            example = min(cells - {nothing})
            raise WiringError(f"{path}: the column {name}, such as {example}, is not read: {right}")
        if _plain(name) in DEVICES and len(cells) > 1:
            raise WiringError(
                f"{path}: the column {name} has {', '.join(sorted(cells)[:4])}; split the list into one per device"
            )


def _with_bit(where: str, row: _Row) -> _Row:
    """Return ``row`` with an address such as 40001.3 split into address and bit.

    Raises WiringError for an impossible bit.
    """
    address, point, behind = row.address.partition(".")
    if point and re.fullmatch(r"\d{1,2}", behind) and row.bit:
        raise WiringError(
            f"{where}: address = {row.address!r} has a bit, and the column bit has {row.bit}; state the bit once"
        )
    bit = behind if point else row.bit
    if not bit:
        return row
    if not re.fullmatch(r"\d{1,2}", bit) or int(bit) > 15:
        shown = f"address = {row.address!r}" if point else f"bit = {row.bit!r}"
        raise WiringError(f"{where}: {shown}; the bit of a register must be 0 (the lowest) to 15")
    return replace(row, address=address, bit=str(int(bit)))


def _head(path: Path, lines: Sequence[str]) -> tuple[str, int, dict[str, int]]:
    """Return delimiter, index of the heading, and the position of each column. The heading is the line with the most
    known names of columns.
    """
    best: tuple[str, int, dict[str, int]] | None = None
    for delimiter in (",", ";", "\t", "|"):
        for index, line in enumerate(lines[:60]):
            cells = next(cells_of([line], delimiter), (0, []))[1]
            found = _columns(cells)
            if best is None or len(found) > len(best[2]):
                best = (delimiter, index, found)
    assert best is not None
    delimiter, index, found = best
    if "address" not in found and "table" in found:  # a column `Register` may be the table or the number
        below = [cells for _, cells in cells_of(lines[index + 1 :], delimiter) if len(cells) > found["table"]]
        if any(re.search(r"\d{2}", cells[found["table"]]) for cells in below):
            found["address"] = found.pop("table")
    for key in ("name", "address"):
        if key not in found:
            names = [_plain(cell) for cell in next(cells_of([lines[index]], delimiter), (0, []))[1]]
            raise WiringError(
                f"{path}: there is no column {key}; the columns are {', '.join(names) or 'none'}"
            )
    return delimiter, index, found


def _columns(cells: Sequence[str]) -> dict[str, int]:
    plain = [_plain(cell) for cell in cells]
    found: dict[str, int] = {}
    for key, names in COLUMNS.items():
        places = [plain.index(name) for name in names if name in plain]
        free = [place for place in places if place not in found.values()]
        if free:
            found[key] = free[0]
    return found


def _table(where: str, row: _Row, rows: Sequence[_Row]) -> str:
    table = next((one for one, names in TABLES.items() if _plain(row.table) in names), "")
    if table:
        return table
    if not row.table and (code := re.match(r"\D*0*(15|16|[1-6])(?!\d)", row.function)):
        return next(one for one, names in TABLES.items() if f"fc{READ_BY.get(code[1], code[1])}" in names)
    if not row.table and all(not one.table for one in rows):
        if all(re.fullmatch(r"[0134]\d{4,5}", one.address) for one in rows):
            return next(one for one, digit in DIGIT.items() if digit == row.address[0])
        raise WiringError(
            f"{where}: the table of the register is unknown; add a column table (input, holding, coil or discrete), or "
            "use addresses such as 30011"
        )
    raise WiringError(f"{where}, column table: {row.table!r} must be input, holding, coil or discrete")


def _access(
    path: Path, rows: Sequence[_Row], tables: Mapping[int, str]
) -> dict[int, tuple[bool, bool] | None]:
    """Return for each line whether a point can be read and written; None if the list does not state it."""
    codes = {row.line: set(re.findall(r"\d+", row.function.replace("0x", ""))) for row in rows}
    codes = {line: {code.lstrip("0") for code in found} for line, found in codes.items()}
    lists_writing = any(
        found & WRITING for found in codes.values()
    )  # a list with a write function in one row has it in every writable row
    #: Where a list has separate tables for readings, writable points are settings.
    apart = set(tables.values()) & {"input", "discrete"}
    found: dict[int, tuple[bool, bool] | None] = {}
    for row in rows:
        where, table = f"{path}, row {row.line}", tables[row.line]
        access = ACCESS.get(_plain(row.access)) if row.access else None
        if row.access and access is None:
            raise WiringError(f"{where}, column access: {row.access!r} must be R, W or R/W")
        if table in ("input", "discrete"):
            if access is not None and access[1]:
                raise WiringError(
                    f"{where}, column access: {row.access!r}, but the table {table} is read-only; only holding and "
                    "coil can be written"
                )
            access = True, False
        elif access is None and lists_writing and codes[row.line]:
            access = True, bool(codes[row.line] & WRITING)
        elif access is None and ("input" if table == "holding" else "discrete") in apart:
            access = False, True
        found[row.line] = access
    return found


def _counting(path: Path, rows: Sequence[_Row], tables: Mapping[int, str]) -> Counting:
    """Return how the list counts addresses: "modicon" if all of them fit the numbers of their tables, "wire" if none
    does. Raises WiringError if only some do, or for ambiguous coils.
    """
    fits = {row.line: _is_modicon(row.address, tables[row.line]) for row in rows}
    if not any(fits.values()):
        return "wire"
    if set(tables.values()) == {"coil"}:  # 00010 may be a number with zeros before it
        raise WiringError(
            f"{path}: {rows[0].address} in row {rows[0].line} may be a Modicon number of a coil; give --addresses "
            "modicon or --addresses wire"
        )
    if all(fits.values()):
        return "modicon"
    yes, no = (next(row for row in rows if fits[row.line] is one) for one in (True, False))
    raise WiringError(
        f"{path}: {yes.address} in row {yes.line} looks like a Modicon number of table {tables[yes.line]}, "
        f"but {no.address} in row {no.line} does not; if all are addresses on the wire, give --addresses wire, else "
        "correct the list"
    )


def _is_modicon(address: str, table: str) -> bool:
    return bool(re.fullmatch(rf"{DIGIT[table]}(\d{{4}}|\d{{5}})", address)) and int(address[1:]) > 0


def _address(where: str, row: _Row, table: str, counting: Counting) -> int:
    text = row.address.strip()
    if len(text) > _DIGITS:
        raise WiringError(f"{where}: address = {text[:_DIGITS]}…; on the wire, an address must be 0 to 65535")
    if re.fullmatch(r"0[xX][0-9A-Fa-f]+|16#[0-9A-Fa-f]+|[0-9A-Fa-f]+[hH]", text):
        number = int(re.sub(r"^(0[xX]|16#)|[hH]$", "", text), 16)
    elif re.fullmatch(r"\d+", text):
        number = int(text)
    else:
        raise WiringError(f"{where}: address = {row.address!r} is not a number; write it as 10 or 0x0A")
    if counting == "modicon":
        if not _is_modicon(text, table):
            raise WiringError(
                f"{where}: address = {row.address!r} is not a Modicon number of table {table}; correct "
                "the address or the table"
            )
        number = int(text[1:]) - 1
    elif counting == "one":
        number -= 1
    if not 0 <= number <= 0xFFFF:
        raise WiringError(f"{where}: address = {row.address!r}; on the wire, an address must be 0 to 65535")
    return number


def _registers(row: _Row) -> int:
    """Return the number of registers of the type of a row; 0 if it is not stated."""
    if re.fullmatch(r"(u?int|integer|(un)?signed)?", _plain(row.type).replace(" ", "")):
        return 0
    try:
        return {"16": 1, "32": 2, "64": 4}.get(kind_of("", f"{row.type} {row.order}".strip())[0][-2:], 0)
    except WiringError:  # reported when the point is built
        return 0


def _scale(where: str, row: _Row, conventions: _Conventions) -> float:
    """Return the product of all scale factors of a point. Raises LeftOut if one of them is ambiguous."""
    if row.open:
        raise LeftOut(row.open)
    commas, heads = conventions.commas, conventions.heads
    scale = scale_of(where, row.scale, commas)
    if row.divisor:
        scale /= scale_of(where, row.divisor, commas, "divisor")
    if row.factor:
        scale *= factor_of(row.factor, heads["factor"], conventions.exponents)
    if row.exponent:
        scale *= factor_of(row.exponent, heads["exponent"], True)
    return scale


def _point(
    where: str, row: _Row, table: str, access: tuple[bool, bool] | None, conventions: _Conventions
) -> tuple[DescribedPoint, tuple[str, int, int, str]]:
    """Return the point of a row, and its place: table, address, number of registers, and bit ("" for none)."""
    address = _address(where, row, table, conventions.counting)
    scale = _scale(where, row, conventions)
    unit = unit_of(row.unit)
    if unit.factor != 1.0:
        if scale != 1.0:
            raise WiringError(
                f"{where}: the scale is {scale:g}, and the unit {row.unit!r} contains a scale, too; remove one of them"
            )
        scale = unit.factor
    kind, order = kind_of(where, f"{row.type} {row.order}".strip())
    words = table in ("input", "holding")
    if words and not row.bit:
        kind = sized_type(kind, bool(_registers(row)), row.size, conventions.size_units)
    name = _name(row.name)
    if not name:
        raise WiringError(
            f"{where}, column name: {row.name!r} has no letter; a name must begin with a letter"
        )
    name = f"{name}_{table}_{address}" if name in conventions.twice else name
    if row.bit and (not words or (kind and kind not in ("bit", "uint16")) or scale != 1.0):
        raise WiringError(
            f"{where}: a bit must be in a single input or holding register, without type and scale, but bit "
            f"{row.bit} has table = {table}, type = {kind or 'none'}, scale = {scale:g}; correct them"
        )
    null = null_of(row.null, kind) if words and not row.bit else ""
    parts = [f'table = "{table}"', f"address = {address}"]
    parts += [f'type = "{kind}"'] if kind and words and kind != "bit" and not row.bit else []
    parts += [f"bit = {row.bit}"] if row.bit else []
    if order and words:
        parts += [f'word_order = "{order[0]}"'] if kind[-2:] != "16" else []
        parts += ['byte_order = "little"'] if order[1] == "little" else []
    parts += [f"scale = {scale:.12g}"] if scale != 1 and words else []
    parts += [f"null = {null}"] if null else []
    read, written = access or (True, True)
    parts += ['group = "fast"'] if read and not written else []
    point = DescribedPoint(
        f"{conventions.transport}.{name}",
        row.name,
        row.text,
        unit.name,
        written,
        read,
        absolute=unit.absolute,
        line=f'"{name}" = {{ {", ".join(parts)} }}',
    )
    size = {"32": 2, "64": 4}.get(kind[-2:], 1) if words else 1
    return point, (table, address, size, row.bit)


def _name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.]+", "_", text.strip()).lstrip("_.0123456789").rstrip("_.")


def _plain(text: str) -> str:
    return " ".join(re.sub(r"[_\-:./]+", " ", text.strip().lower()).split())
