"""The messages of a CAN transport: from a DBC or from bits in the description, coded by cantools, guarded by scheme."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from bench_protocol.dbc import DbcError, Described, read_dbc
from bench_protocol.frames import EXTENDED_ID_MAX, LENGTH_MAX, STANDARD_ID_MAX
from bench_protocol.units import ms
from drivers.errors import WiringError
from drivers.wiring.keys import convert, duration, meant
from drivers.wiring.protection import E2E_COUNTER_PERIOD, Checksum, ChecksumKeys, checksum

if TYPE_CHECKING:
    from cantools.database.can import Message as Coding
    from cantools.database.can import Signal

_ALL: Final = "*"
_STALE_PERIODS: Final = 3
_STALE_MIN: Final = 100 * ms


class MessageKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What stands under ``[transports.NAME.messages.MESSAGE]``."""

    id: Annotated[int, Meta(ge=0)] | None = None  #: of a message that no DBC describes
    extended: bool | None = None  #: its identifier has 29 bits
    length: Annotated[int, Meta(ge=0)] | None = None  #: its bytes, 8 where nothing is said
    every: str | None = None  #: how often it is sent; without it, when it is written
    stale: str | None = None  #: after how long without it its points are stale
    counter: str | None = None  #: the signal that counts its frames
    counter_period: Annotated[int, Meta(ge=2)] | None = None  #: after how many frames the counter is 0 again
    checksum: dict[str, Any] | None = None
    values: dict[str, float] = {}  #: of signals that are sent with it and that nobody writes


class CommonKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """What stands under ``[transports.NAME.messages."*"]``: for all messages that have such signals."""

    counter: str | None = None
    checksum: dict[str, Any] | None = None


class SignalKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"is_float": "float"}):
    """A point of a CAN message: number = scale · raw + offset. With a DBC only ``null`` is left to say."""

    start: Annotated[int, Meta(ge=0, le=63)] | None = None  #: bit, counted as in a DBC
    length: Annotated[int, Meta(ge=1, le=64)] | None = None  #: bits
    byte_order: Literal["little", "big"] = "little"
    signed: bool = False
    is_float: bool = False  #: IEEE 754 in 16, 32 or 64 bits
    scale: float = 1.0
    offset: float = 0.0
    page: int | None = None  #: it is there when the selector has this value
    selector: bool = False  #: it says which page is sent
    null: int | None = None  #: the raw value that means "not available"


_DBC_SAYS: Final = frozenset(SignalKeys.__struct_fields__) - {"null"}


