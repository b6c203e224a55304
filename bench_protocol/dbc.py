"""Reading of a DBC, or another file of messages that cantools supports, for logs and wirings."""

from __future__ import annotations

import codecs
import logging
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import cantools

from bench_protocol import j1939
from bench_protocol.input_limits import check_dbc
from bench_protocol.os_errors import file_errors

if TYPE_CHECKING:
    from cantools.database.can import Message as Coding

_BOMS: Final = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_FALLBACK: Final = "cp1252"
_DBC: Final = ".dbc"
#: Pseudo message with the signals that belong to no message.
_INDEPENDENT: Final = "VECTOR__INDEPENDENT_SIG_MSG"


class DbcError(Exception):
    """A DBC that cannot be read or used. The text states the file, the fault and the remedy."""


@dataclass(frozen=True, slots=True)
class Described:
    """One message of a DBC; ``name`` is its name in the file, with the identifier if two messages have that name."""

    name: str
    coding: Coding
    j1939: bool = False
    #: Why it cannot be sent: signals that overlap, or do not fit. It can still be read.
    unsound: str = ""

    @property
    def key(self) -> tuple[int, bool]:
        """The key of its frames: the identifier (with J1939 the group), and whether identifiers have 29 bits."""
        identifier = self.coding.frame_id
        return (j1939.group_of(identifier) if self.j1939 else identifier), bool(self.coding.is_extended_frame)

    @property
    def shown(self) -> str:
        """Name and identifier, as text."""
        return f"{self.name} ({self.coding.frame_id:#x})"


