"""The socketcand ASCII protocol without sockets: bytes to events, and blocks of frames to bytes.

Every message is a line ``< … >``. A server greets with ``< hi >``, answers ``< open vcan0 >`` and ``< rawmode >`` with
``< ok >``, and then streams ``< frame 123 1700000000.123456 1A220344 >``; a client sends ``< send 123 4 1a 22 3 44 >``.
Reading is tolerant, because clients differ: extra spaces, unpadded numbers, and data bytes sign-extended to 32 or 64
bits (SavvyCAN) are accepted. Writing is strict.

Source of the format: the protocol description of socketcand (github.com/linux-can/socketcand) and the messages of
python-can 4.6 and SavvyCAN.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final
from xml.sax.saxutils import quoteattr

import numpy as np

from bench_protocol.frames import EXTENDED_ID_MAX, FRAME, LENGTH_MAX, STANDARD_ID_MAX, Block

#: Longest line either side may send, delimiters included (socketcand's own limit).
LINE_MAX: Final = 8290

GREETING: Final = b"< hi >"
OK: Final = b"< ok >"
ECHO: Final = b"< echo >"
RAW_MODE: Final = b"< rawmode >"

_RECORD: Final = struct.Struct("<qIBB8s")
_NS_PER_S: Final = 1_000_000_000
# An extended identifier is known by its eight digits; shorter ones are extended only if they must be.
_EXTENDED_DIGITS: Final = 8

#: A time stamp is kept in 64 bits of nanoseconds: the last whole second that fits, in the year 2262.
_SECONDS_MAX: Final = (1 << 63) // _NS_PER_S - 1

# The two messages that carry frames, in their usual spelling: one pass of a regular expression over everything
# that arrived. The repetitions are bounded, so that no line matched here can exceed LINE_MAX; any other
# spelling is parsed more slowly by _Line.
_USUAL: Final = re.compile(
    rb"<[ \t]{1,8}(?:"
    rb"frame[ \t]{1,8}([0-9A-Fa-f]{1,8})[ \t]{1,8}([0-9]{1,10})\.([0-9]{1,9})[ \t]{1,8}((?:[0-9A-Fa-f]{2}){0,8})"
    rb"|send[ \t]{1,8}([0-9A-Fa-f]{1,8})[ \t]{1,8}([0-8])((?:[ \t]{1,8}[0-9A-Fa-f]{1,2}){0,8})"
    rb")[ \t]{0,8}>"
)
_SIGN_EXTENDED: Final = re.compile(rb"(?:[fF]{6}|[fF]{14})[89a-fA-F][0-9a-fA-F]")


@dataclass(frozen=True, slots=True)
class Received:
    """Frames from a server, time-stamped by it (ns since the epoch, exact to 1 µs)."""

    block: Block


@dataclass(frozen=True, slots=True)
class Sent:
    """Frames that a client sends to the bus; their ``time`` is 0, the hub stamps them."""

    block: Block


@dataclass(frozen=True, slots=True)
class Command:
    """Any other well-formed line: ``hi``, ``ok``, ``open``, ``rawmode``, ``echo``, ``error``, …"""

    word: str
    arguments: tuple[str, ...] = ()

    def __str__(self) -> str:
        return " ".join(("<", self.word, *self.arguments, ">"))


@dataclass(frozen=True, slots=True)
class Malformed:
    """An invalid line, with the reason as text that names the sender as the cause."""

    reason: str


Event = Received | Sent | Command | Malformed


class _LineError(Exception):
    """The reason why a line is malformed."""


class Parser:
    """Converts the byte stream of one connection to events, whose contents do not depend on how the stream is split.

    ``sender`` names the other side in error messages. Adjacent frames form one block. Text outside ``< >`` is ignored.
    At most ``LINE_MAX`` bytes are kept between calls.
    """

    def __init__(self, sender: str = "the other side") -> None:
        self._sender = sender
        self._rest = b""
        self._overflowed = False

    def feed(self, data: bytes) -> list[Event]:
        """Return the events completed by ``data``; never raises an error for invalid input."""
        data = self._rest + data
        end = data.rfind(b">") + 1
        complete, self._rest = data[:end], data[end:]
        events: list[Event] = []
        if complete:
            lines = complete.count(b">")
            usual = [] if self._overflowed else _USUAL.findall(complete)
            if len(usual) == lines == complete.count(b"<"):
                self._usual(usual, events)
            else:
                self._parse_lines(complete, events)
        if len(self._rest) > 1 or self._overflowed:
            self._trim(events)
        return events

    def _usual(self, matches: list[tuple[bytes, ...]], events: list[Event]) -> None:
        """Append the frames that the regular expression found; adjacent frames of one kind form one block."""
        records: list[bytes] = []
        kind: type[Received] | type[Sent] = Received
        pack, from_hex = _RECORD.pack, bytes.fromhex
        for rx_id, seconds, fraction, rx_data, tx_id, count, tx_data in matches:
            this: type[Received] | type[Sent] = Received if rx_id else Sent
            if this is not kind:
                _flush(kind, records, events)
                kind = this
            digits = rx_id or tx_id
            identifier = int(digits, 16)
            extended = len(digits) == _EXTENDED_DIGITS or identifier > STANDARD_ID_MAX
            if identifier > EXTENDED_ID_MAX:
                _flush(kind, records, events)
                events.append(self._malformed(_identifier_error(digits)))
            elif rx_id and int(seconds) > _SECONDS_MAX:
                _flush(kind, records, events)
                events.append(self._malformed(_time_error(seconds)))
            elif rx_id:
                payload = from_hex(rx_data.decode())
                time = int(seconds) * _NS_PER_S + int(fraction.ljust(9, b"0"))
                records.append(pack(time, identifier, extended, len(payload), payload))
            else:
                length = int(count)
                if len(tx_data) == 3 * length and tx_data.count(b" ") == length and b"\t" not in tx_data:
                    # Only two digits for each byte give these counts, and then the fast conversion is right.
                    payload = from_hex(tx_data.decode())
                else:
                    payload = bytes([int(word, 16) for word in tx_data.split()])
                if len(payload) == length:
                    records.append(pack(0, identifier, extended, length, payload))
                else:
                    _flush(kind, records, events)
                    events.append(self._malformed(_count_error(length, len(payload))))
        _flush(kind, records, events)

    def _parse_lines(self, complete: bytes, events: list[Event]) -> None:
        """Append the events of ``complete`` line by line, with the tolerant parser."""
        records: list[bytes] = []
        kind: type[Received] | type[Sent] = Received
        for segment in complete.split(b">")[:-1]:
            _, *lines = segment.split(b"<")
            if self._overflowed:
                self._overflowed = False
                if not lines:
                    continue
            for cut_short in lines[:-1]:
                _flush(kind, records, events)
                events.append(self._unterminated(cut_short))
            if not lines:
                continue
            try:
                event = _line(lines[-1])
            except _LineError as error:
                _flush(kind, records, events)
                events.append(self._malformed(str(error)))
                continue
            if isinstance(event, tuple):
                if event[0] is not kind:
                    _flush(kind, records, events)
                    kind = event[0]
                records.append(event[1])
            else:
                _flush(kind, records, events)
                events.append(event)
        _flush(kind, records, events)

    def _trim(self, events: list[Event]) -> None:
        """Keep only the part of the incomplete rest that can still become a line."""
        start = self._rest.rfind(b"<")
        if start < 0:
            self._rest = b""
            return
        self._overflowed = False
        events.extend(self._unterminated(line) for line in self._rest[:start].split(b"<")[1:])
        self._rest = self._rest[start:]
        if len(self._rest) >= LINE_MAX:
            events.append(self._malformed(_length_error()))
            self._rest, self._overflowed = b"", True

    def _unterminated(self, text: bytes) -> Malformed:
        if len(text) + 1 >= LINE_MAX:
            return self._malformed(_length_error())
        return self._malformed(f"line '<{_printable(text)}' was not closed by '>' before the next '<'")

    def _malformed(self, reason: str) -> Malformed:
        return Malformed(f"{self._sender} sent a bad line: {reason}")


def frame_bytes(block: Block) -> bytes:
    """Return ``block`` as lines of a server; times in ns are truncated to 1 µs."""
    parts: list[str] = []
    append = parts.append
    last, stamp = -1, ""
    for time, identifier, extended, length, data in _RECORD.iter_unpack(_packed(block)):
        if time != last:
            last = time
            seconds, rest = divmod(time // 1000, 1_000_000)
            stamp = f"{seconds}.{rest:06d}"
        name = f"{identifier:08X}" if extended else f"{identifier:03X}"
        append(f"< frame {name} {stamp} {data[:length].hex().upper()} >")
    return "".join(parts).encode("ascii")


def send_bytes(block: Block) -> bytes:
    """Return ``block`` as lines of a client, without times."""
    parts: list[str] = []
    append = parts.append
    for _, identifier, extended, length, data in _RECORD.iter_unpack(_packed(block)):
        name = f"{identifier:08X}" if extended else f"{identifier:03X}"
        append(f"< send {name} {length} {data[:length].hex(' ')} >" if length else f"< send {name} 0 >")
    return "".join(parts).encode("ascii")


def open_bytes(bus: str) -> bytes:
    """Return a client's request for ``bus``. Raises ValueError if the name is not valid for a CAN interface."""
    if not re.fullmatch(r"[A-Za-z0-9_.:-]{1,15}", bus):
        raise ValueError(f"bus = {bus!r} cannot name a CAN interface (1 to 15 letters, digits, '_.:-')")
    return f"< open {bus} >".encode("ascii")