@dataclass(slots=True)
class Message:
    """One message: how it is coded and guarded, what it carries, and what goes round with it."""

    name: str
    coding: Coding
    keys: MessageKeys
    stale: float  #: s
    nulls: dict[str, float]
    limits: dict[str, tuple[float, float]]  #: of each signal, as it is coded
    every: float = 0.0  #: how often it is sent (s); 0 for when it is written
    counter_period: int = 0
    checksum: Checksum | None = None
    checksum_coding: Coding | None = None  #: of the checksum alone
    checksum_mask: int = 0
    given: dict[str, float] = field(default_factory=dict)  #: what is sent before anybody writes, by signal
    values: dict[str, float] = field(default_factory=dict)  #: what is sent, by signal
    count: int = -1  #: last sent
    heard: int = -1  #: last received
    when: int = -1  #: ns, last received
    points: dict[str, str] = field(default_factory=dict)  #: names of its points, by signal
    refused: str = ""  #: why nothing of it can be used, of what the DBC says
    _placed: dict[int, int] = field(default_factory=dict)  #: checksums in their place, by value

    def begin(self) -> None:
        """Forget what was sent and received on an earlier connection."""
        self.values, self.count, self.heard, self.when = dict(self.given), -1, -1, -1

    @property
    def guards(self) -> set[str]:
        """Signals that the transport fills in by itself."""
        own = {self.keys.counter, self.keys.checksum["signal"] if self.keys.checksum else None}
        return {name for name in own if name}

    @property
    def selector(self) -> str:
        """The signal that says which page is sent; empty if all is sent always."""
        selectors = [signal.name for signal in self.coding.signals if signal.is_multiplexer]
        return selectors[0] if selectors else ""

    @property
    def sendable(self) -> bool:
        """Whether its pages are of one level, which is all that can be written."""
        return sum(signal.is_multiplexer for signal in self.coding.signals) <= 1

    def pages(self) -> list[int]:
        """Return the numbers of its pages; none if all is sent always."""
        return sorted({page for signal in self.coding.signals for page in signal.multiplexer_ids or ()})

    def page_of(self, signal: str) -> int | None:
        """Return the page on which ``signal`` is sent; None if on all."""
        ids = self.coding.get_signal_by_name(signal).multiplexer_ids
        return ids[0] if ids else None

    def on_page(self, page: int | None) -> list[str]:
        """Return the signals to be given with a page, without those that are filled in."""
        return [
            signal.name
            for signal in self.coding.signals
            if signal.name not in self.guards
            and signal.name != self.selector
            and (signal.multiplexer_ids is None or page in signal.multiplexer_ids)
        ]

    def missing(self, page: int | None) -> list[str]:
        """Return the signals of a page that have no value yet."""
        return [name for name in self.on_page(page) if name not in self.values]

    def encode(self, page: int | None) -> bytes:
        """Return the data of the next frame of a page."""
        signals = {name: self.values[name] for name in self.on_page(page)}
        if self.selector:
            signals[self.selector] = page if page is not None else self.values.get(self.selector, 0)
        if self.keys.counter:
            self.count = (self.count + 1) % self.counter_period
            signals[self.keys.counter] = self.count
        if self.checksum is None or not self.keys.checksum:
            return bytes(self.coding.encode(signals, strict=False))
        data = bytes(self.coding.encode({**signals, self.keys.checksum["signal"]: 0}, strict=False))
        bare = int.from_bytes(data, "big") & ~self.checksum_mask
        return (bare | self._place(self.checksum(self.coding.frame_id, data))).to_bytes(len(data), "big")

    def sound(self, data: bytes) -> bool:
        """Return whether the checksum of a received frame is right."""
        if self.checksum is None:
            return True
        bits = int.from_bytes(data, "big")
        bare = (bits & ~self.checksum_mask).to_bytes(len(data), "big")
        return bits & self.checksum_mask == self._place(self.checksum(self.coding.frame_id, bare))

    def _place(self, checksum: int) -> int:
        """Return the bits of a frame that has ``checksum`` and nothing else."""
        bits = self._placed.get(checksum)
        if bits is None:
            assert self.checksum_coding is not None and self.keys.checksum is not None
            alone = self.checksum_coding.encode({self.keys.checksum["signal"]: checksum}, scaling=False)
            bits = self._placed[checksum] = int.from_bytes(alone, "big")
        return bits

    def decode(self, data: bytes) -> dict[str, float]:
        """Return the numbers of a received frame by point; NaN where there is none."""
        values: Any = self.coding.decode(data, decode_choices=False)
        names = self.points
        found = {names[signal]: float(value) for signal, value in values.items()}
        for signal, null in self.nulls.items():
            if found.get(names[signal]) == null:
                found[names[signal]] = math.nan
        return found