@dataclass(slots=True)
class Dbc:
    """The messages of a file by name, and by the identifier of a frame."""

    path: Path
    charset: str
    messages: dict[str, Described]
    _exact: dict[tuple[int, bool], list[Described]] = field(default_factory=dict)
    _groups: dict[int, list[Described]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for one in self.messages.values():
            coding = one.coding
            self._exact.setdefault((coding.frame_id, bool(coding.is_extended_frame)), []).append(one)
            if one.j1939:
                self._groups.setdefault(one.key[0], []).append(one)

    def of(self, identifier: int, extended: bool) -> Described | None:
        """Return the message of frames with an identifier; None if the file has none.

        J1939 messages are found by the group, for any priority and addresses. If the file has several messages of the
        group, the only one without a source address is returned, or None. Raises DbcError if two messages have the
        identifier.
        """
        found = self._exact.get((identifier, extended), [])
        if len(found) > 1:
            names = " and ".join(one.name for one in found)
            raise DbcError(f"{self.path} describes {identifier:#x} twice, as {names}; {_ONE_OF_THEM}")
        if found or not extended:
            return found[0] if found else None
        group = self._groups.get(j1939.group_of(identifier), [])
        anybody = [one for one in group if j1939.source_of(one.coding.frame_id) == j1939.NOBODY]
        return group[0] if len(group) == 1 else anybody[0] if len(anybody) == 1 else None


_ONE_OF_THEM: Final = "remove one of them from the file"


def read_dbc(path: Path, charset: str | None = None) -> Dbc:
    """Return the messages of a file, each checked only when it is used. Raises DbcError for a file that cannot be read.

    Without ``charset``, a byte order mark states the encoding. Without a mark it is UTF-8 if the file is valid UTF-8,
    else cp1252.
    """
    with file_errors(path, DbcError):
        check_dbc(path)
        text, found = _decoded(path, path.read_bytes(), charset)
    logging.getLogger("cantools").setLevel(
        logging.ERROR
    )  # cantools warns of repeated names, which are handled below
    try:
        base = cantools.database.load_string(
            text, database_format="dbc" if path.suffix.lower() == _DBC else None, strict=False
        )
    except Exception as error:  # cantools raises many kinds of errors
        raise DbcError(f"{path} {_reading_error(path, text, error)}") from None
    if not isinstance(base, cantools.database.can.Database):
        raise DbcError(
            f"{path} describes diagnostics instead of CAN messages; use a file with the messages of the bus"
        )
    if path.suffix.lower() == _DBC:
        _refuse_a_rest(path, text, base)
    whole = _says_j1939(base)
    messages: dict[str, Described] = {}
    twice = {name for name, count in Counter(one.name for one in base.messages).items() if count > 1}
    for coding in base.messages:
        name = _own_name(coding, coding.name in twice, messages)
        if name is None:
            continue
        protocol = coding.protocol == "j1939" or (whole and coding.protocol is None)
        one = Described(name, coding, bool(coding.is_extended_frame) and protocol, _unsound(coding))
        messages[name] = one
    return Dbc(path, found, messages)


def _own_name(coding: Coding, twice: bool, messages: Mapping[str, Described]) -> str | None:
    """Return a unique name for a message, with its identifier if several have its name; None for an identical
    repetition.
    """
    name = f"{coding.name}_{coding.frame_id:#x}" if twice else coding.name
    count = 1
    while name in messages:
        if _same_coding(messages[name].coding, coding):
            return None
        count += 1
        name = f"{coding.name}_{coding.frame_id:#x}_{count}"
    return name


def _decoded(path: Path, content: bytes, charset: str | None) -> tuple[str, str]:
    """Return the text of a file and its charset."""
    mark, marked = next(((mark, name) for mark, name in _BOMS if content.startswith(mark)), (b"", None))
    tried = [marked] if marked else [charset] if charset else ["utf-8", _FALLBACK]
    line = 0
    for name in tried:
        try:
            return content[len(mark) :].decode(name), name
        except LookupError:
            raise DbcError(
                f'{path}: charset = "{name}" is unknown; use one such as "utf-8", "cp1252" or "latin-1"'
            ) from None
        except UnicodeDecodeError as error:
            line = content.count(b"\n", 0, error.start) + 1
    names = " or ".join(tried)
    raise DbcError(
        f"{path}: line {line} is not in {names}; set charset to the encoding of the file, such as "
        '"latin-1", "cp1250" or "gbk"'
    )


def _reading_error(path: Path, text: str, error: Exception) -> str:
    """Return as text why cantools cannot read a file."""
    message = str(getattr(error, "e_dbc", None) or error)
    place = re.search(r"line (\d+), column (\d+)", message)
    if place is None:
        return (
            "cannot be read as a DBC: a line refers to an item that the file does not define; export "
            "the file again"
            if path.suffix.lower() == _DBC
            else "cannot be read; use a DBC, ARXML, KCD or SYM file"
        )
    line, column = int(place[1]), int(place[2])
    lines = text.splitlines()
    there = lines[line - 1][column - 1 :].strip()[:40] if line <= len(lines) else ""
    return f"is not a valid DBC: line {line}, column {column}" + (
        f" has a syntax error at {there!r}; correct it" if there else ": the file ends there; export it again"
    )


def _refuse_a_rest(path: Path, text: str, base: Any) -> None:
    """Raise DbcError for a file that cantools has read only in part, because it skips unknown content silently."""
    bare = re.sub(r'"(?:\\"|[^"])*+"', lambda found: '"' + "\n" * found[0].count("\n") + '"', text)
    begun = list(re.finditer(r"^[ \t]*(BO_|SG_)[ \t]+(\w+)(?:[ \t]+(\w*))?", bare, re.MULTILINE))
    independent = False
    messages = signals = 0
    for found in begun:
        if found[1] == "BO_":
            independent = found[3] == _INDEPENDENT
        if independent:
            continue
        messages, signals = messages + (found[1] == "BO_"), signals + (found[1] == "SG_")
        known = sum(len(one.signals) for one in base.messages)
        if messages > len(base.messages) or signals > known:
            line = bare.count("\n", 0, found.start()) + 1
            raise DbcError(
                f"{path} is incomplete: the DBC ends in line {line} ({found[0].strip()!r}); export it again"
            )


def _says_j1939(base: Any) -> bool:
    attributes = getattr(base.dbc, "attributes", None) or {}
    one = attributes.get("ProtocolType")
    return one is not None and str(one.value).strip().lower() == "j1939"


def _same_coding(one: Coding, other: Coding) -> bool:
    """Return whether two descriptions with the same name and identifier are equal."""

    def layout(coding: Coding) -> list[object]:
        return [
            (
                s.name,
                s.start,
                s.length,
                s.byte_order,
                s.is_signed,
                s.scale,
                s.offset,
                s.unit,
                s.multiplexer_ids,
            )
            for s in coding.signals
        ]

    same = one.length == other.length and one.is_extended_frame == other.is_extended_frame
    return same and one.frame_id == other.frame_id and layout(one) == layout(other)


def _unsound(coding: Coding) -> str:
    """Return as text why a message cannot be sent: signals that overlap, or one that does not fit."""
    names = [signal.name for signal in coding.signals]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        return f"it has two signals {twice[0]}"
    try:
        coding.refresh(strict=True)
    except Exception as error:  # cantools' own, and others for some files
        shared = re.search(r"signals (\S+) and (\S+) are overlapping", str(error))
        wide = re.search(r"signal (\S+) does not fit", str(error))
        if shared:
            return f"its signals {shared[1]} and {shared[2]} share bits"
        return (
            f"its signal {wide[1]} does not fit into its {coding.length} bytes"
            if wide
            else "its signals do not fit"
        )
    finally:
        coding.refresh(strict=False)
    return ""
