"""Decoding of the frames of a log: their messages, their channels, and the samples in them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bench_protocol import j1939
from bench_protocol.account import Account
from bench_protocol.can_codec import Decoder
from bench_protocol.dbc import Dbc, DbcError, Described, read_dbc
from bench_protocol.dbc_decoding import Decoding
from bench_protocol.j1939 import ANNOUNCES, CARRIES, Reassembly
from bench_protocol.no_value import no_value_codes
from bench_protocol.table import TABLE
from bench_records.layout import RecordError, SignalInfo
from drivers.can_files.frames import CanLogError, Frames, Kind
from drivers.can_files.reading import read_log
from test_plans.recording import recorded_signals

if TYPE_CHECKING:
    from drivers.can_files.candump import Stamps
from typing import TYPE_CHECKING

from bench_records.tables.reading import Series
from diagnosis.contracts import DiagnosisError
from drivers.can_files.reading import OTHER_FORMS, frames_form, log_of_others

if TYPE_CHECKING:
    from bench_records.tables.keys import Source
    from diagnosis.systems.map_file import FrameKeys

#: Times (ns), numbers of signals, values.
Samples = tuple[Any, Any, Any]
_BATCH: Final = 4096
#: Mask of a 29-bit identifier without its priority.
_SENDER: Final = 0x3FF_FFFF


@dataclass(frozen=True)
class LogKeys:
    """Properties of a log of frames that the file itself does not state."""

    dbc: Path | None = None
    charset: str | None = None  #: of the DBC
    channel: str | None = None
    stamps: Stamps | None = None


@dataclass(frozen=True)
class Log:
    """The signals of a log, its first time (ns), and a function that yields its samples."""

    signals: list[SignalInfo]
    start: int
    samples: Callable[[], Iterator[Samples]]


def read_frames_of(source: Path, keys: LogKeys, account: Account) -> Log:
    """Return the content of a log, decoded with our own messages or with those of a DBC. Raises RecordError for a log
    or a DBC that cannot be read.
    """
    try:
        dbc = None if keys.dbc is None else read_dbc(keys.dbc, keys.charset)
        frames = read_log(source, account, keys.stamps)
        if dbc is not None and any(one.j1939 for one in dbc.messages.values()):
            frames = _put_together(frames, dbc, account)
        counts = _on_channel(source, frames.counts(), keys.channel, account)
        if dbc is None:
            signals, samples = _by_our_table(source, frames, counts, account)
        else:
            signals, samples = _by_dbc(source, frames, counts, dbc, account)
    except (CanLogError, DbcError) as error:
        raise RecordError(str(error)) from None
    return Log(signals, next(iter(frames))[0], samples)


def _put_together(frames: Frames, dbc: Dbc, account: Account) -> Frames:
    """Return the frames with the parts of J1939 transport messages joined to whole messages."""
    parts = {
        kind
        for kind in frames.kinds
        if kind.extended
        and j1939.group_of(kind.identifier) in (ANNOUNCES, CARRIES)
        and dbc.of(kind.identifier, True) is None
    }
    if not parts:
        return frames
    found, reassembly = Frames(frames.unit), Reassembly(account)
    for time, kind, data in frames:
        if kind not in parts:
            found.add(time, kind, data, 0)
        elif message := reassembly.take(time, kind.channel, kind.identifier, data):
            found.add(time, Kind(kind.channel, message[0], True, False), message[1], 0)
    reassembly.end()
    if reassembly.whole:
        account.take(f"{reassembly.whole} J1939 messages of several packets (TP) were reassembled")
    return found


def _on_channel(
    source: Path, counts: Mapping[Kind, int], channel: str | None, account: Account
) -> dict[Kind, int]:
    """Return the number of frames by kind, on the selected channel or on all channels.

    Raises RecordError for an unknown channel.
    """
    channels = sorted({kind.channel for kind in counts})
    if channel is None:
        return dict(counts)
    if channel not in channels:
        raise RecordError(f"--channel {channel}: there is no such channel; {source} has {_listed(channels)}")
    for kind, count in counts.items():
        account.leave_out("frame(s) on other channels", 0 if kind.channel == channel else count)
    return {kind: count for kind, count in counts.items() if kind.channel == channel}


def _listed(channels: list[str]) -> str:
    many = f"the channels {', '.join(channels[:-1])} and {channels[-1]}"
    return many if len(channels) > 1 else f"one channel, {channels[0]}"


def _refuse_several(source: Path, what: str, channels: set[str]) -> None:
    if len(channels) > 1:
        found = sorted(channels)
        raise RecordError(
            f"{source}: {what} is on {_listed(found)}, perhaps from different devices; choose one, such as "
            f"--channel {found[0]}"
        )


def _by_our_table(
    source: Path, frames: Frames, counts: Mapping[Kind, int], account: Account
) -> tuple[list[SignalInfo], Callable[[], Iterator[Samples]]]:
    ours = {message.identifier: message.name for message in TABLE.messages if message.from_rig}
    wanted = set()
    channels: dict[int, set[str]] = {}
    for kind, count in counts.items():
        if kind.fd:
            account.leave_out("CAN FD frame(s)", count)
        elif kind.extended or kind.identifier not in ours:
            account.leave_out("frame(s) that the rig of this bench does not send", count)
        else:
            wanted.add(kind)
            channels.setdefault(kind.identifier, set()).add(kind.channel)
    for identifier, found in channels.items():
        _refuse_several(source, f"{identifier:#x} ({ours[identifier]})", found)
    if not wanted:
        raise RecordError(
            f"{source} has no message of the bench; for the messages of another rig, give its DBC with --dbc"
        )
    known = recorded_signals(TABLE)
    column = np.full(len(TABLE.signals), -1, np.int16)
    column[list(known)] = np.arange(len(known))
    decoder = Decoder(TABLE, from_rig=True)

    def samples() -> Iterator[Samples]:
        for block in frames.blocks(wanted.__contains__):
            found = decoder.decode(block)
            rows = column[found.signals]
            yield found.times[rows >= 0], rows[rows >= 0], found.values[rows >= 0]

    return list(known.values()), samples


def _by_dbc(
    source: Path, frames: Frames, counts: Mapping[Kind, int], dbc: Dbc, account: Account
) -> tuple[list[SignalInfo], Callable[[], Iterator[Samples]]]:
    names = _names(source, counts, dbc, account)
    if not names:
        raise RecordError(
            f"{source} has no message that {dbc.path} describes; check that the DBC belongs to this bus"
        )
    signals: list[SignalInfo] = []
    index: dict[tuple[str, str], int] = {}
    decodings: dict[str, Decoding] = {}
    for name, message in dict(sorted((name, message) for name, message in names.values())).items():
        decodings[name] = Decoding(message)
        for outside in decodings[name].outside:
            account.leave_out("signal(s) that do not fit into their message", at=f"{name}.{outside}")
        for signal in message.coding.signals:
            if (name, signal.name) not in index:
                index[name, signal.name] = len(signals)
                signals.append(_info(name, signal))

    def samples() -> Iterator[Samples]:
        rows: list[tuple[int, int, float]] = []
        for time, kind, data in frames:
            if kind in names:
                name = names[kind][0]
                found = decodings[name].values(data, account)
                rows += [(time, index[name, signal], value) for signal, value in found]
            if len(rows) >= _BATCH:
                yield judged(rows)
                rows.clear()
        if rows:
            yield judged(rows)
        for place in np.flatnonzero(beyond):
            account.take(
                f"{signals[place].name}: {beyond[place]} values are beyond the range that {dbc.path.name} gives, "
                f"{low[place]:g} to {high[place]:g} {signals[place].unit}".rstrip()
            )

    def judged(rows: list[tuple[int, int, float]]) -> Samples:
        times, places, values = (np.array(column) for column in zip(*rows, strict=True))
        outside = (values < low[places]) | (values > high[places])
        np.add.at(beyond, places[outside], 1)
        return times, places, values

    low, high = _ranges(decodings, index)
    beyond = np.zeros(len(signals), np.int64)
    return signals, samples


def _ranges(decodings: Mapping[str, Decoding], index: Mapping[tuple[str, str], int]) -> tuple[Any, Any]:
    """Return the smallest and largest value (n,) of each signal by the DBC, widened by rounding errors."""
    low, high = np.full(len(index), -np.inf), np.full(len(index), np.inf)
    for (name, signal), place in index.items():
        one = decodings[name].signals[signal]
        some = 1e-6 * abs(float(one.scale))
        if one.minimum is not None:
            low[place] = float(one.minimum) - some
        if one.maximum is not None:
            high[place] = float(one.maximum) + some
    return low, high


def _names(
    source: Path, counts: Mapping[Kind, int], dbc: Dbc, account: Account
) -> dict[Kind, tuple[str, Described]]:
    """Return name and message of each kind of frames. Messages of several senders get a name for each sender."""
    found: dict[Kind, Described] = {}
    for kind, count in counts.items():
        message = dbc.of(kind.identifier, kind.extended)
        if message is None:
            account.leave_out(
                f"frame(s) that {dbc.path.name} does not describe", count, f"identifier {kind.identifier:#x}"
            )
        else:
            found[kind] = message
    senders: dict[str, set[int]] = {}
    channels: dict[tuple[str, int], set[str]] = {}
    for kind, message in found.items():
        sender = kind.identifier & _SENDER if message.j1939 else 0
        senders.setdefault(message.name, set()).add(sender)
        channels.setdefault((message.name, sender), set()).add(kind.channel)
        if len(message.coding.signals) != len({one.name for one in message.coding.signals}):
            raise RecordError(
                f"{dbc.path}: {message.shown} cannot be read: {message.unsound}; correct the DBC"
            )
    for kind, message in found.items():
        sender = kind.identifier & _SENDER if message.j1939 else 0
        _refuse_several(source, f"{kind.identifier:#x} ({message.name})", channels[message.name, sender])
    return {
        kind: (_called(message, kind.identifier, senders[message.name]), message)
        for kind, message in found.items()
    }


def _called(message: Described, identifier: int, senders: set[int]) -> str:
    """Return the name of a message. If a J1939 message has several senders, the sender's address is appended."""
    if len(senders) < 2:
        return message.name
    to = {one >> 8 & 0xFF for one in senders}
    address = f"{j1939.source_of(identifier):02X}"
    return f"{message.name}@{address}" + (f">{identifier >> 8 & 0xFF:02X}" if len(to) > 1 else "")


