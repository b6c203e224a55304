"""The points of a rig as its DBC and its list of registers name them."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from bench_protocol.dbc import DbcError, read_dbc
from drivers.errors import WiringError


@dataclass(frozen=True)
class Point:
    """One point: what the rig calls it, and what is told of it."""

    name: str  #: as the wiring names it: TRANSPORT.POINT
    own: str  #: words of its own
    context: str  #: words of what it is in: its message, its description
    unit: str
    written: bool  #: by us
    read: bool
    choices: Mapping[str, int] = field(default_factory=dict)
    line: str = ""  #: of ``[transports.NAME.points]``


#: What stands in a DBC in the place of a node that nobody named.
_NOBODY: Final = re.compile(r"(vector_*)?xxx", re.IGNORECASE)


def dbc_points(path: Path, transport: str = "bus", charset: str | None = None) -> list[Point]:
    """Return the signals of a DBC; whoever sends most of them is the rig. WiringError for a file that is none.

    What nobody is said to send may be the rig's or ours.
    """
    try:
        messages = read_dbc(path, charset).messages
    except DbcError as error:
        raise WiringError(str(error)) from None
    senders = {
        name: [one for one in message.coding.senders if not _NOBODY.fullmatch(one)]
        for name, message in messages.items()
    }
    counts = Counter(
        sender for name, one in messages.items() for sender in senders[name] for _ in one.coding.signals
    )
    rig = counts.most_common(1)[0][0] if counts else ""
    return [
        Point(
            f"{transport}.{name}.{signal.name}",
            signal.name,
            f"{one.coding.name} {signal.comment or ''}",
            _unit(signal.unit or ""),
            written=rig not in senders[name],
            read=not senders[name] or rig in senders[name],
            choices={str(text): int(number) for number, text in (signal.choices or {}).items()},
        )
        for name, one in messages.items()
        for signal in one.coding.signals
    ]


_COLUMNS: Final = {
    "name": ("name", "signal", "tag", "label", "variable", "symbol"),
    "table": ("table", "space", "area", "kind", "register"),
    "address": ("address", "addr", "offset address", "adresse"),
    "type": ("type", "encoding", "format", "datatype", "data type"),
    "scale": ("scale", "factor", "resolution", "lsb"),
    "unit": ("unit", "units", "einheit"),
    "text": ("description", "comment", "text", "meaning"),
}
_TABLES: Final = {
    "input": ("input", "ir", "3x", "input register", "inputs"),
    "holding": ("holding", "hr", "4x", "holding register", "holdings"),
    "coil": ("coil", "coils", "0x", "do"),
    "discrete": ("discrete", "di", "1x", "discrete input", "contact"),
}
_TYPES: Final = {
    "bool": "bit",
    "word": "uint16",
    "int": "int16",
    "uint": "uint16",
    "dint": "int32",
    "udint": "uint32",
    "real": "float32",
    "float": "float32",
    "lreal": "float64",
}
_KNOWN: Final = ("int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64", "bit")


def register_points(path: Path, transport: str = "plc") -> list[Point]:
    """Return the rows of a list of registers (CSV). WiringError, with row and column, for what cannot be."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise WiringError(f"{path} cannot be read: {error}") from None
    head = text.partition("\n")[0]
    reader = csv.DictReader(text.splitlines(), delimiter=max(",;\t", key=head.count))
    columns = {_plain(name or ""): name for name in reader.fieldnames or ()}
    found = {
        key: next((columns[one] for one in names if one in columns), "") for key, names in _COLUMNS.items()
    }
    for key in ("name", "table", "address"):
        if not found[key]:
            raise WiringError(f"{path}: no column {key}; there are {', '.join(columns) or 'none'}")
    rows = [
        {key: (row.get(column) or "").strip() if column else "" for key, column in found.items()}
        for row in reader
    ]
    twice = {name for name, count in Counter(_name(row["name"]) for row in rows).items() if count > 1}
    return [
        _register(f"{path}, row {number}", transport, row, twice)
        for number, row in enumerate(rows, 2)
        if any(row.values())
    ]


def _register(where: str, transport: str, row: Mapping[str, str], twice: set[str]) -> Point:
    table = next((one for one, names in _TABLES.items() if _plain(row["table"]) in names), "")
    if not table:
        raise WiringError(
            f"{where}, column table: {row['table']!r} is none of input, holding, coil, discrete"
        )
    try:
        address, scale = int(row["address"], 0), float(row["scale"] or 1)
    except ValueError:
        raise WiringError(
            f"{where}: address = {row['address']!r} and scale = {row['scale']!r} must be numbers"
        ) from None
    kind = _TYPES.get(row["type"].lower(), row["type"].lower())
    if kind and kind not in _KNOWN:
        raise WiringError(f"{where}, column type: {row['type']!r} is none of {', '.join(_KNOWN)}")
    name = _name(row["name"])
    if not name:
        raise WiringError(f"{where}, column name: {row['name']!r} has no letter to begin with")
    name = f"{name}_{table}_{address}" if name in twice else name
    words = table in ("input", "holding")
    parts = [f'table = "{table}"', f"address = {address}"]
    parts += [f'type = "{kind}"'] if kind and words and kind != "bit" else []
    parts += [f"scale = {scale:g}"] if scale != 1 and words else []
    parts += ['group = "fast"'] if table == "input" else []
    return Point(
        f"{transport}.{name}",
        row["name"],
        row["text"],
        _unit(row["unit"]),
        written=table in ("holding", "coil"),
        read=table in ("input", "discrete"),
        line=f'"{name}" = {{ {", ".join(parts)} }}',
    )


def _name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.]+", "_", text.strip()).lstrip("_.0123456789").rstrip("_.")


def _plain(text: str) -> str:
    return text.strip().lower().replace("_", " ")


_UNITS: Final = {"°c": "degC", "c": "degC", "deg c": "degC", "µm": "um", "μm": "um", "-": ""}


def _unit(text: str) -> str:
    return _UNITS.get(text.strip().lower(), text.strip())