def read_messages(
    where: str, table: Mapping[str, Any], directory: Path, functions: Path | None, stale: float | None
) -> dict[str, Message]:
    """Return the messages of a description by name; WiringError, with ``where``, for what cannot be."""
    tables = dict(table.get("messages", {}))
    common = convert(f'{where}.messages."{_ALL}"', tables.pop(_ALL, {}), CommonKeys)
    keys = {name: convert(f"{where}.messages.{name}", one, MessageKeys) for name, one in tables.items()}
    points: dict[str, dict[str, SignalKeys]] = {}
    for name, one in table.get("points", {}).items():
        message, dot, signal = name.partition(".")
        if not (message and dot and signal):
            raise WiringError(
                f'{where}.points: {name} is no name; points of CAN are "Message.Signal", in quotes'
            )
        points.setdefault(message, {})[signal] = convert(f"{where}.points: {name}", one, SignalKeys)
    described = _from_file(where, table.get("dbc"), table.get("charset"), directory)
    codings = {name: one.coding for name, one in described.items()}
    for name, one in keys.items():
        if one.id is not None:
            if name in codings:
                raise WiringError(
                    f"{where}.messages.{name}: id = {one.id:#x}, but the DBC describes {name} already"
                )
            codings[name] = _own_coding(f"{where}.messages.{name}", name, one, points.pop(name, {}))
        elif name not in codings:
            raise WiringError(
                f"{where}.messages.{name}: no message of this name{_in_dbc(table)}; {meant(name, codings)}. Without a "
                "DBC it needs its id"
            )
    _check_points(where, table, points, codings)
    refused = {name: one.unsound for name, one in described.items() if one.unsound}
    refused |= _same_identifiers(where, codings, described)
    for name, why in refused.items():
        if name in keys:
            raise WiringError(
                f"{where}.messages.{name}: {why}; another DBC, or id and points here, would be right"
            )
    _check_common(f'{where}.messages."{_ALL}"', common, codings)
    return {
        name: _message(
            f"{where}.messages.{name}",
            name,
            coding,
            _with_common(keys.get(name, MessageKeys()), common, coding),
            points.get(name, {}),
            functions,
            stale,
            refused.get(name, ""),
        )
        for name, coding in codings.items()
    }


def _check_common(where: str, common: CommonKeys, codings: Mapping[str, Coding]) -> None:
    names = {signal.name for coding in codings.values() for signal in coding.signals}
    for name in (common.counter, (common.checksum or {}).get("signal")):
        if name is not None and name not in names:
            raise WiringError(f"{where}: no message has a signal {name!r}; {meant(name, names)}")


def _with_common(keys: MessageKeys, common: CommonKeys, coding: Coding) -> MessageKeys:
    """Return the keys of a message with what is common to all that have such signals, where it says nothing itself."""
    names = {signal.name for signal in coding.signals}
    changes: dict[str, Any] = {}
    if keys.counter is None and common.counter in names:
        changes["counter"] = common.counter
    if keys.checksum is None and common.checksum is not None and common.checksum.get("signal") in names:
        changes["checksum"] = common.checksum
    return msgspec.structs.replace(keys, **changes)


def _in_dbc(table: Mapping[str, Any]) -> str:
    return f" in {table['dbc']}" if table.get("dbc") else ""


def _from_file(where: str, name: object, charset: object, directory: Path) -> dict[str, Described]:
    if name is None:
        return {}
    path = directory / str(name)
    try:
        return read_dbc(path, None if charset is None else str(charset)).messages
    except DbcError as error:
        raise WiringError(f"{where}: dbc = {name!r}{str(error).removeprefix(str(path))}") from None