def _info(message: str, signal: Any) -> SignalInfo:
    name, unit = f"{message}.{signal.name}", signal.unit or ""
    none = no_value_codes(signal)
    words = {int(key): str(text) for key, text in (signal.choices or {}).items() if int(key) not in none}
    return SignalInfo(name, unit, 1.0, name, "" if words else f"{message}, {unit or 'no unit'}", words)


def columns_of_frames(
    path: Path, keys: FrameKeys, beside: Path, wanted: Mapping[str, Source], account: Account
) -> dict[str, Series] | None:
    """Return the ``wanted`` signals of a log, each with its own times; None for a file of another kind.

    MDF files are logs if the keys name a DBC. Raises DiagnosisError, which names file, key and correct form.
    """
    if frames_form(path, keys.dbc is not None) is None:
        if path.is_file() and (what := log_of_others(path)):
            raise DiagnosisError(f"{path} is {what}, not a table of samples; {OTHER_FORMS}")
        return None
    if not path.is_file():
        raise DiagnosisError(f"{path} does not exist; check the path")
    if keys.charset is not None and keys.dbc is None:
        raise DiagnosisError(f"frames.charset = {keys.charset!r} is only for a DBC; give frames.dbc, too")
    dbc = None if keys.dbc is None else beside / keys.dbc
    try:
        log = read_frames_of(path, LogKeys(dbc, keys.charset, keys.channel, keys.stamps), account)
        parts = list(log.samples())
    except RecordError as error:
        raise DiagnosisError(str(error).replace("--channel ", "frames.channel = ")) from None
    times, rows, values = (np.concatenate([part[k] for part in parts]) for k in range(3))
    index = {signal.name: place for place, signal in enumerate(log.signals)}
    found = {}
    for key, source in wanted.items():
        place = index.get(str(source.column))
        if place is None:
            raise DiagnosisError(
                f"{path}: {key}.column = {source.column!r}: there is no such signal; the log has "
                f"{', '.join(sorted(index))}"
            )
        here, signal = rows == place, log.signals[place]
        seconds = (times[here] - log.start) / 1e9
        found[key] = Series(signal.name, seconds, values[here] / signal.scale, signal.unit, log.start)
    return found
