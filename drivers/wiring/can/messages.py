"""The messages of a CAN transport: from a DBC or the bits of the description, coded by cantools and protected."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import msgspec
from cantools import Error
from cantools.database.can import Message as Coding
from cantools.database.can import Signal
from cantools.database.conversion import BaseConversion

from bench_protocol.dbc import DbcError, Described, read_dbc
from bench_protocol.dbc_decoding import Decoding
from bench_protocol.frames import EXTENDED_ID_MAX, LENGTH_MAX, STANDARD_ID_MAX
from bench_protocol.suggestion import did_you_mean
from bench_protocol.units import ms
from drivers.can_fd import FD_LENGTH_MAX
from drivers.errors import WiringError
from drivers.wiring.can.keys import DBC_SAYS, CommonKeys, MessageKeys, SignalKeys
from drivers.wiring.can.message import Message
from drivers.wiring.can.protection import E2E_COUNTER_PERIOD, ChecksumKeys, checksum
from drivers.wiring.keys import convert, duration

_ALL: Final = "*"
_OTHERWISE: Final = "use another DBC, or state id and points here"
_STALE_PERIODS: Final = 3
_STALE_MIN: Final = 100 * ms


def read_messages(
    where: str, table: Mapping[str, Any], directory: Path, functions: Path | None, stale: float | None
) -> dict[str, Message]:
    """Return the messages by name. Raises WiringError, which begins with ``where``, for an invalid description."""
    tables = dict(table.get("messages", {}))
    common = convert(f'{where}.messages."{_ALL}"', tables.pop(_ALL, {}), CommonKeys)
    keys = {name: convert(f"{where}.messages.{name}", one, MessageKeys) for name, one in tables.items()}
    points: dict[str, dict[str, SignalKeys]] = {}
    for name, one in table.get("points", {}).items():
        message, dot, signal = name.partition(".")
        if not (message and dot and signal):
            raise WiringError(
                f'{where}.points: {name} is not the name of a point; write "Message.Signal", in quotes'
            )
        points.setdefault(message, {})[signal] = convert(f"{where}.points: {name}", one, SignalKeys)
    fd, j1939 = bool(table.get("fd")), table.get("j1939")
    described = _from_file(where, table.get("dbc"), table.get("charset"), directory)
    codings = {name: one.coding for name, one in described.items()}
    for name, one in keys.items():
        if one.id is not None:
            if name in codings:
                raise WiringError(
                    f"{where}.messages.{name}: id = {one.id:#x}, but the DBC describes {name} already; "
                    "remove id, or use another name"
                )
            codings[name] = _own_coding(
                f"{where}.messages.{name}",
                name,
                one,
                points.pop(name, {}),
                FD_LENGTH_MAX if fd else LENGTH_MAX,
            )
        elif name not in codings:
            raise WiringError(
                f"{where}.messages.{name}: no message of this name{_in_dbc(table)}; "
                f"{did_you_mean(name, codings)}. A message without a DBC needs id"
            )
    _check_points(where, table, points, codings)
    refused = _same_identifiers(where, codings, described)
    sent = {name for name, one in keys.items() if one.every is not None or one.values}
    unsendable = {
        name: f"{one.unsound}, so it cannot be sent" for name, one in described.items() if one.unsound
    }
    for names, faults in ((keys.keys(), refused), (sent, unsendable)):
        for name in sorted(names & faults.keys()):
            raise WiringError(f"{where}.messages.{name}: {faults[name]}; {_OTHERWISE}")
    _check_common(f'{where}.messages."{_ALL}"', common, codings)
    return {
        name: _message(
            f"{where}.messages.{name}",
            _described(name, coding, described.get(name), j1939),
            _with_common(keys.get(name, MessageKeys()), common, coding),
            points.get(name, {}),
            functions,
            stale,
            refused.get(name, ""),
        )
        for name, coding in codings.items()
    }


def _described(name: str, coding: Coding, by_file: Described | None, j1939: object) -> Described:
    """Return the description of a message, from its DBC or from its keys. ``j1939`` (true, false, or None without the
    key) states whether all messages with 29-bit identifiers are J1939.
    """
    one = by_file or Described(name, coding)
    return one if j1939 is None else replace(one, j1939=bool(j1939 and coding.is_extended_frame))


def _check_common(where: str, common: CommonKeys, codings: Mapping[str, Coding]) -> None:
    names = {signal.name for coding in codings.values() for signal in coding.signals}
    for name in (common.counter, (common.checksum or {}).get("signal")):
        if name is not None and name not in names:
            raise WiringError(f"{where}: no message has a signal {name!r}; {did_you_mean(name, names)}")


def _with_common(keys: MessageKeys, common: CommonKeys, coding: Coding) -> MessageKeys:
    """Return the keys of a message. If it has no counter or checksum key, but such a signal, the common key is used."""
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


def _own_coding(
    where: str, name: str, keys: MessageKeys, signals: Mapping[str, SignalKeys], most: int
) -> Coding:
    assert keys.id is not None
    extended = keys.id > STANDARD_ID_MAX if keys.extended is None else keys.extended
    highest = EXTENDED_ID_MAX if extended else STANDARD_ID_MAX
    if keys.id > highest:
        kind = "29-bit" if extended else "11-bit"
        raise WiringError(f"{where}: id = {keys.id:#x} is not a {kind} identifier; use 0 to {highest:#x}")
    length = LENGTH_MAX if keys.length is None else keys.length
    if length > most:
        raise WiringError(
            f"{where}: length = {length} bytes does not fit in a CAN frame; use {most} or less"
            + ("" if most > LENGTH_MAX else ", or set fd = true for CAN FD, which carries 64")
        )
    if not signals:
        raise WiringError(
            f'{where}: the message has no points; add one like "{name}.Signal" = {{ start = 0, length = 16 }}'
        )
    selector = next((signal for signal, one in signals.items() if one.selector), None)
    made = []
    for signal, one in signals.items():
        place = f"{where}: {name}.{signal}"
        if one.start is None or one.length is None:
            raise WiringError(f"{place} needs start and length in bits, because no DBC describes it")
        if one.page is not None and selector is None:
            raise WiringError(
                f"{place}: page = {one.page}, but no point of {name} selects the page; set selector "
                "for one of them"
            )
        if not one.scale:
            raise WiringError(f"{place}: scale = 0 maps all values to one number; use another scale")
        if one.is_float and one.length not in (16, 32, 64):
            raise WiringError(
                f"{place}: length = {one.length} is not the length of a float; use 16, 32 or 64 bits"
            )
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
        raise WiringError(
            f"{where}: {str(error)[0].lower()}{str(error)[1:].rstrip('.')}; correct start, length or byte_order"
        ) from None


def _check_points(
    where: str,
    table: Mapping[str, Any],
    points: Mapping[str, Mapping[str, SignalKeys]],
    codings: Mapping[str, Coding],
) -> None:
    """Raise WiringError for keys of points that no message has, or that the DBC defines already."""
    for message, signals in points.items():
        if message not in codings:
            raise WiringError(
                f"{where}.points: {message}.{next(iter(signals))}: no message "
                f"{message!r}{_in_dbc(table)}; {did_you_mean(message, codings)}. Without a DBC, "
                f"messages.{message} needs id"
            )
        names = [signal.name for signal in codings[message].signals]
        for signal, one in signals.items():
            if signal not in names:
                raise WiringError(
                    f"{where}.points: {message} has no signal {signal!r}; {did_you_mean(signal, names)}"
                )
            duplicate = [key for key in sorted(DBC_SAYS) if getattr(one, key) != getattr(SignalKeys(), key)]
            if duplicate:
                raise WiringError(
                    f"{where}.points: {message}.{signal}: {duplicate[0].removeprefix('is_')} is already in "
                    "the DBC; remove it here"
                )


def _same_identifiers(
    where: str, codings: Mapping[str, Coding], described: Mapping[str, Described]
) -> dict[str, str]:
    """Return by name why messages of the DBC with equal identifiers cannot be used.

    Raises WiringError if one of them is described in the wiring file.
    """
    seen: dict[tuple[int, bool], str] = {}
    refused: dict[str, str] = {}
    for name, coding in codings.items():
        key = coding.frame_id, coding.is_extended_frame
        if (other := seen.setdefault(key, name)) == name:
            continue
        reason = f"{other} and {name} have the same identifier, {coding.frame_id:#x}"
        if name not in described or other not in described:
            raise WiringError(f"{where}: {reason}; change the id of one of them")
        refused |= {other: reason, name: reason}
    return refused


def _message(
    where: str,
    one: Described,
    keys: MessageKeys,
    points: Mapping[str, SignalKeys],
    functions: Path | None,
    stale: float | None,
    refused: str = "",
) -> Message:
    name, coding = one.name, one.coding
    names = [signal.name for signal in coding.signals]
    decoding = Decoding(one)
    nulls = {}
    for signal in coding.signals:
        null = points[signal.name].null if signal.name in points else None
        if null is None:
            continue
        decoding.no_value.pop(signal.name, None)
        raws = [
            _raw_null(f"{where}: {signal.name}", signal, each)
            for each in (null if isinstance(null, list) else [null])
        ]
        nulls[signal.name] = [
            float(signal.conversion.raw_to_scaled(raw, decode_choices=False))  # type: ignore[arg-type]
            for raw in raws
        ]
    if keys.source is not None and not one.j1939:
        raise WiringError(
            f"{where}: source = {keys.source:#x} is for J1939 only; if the DBC does not state J1939, "
            "set j1939 = true"
        )
    limits = {signal.name: _limits(signal) for signal in coding.signals}
    every = 0.0 if keys.every is None else duration(f"{where}: every", keys.every)
    message = Message(name, coding, decoding, keys, 0.0, nulls, limits, every, refused=refused)
    pages = max(1, len(message.pages()))
    cycle = (coding.cycle_time or 0) * ms
    by_rate = max(_STALE_MIN, _STALE_PERIODS * cycle) if stale is None else stale
    message.stale = pages * by_rate if keys.stale is None else duration(f"{where}: stale", keys.stale)
    for field_name in (*keys.values, *([keys.counter] if keys.counter else [])):
        _require_signal(where, field_name, names)
    for given, value in keys.values.items():
        low, high = limits[given]
        if not low <= value <= high:
            raise WiringError(f"{where}: values: {given} = {value:g} does not fit; use {low:g} to {high:g}")
    message.points = {signal: f"{name}.{signal}" for signal in names}
    message.given = {
        **{one.name: float(one.initial) for one in coding.signals if isinstance(one.initial, int | float)},
        **keys.values,
    }
    _guard(where, message, functions)
    return message


def _raw_null(where: str, signal: Signal, null: float) -> float:
    """Return ``null`` as the signal stores it: a 32-bit float cannot store -999.9 exactly."""
    if signal.conversion.is_float:
        letter = {16: ">e", 32: ">f"}.get(signal.length, ">d")
        try:
            return float(struct.unpack(letter, struct.pack(letter, null))[0])
        except OverflowError:
            raise WiringError(
                f"{where}: null = {null:g} does not fit in a float of {signal.length} bits; use a "
                "smaller number"
            ) from None
    first = -(1 << signal.length - 1) if signal.is_signed else 0
    last = first + (1 << signal.length) - 1
    if null != round(null) or not first <= null <= last:
        raise WiringError(
            f"{where}: null = {null:.12g} does not fit into {signal.length} bits ({first} to {last}); "
            "use a whole number, before scale and offset"
        )
    return int(null)


def _guard(where: str, message: Message, functions: Path | None) -> None:
    """Add counter and checksum to ``message``."""
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
                f"{where}: counter_period = {message.counter_period} is too large, because {keys.counter} has "
                f"{room} values; use 1 to {room}"
            )
    if guard is None:
        return
    _require_signal(f"{where}.checksum", guard.signal, names)
    signal = coding.get_signal_by_name(guard.signal)
    if signal.multiplexer_ids:
        raise WiringError(
            f"{where}.checksum: {guard.signal} exists on some pages only; use a signal that is in every frame"
        )
    if signal.length != 8 and not guard.scheme.startswith("function:"):
        raise WiringError(
            f"{where}.checksum: {guard.signal} has {signal.length} bits, but {guard.scheme} needs 8; "
            "use a signal of 8 bits"
        )
    alone = Coding(
        coding.frame_id, message.name, coding.length, [signal], is_extended_frame=coding.is_extended_frame
    )
    full = -1 if signal.is_signed else 2**signal.length - 1
    message.checksum_mask = int.from_bytes(
        alone.encode({guard.signal: full}, scaling=False, strict=False), "big"
    )
    if guard.scheme == "e2e_p1" and message.checksum_mask >> 8 * (coding.length - 1) != 0xFF:
        raise WiringError(
            f"{where}.checksum: {guard.signal} is not in byte 0, where e2e_p1 has its checksum; use "
            "the signal in byte 0"
        )
    message.checksum_coding = alone
    message.checksum = checksum(f"{where}.checksum", guard, coding.is_extended_frame, functions)


def _require_signal(where: str, signal: str, names: Iterable[str]) -> None:
    if signal not in names:
        raise WiringError(f"{where}: there is no signal {signal!r}; {did_you_mean(signal, names)}")


def _limits(signal: Signal) -> tuple[float, float]:
    """Return the smallest and the largest number of a signal, by its bits and its limits in the DBC."""
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