def _own_coding(where: str, name: str, keys: MessageKeys, signals: Mapping[str, SignalKeys]) -> Coding:
    from cantools import Error
    from cantools.database.can import Message as Coding
    from cantools.database.can import Signal
    from cantools.database.conversion import BaseConversion

    assert keys.id is not None
    extended = keys.id > STANDARD_ID_MAX if keys.extended is None else keys.extended
    highest = EXTENDED_ID_MAX if extended else STANDARD_ID_MAX
    if keys.id > highest:
        kind = "29-bit" if extended else "11-bit"
        raise WiringError(f"{where}: id = {keys.id:#x} is no {kind} identifier (0 to {highest:#x})")
    length = LENGTH_MAX if keys.length is None else keys.length
    if length > LENGTH_MAX:
        raise WiringError(f"{where}: length = {length} bytes is more than a CAN frame carries, {LENGTH_MAX}")
    if not signals:
        raise WiringError(f'{where}: it has no points; "{name}.Signal" = {{ start = 0, length = 16 }} is one')
    selector = next((signal for signal, one in signals.items() if one.selector), None)
    made = []
    for signal, one in signals.items():
        place = f"{where}: {name}.{signal}"
        if one.start is None or one.length is None:
            raise WiringError(f"{place} needs start and length, in bits, since no DBC describes it")
        if one.page is not None and selector is None:
            raise WiringError(f"{place}: page = {one.page}, but no point of {name} is its selector")
        if not one.scale:
            raise WiringError(f"{place}: scale = 0 maps everything to one number")
        if one.is_float and one.length not in (16, 32, 64):
            raise WiringError(f"{place}: length = {one.length} is no float; there are 16, 32 and 64 bits")
        made.append(
            Signal(
                signal,
                one.start,
                one.length,
                "big_endian" if one.byte_order == "big" else "little_endian",
                is_signed=one.signed,
                conversion=BaseConversion.factory(one.scale, one.offset, None, one.is_float),
                is_multiplexer=one.selector,
                multiplexer_ids=None if one.page is None else [one.page],
                multiplexer_signal=None if one.page is None else selector,
            )
        )
    try:
        return Coding(keys.id, name, length, made, is_extended_frame=extended, strict=True)
    except Error as error:
        raise WiringError(f"{where}: {str(error)[0].lower()}{str(error)[1:]}") from None


def _check_points(
    where: str,
    table: Mapping[str, Any],
    points: Mapping[str, Mapping[str, SignalKeys]],
    codings: Mapping[str, Coding],
) -> None:
    """WiringError for what is said of points that no message has, or that the DBC says already."""
    for message, signals in points.items():
        if message not in codings:
            raise WiringError(
                f"{where}.points: {message}.{next(iter(signals))}: no message {message!r}{_in_dbc(table)}; "
                f"{meant(message, codings)}. Without a DBC, messages.{message} needs its id"
            )
        names = [signal.name for signal in codings[message].signals]
        for signal, one in signals.items():
            if signal not in names:
                raise WiringError(
                    f"{where}.points: {message} has no signal {signal!r}; {meant(signal, names)}"
                )
            said = [key for key in sorted(_DBC_SAYS) if getattr(one, key) != getattr(SignalKeys(), key)]
            if said:
                raise WiringError(
                    f"{where}.points: {message}.{signal}: {said[0].removeprefix('is_')} is said by the DBC already"
                )


def _same_identifiers(
    where: str, codings: Mapping[str, Coding], described: Mapping[str, Described]
) -> dict[str, str]:
    """Return why messages of the DBC with one identifier cannot be used; WiringError where one is described here."""
    seen: dict[tuple[int, bool], str] = {}
    refused: dict[str, str] = {}
    for name, coding in codings.items():
        key = coding.frame_id, coding.is_extended_frame
        if (other := seen.setdefault(key, name)) == name:
            continue
        why = f"{other} and {name} have the same identifier, {coding.frame_id:#x}"
        if name not in described or other not in described:
            raise WiringError(f"{where}: {why}")
        refused |= {other: why, name: why}
    return refused