def error_bytes(reason: str) -> bytes:
    """Return a server's refusal; characters that could end the line are removed from ``reason``."""
    clean = re.sub(r"[<>\s]+", " ", reason).encode("ascii", "replace").decode("ascii")
    return f"< error {clean[:200].strip()} >".encode("ascii")


def beacon_bytes(name: str, host: str, port: int, buses: tuple[str, ...], description: str) -> bytes:
    """Return the datagram by which SavvyCAN and python-can find a server."""
    listed = "".join(f"<Bus name={quoteattr(bus)}/>" for bus in buses)
    return (
        f'<CANBeacon name={quoteattr(name)} type="SocketCAN" description={quoteattr(description)}>'
        f"<URL>can://{host}:{port}</URL>{listed}</CANBeacon>"
    ).encode()


def _packed(block: Block) -> bytes:
    """Return the bytes of the records. Raises TypeError if its elements are not of type `FRAME`."""
    if block.dtype != FRAME:
        raise TypeError(f"block = array of {block.dtype} is not a frame block (bench_protocol.frames.FRAME)")
    return block.tobytes()


def _flush(kind: type[Received] | type[Sent], records: list[bytes], events: list[Event]) -> None:
    if records:
        # A bytearray, so that the block is writable: the hub stamps it in place.
        events.append(kind(np.frombuffer(bytearray(b"".join(records)), FRAME)))
        records.clear()