def _message(
    where: str,
    name: str,
    coding: Coding,
    keys: MessageKeys,
    points: Mapping[str, SignalKeys],
    functions: Path | None,
    stale: float | None,
    refused: str = "",
) -> Message:
    names = [signal.name for signal in coding.signals]
    nulls = {}
    for signal in coding.signals:
        null = points[signal.name].null if signal.name in points else None
        if null is not None:
            nulls[signal.name] = float(signal.conversion.raw_to_scaled(null, decode_choices=False))  # type: ignore[arg-type]
    limits = {signal.name: _limits(signal) for signal in coding.signals}
    every = 0.0 if keys.every is None else duration(f"{where}: every", keys.every)
    message = Message(name, coding, keys, 0.0, nulls, limits, every, refused=refused)
    pages = max(1, len(message.pages()))
    cycle = (coding.cycle_time or 0) * ms
    by_rate = max(_STALE_MIN, _STALE_PERIODS * cycle) if stale is None else stale
    message.stale = pages * by_rate if keys.stale is None else duration(f"{where}: stale", keys.stale)
    for said in (*keys.values, *([keys.counter] if keys.counter else [])):
        _known(where, said, names)
    for given, value in keys.values.items():
        low, high = limits[given]
        if not low <= value <= high:
            raise WiringError(f"{where}: values: {given} = {value:g} does not fit ({low:g} to {high:g})")
    message.points = {signal: f"{name}.{signal}" for signal in names}
    message.given = {
        **{one.name: float(one.initial) for one in coding.signals if isinstance(one.initial, int | float)},
        **keys.values,
    }
    _guard(where, message, functions)
    return message


def _guard(where: str, message: Message, functions: Path | None) -> None:
    """Give ``message`` its counter and checksum."""
    from cantools.database.can import Message as Coding

    keys, coding = message.keys, message.coding
    names = [signal.name for signal in coding.signals]
    guard = None if keys.checksum is None else convert(f"{where}.checksum", keys.checksum, ChecksumKeys)
    if keys.counter:
        room = 2 ** coding.get_signal_by_name(keys.counter).length
        message.counter_period = keys.counter_period or (
            E2E_COUNTER_PERIOD if guard is not None and guard.scheme == "e2e_p1" else room
        )
        if message.counter_period > room:
            raise WiringError(
                f"{where}: counter_period = {keys.counter_period} does not fit: {keys.counter} has {room}"
            )
    if guard is None:
        return
    _known(f"{where}.checksum", guard.signal, names)
    signal = coding.get_signal_by_name(guard.signal)
    if signal.multiplexer_ids:
        raise WiringError(f"{where}.checksum: {guard.signal} is on some pages only")
    if signal.length != 8 and not guard.scheme.startswith("function:"):
        raise WiringError(
            f"{where}.checksum: {guard.signal} has {signal.length} bits, {guard.scheme} makes 8"
        )
    alone = Coding(
        coding.frame_id, message.name, coding.length, [signal], is_extended_frame=coding.is_extended_frame
    )
    full = -1 if signal.is_signed else 2**signal.length - 1
    message.checksum_mask = int.from_bytes(
        alone.encode({guard.signal: full}, scaling=False, strict=False), "big"
    )
    if guard.scheme == "e2e_p1" and message.checksum_mask >> 8 * (coding.length - 1) != 0xFF:
        raise WiringError(f"{where}.checksum: e2e_p1 has its checksum in byte 0; {guard.signal} is elsewhere")
    message.checksum_coding = alone
    message.checksum = checksum(f"{where}.checksum", guard, coding.is_extended_frame, functions)


def _known(where: str, signal: str, names: Iterable[str]) -> None:
    if signal not in names:
        raise WiringError(f"{where}: there is no signal {signal!r}; {meant(signal, names)}")


def _limits(signal: Signal) -> tuple[float, float]:
    """Return the least and the greatest number that a signal can carry and may have."""
    if signal.conversion.is_float:
        low, high = -math.inf, math.inf
    else:
        first = -(1 << signal.length - 1) if signal.is_signed else 0
        ends = [signal.offset + signal.scale * raw for raw in (first, first + (1 << signal.length) - 1)]
        low, high = min(ends), max(ends)
    if signal.minimum is not None:
        low = max(low, signal.minimum)
    if signal.maximum is not None:
        high = min(high, signal.maximum)
    return float(low), float(high)