def _line(text: bytes) -> Command | tuple[type[Received] | type[Sent], bytes]:
    """Return the command or the packed frame of the text between ``<`` and ``>``."""
    if len(text) + 2 > LINE_MAX:
        raise _LineError(_length_error())
    word, *arguments = text.split() or [b""]
    if word == b"frame":
        return Received, _received_record(arguments, text)
    if word == b"send":
        return Sent, _sent_record(arguments, text)
    if not word or not text.isascii():
        raise _LineError(f"'<{_printable(text)}>' is not a message")
    return Command(word.decode(), tuple(argument.decode() for argument in arguments))


def _received_record(arguments: list[bytes], text: bytes) -> bytes:
    if len(arguments) < 2:
        raise _LineError(
            f"'<{_printable(text)}>' is incomplete; it needs an identifier, a time stamp and data"
        )
    identifier, extended = _identifier(arguments[0])
    stamp = re.fullmatch(rb"(\d{1,10})(?:\.(\d*))?", arguments[1])
    if not stamp:
        raise _LineError(f"time stamp '{_printable(arguments[1])}' is not seconds.microseconds")
    if int(stamp[1]) > _SECONDS_MAX:
        raise _LineError(_time_error(stamp[1]))
    time = int(stamp[1]) * _NS_PER_S + int((stamp[2] or b"")[:9].ljust(9, b"0"))
    # The data is one word today; older servers put spaces between the bytes.
    try:
        payload = b"".join(bytes.fromhex(word.decode("ascii")) for word in arguments[2:])
    except ValueError:
        shown = _printable(b" ".join(arguments[2:]))
        raise _LineError(f"data '{shown}' is not pairs of hexadecimal digits") from None
    if len(payload) > LENGTH_MAX:
        raise _LineError(f"{len(payload)} data bytes do not fit; a classic CAN frame carries 0 to 8")
    return _RECORD.pack(time, identifier, extended, len(payload), payload)


def _sent_record(arguments: list[bytes], text: bytes) -> bytes:
    if len(arguments) < 2:
        raise _LineError(f"'<{_printable(text)}>' is incomplete; it needs an identifier, a length and data")
    identifier, extended = _identifier(arguments[0])
    if not re.fullmatch(rb"\d{1,4}", arguments[1]):
        raise _LineError(f"length '{_printable(arguments[1])}' is not a decimal number from 0 to 8")
    count = int(arguments[1])
    if count > LENGTH_MAX:
        raise _LineError(f"length {count} does not fit; a classic CAN frame carries 0 to 8 bytes")
    if len(arguments) - 2 != count:
        raise _LineError(_count_error(count, len(arguments) - 2))
    payload = bytes(_byte(word) for word in arguments[2:])
    return _RECORD.pack(0, identifier, extended, count, payload)


def _identifier(digits: bytes) -> tuple[int, bool]:
    if not re.fullmatch(rb"[0-9A-Fa-f]{1,8}", digits) or int(digits, 16) > EXTENDED_ID_MAX:
        raise _LineError(_identifier_error(digits))
    value = int(digits, 16)
    return value, len(digits) == _EXTENDED_DIGITS or value > STANDARD_ID_MAX


def _byte(word: bytes) -> int:
    if re.fullmatch(rb"0*[0-9A-Fa-f]{1,2}", word) or _SIGN_EXTENDED.fullmatch(word):
        return int(word, 16) & 0xFF
    raise _LineError(f"data byte '{_printable(word)}' is not a hexadecimal number from 0 to ff")


def _identifier_error(digits: bytes) -> str:
    return f"identifier '{_printable(digits)}' is not a hexadecimal number from 0 to {EXTENDED_ID_MAX:x}"


def _time_error(seconds: bytes) -> str:
    return f"time stamp of {int(seconds)} s is too late; use {_SECONDS_MAX} s or less"


def _count_error(announced: int, found: int) -> str:
    return f"length {announced} announced, but {found} data bytes follow"


def _length_error() -> str:
    return f"line longer than {LINE_MAX} bytes"


def _printable(text: bytes) -> str:
    """Return at most 40 characters of the received text, safe to print."""
    shown = text[:40].decode("ascii", "backslashreplace")
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in shown) + (
        "…" if len(text) > 40 else ""
    )


def iterate(block: Block) -> Iterator[tuple[int, int, bool, bytes]]:
    """Yield ``(time in ns, identifier, extended, data)`` of each frame, much faster than indexing the array."""
    for time, identifier, extended, length, data in _RECORD.iter_unpack(_packed(block)):
        yield time, identifier, bool(extended), data[:length]
