"""Points in Modbus tables: numbers, texts and bits as registers, and their grouping into requests."""

from __future__ import annotations

import math
import re
import struct
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Final, Literal

import msgspec
from msgspec import Meta

from bench_protocol.modbus import BITS_READ_MAX, ILLEGAL_ADDRESS, ILLEGAL_VALUE, REGISTERS_READ_MAX
from bench_protocol.suggestion import did_you_mean
from drivers.errors import BenchError, LinkLost, Refused, WiringError
from drivers.wiring.keys import AllAtOnce, convert

TableName = Literal["input", "holding", "coil", "discrete"]
TypeName = Literal[
    "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64", "string", "bit"
]
WordOrder = Literal["high", "low"]
ByteOrder = Literal["big", "little"]

_BITS: Final = frozenset({"coil", "discrete"})
_WRITABLE: Final = frozenset({"holding", "coil"})
#: Format and size in registers of each type but text.
_FORMATS: Final = {
    "bit": ("H", 1),
    "int16": ("h", 1),
    "uint16": ("H", 1),
    "int32": ("i", 2),
    "uint32": ("I", 2),
    "float32": ("f", 2),
    "int64": ("q", 4),
    "uint64": ("Q", 4),
    "float64": ("d", 4),
}
#: A request may have this many bits for each register of the largest request.
BITS_PER_REGISTER: Final = 16
_SINGLE_MAX: Final = (2.0 - 2.0**-23) * 2.0**127
_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_.]*")


class PointKeys(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A point of a Modbus device: number = scale · register value + offset."""

    table: TableName
    address: Annotated[int, Meta(ge=0, le=0xFFFF)]  #: of the first register, 0-based
    type: TypeName | None = None  #: default: uint16; bit for coils and discrete inputs
    bit: Annotated[int, Meta(ge=0, le=15)] | None = None  #: of a word, 0 is the lowest
    bits: Annotated[int, Meta(ge=1, le=16)] = 1  #: number of bits from ``bit`` on, as one number
    length: Annotated[int, Meta(ge=1, le=REGISTERS_READ_MAX)] | None = None  #: of a text, in registers
    scale: float = 1.0
    offset: float = 0.0
    null: float | list[float] | None = None  #: register value without a measurement
    group: str = ""  #: group in which it is polled; default: read on request
    word_order: WordOrder | None = None
    byte_order: ByteOrder | None = None


@dataclass(frozen=True, slots=True)
class RegisterPoint:
    """A point, its place, and its coding from words (uint16, as in requests) to a number and back."""

    name: str
    table: TableName
    address: int
    type: TypeName
    size: int  #: registers, or bits of a table of bits
    bit: int
    scale: float
    offset: float
    null: tuple[float, ...]
    group: str
    low_word_first: bool
    swapped: bool  #: the low byte of each register comes first
    bits: int = 1  #: of a register, from ``bit`` on

    @property
    def end(self) -> int:
        """The address after the point."""
        return self.address + self.size

    @property
    def place(self) -> tuple[TableName, int, int]:
        """The place of the point as a sort key, in which neighbours follow each other."""
        return self.table, self.address, self.size

    @property
    def writable(self) -> bool:
        """Whether a client can write the point."""
        return self.table in _WRITABLE

    @property
    def in_word(self) -> bool:
        """Whether the point is one bit or several bits of a register."""
        return self.type == "bit" and self.table not in _BITS

    def decode(self, words: Sequence[int]) -> float:
        """Return the number in ``words`` (``size`` of them, or one bit); NaN for a value in ``null``."""
        if self.table in _BITS:
            return float(bool(words[0]))
        if self.type == "bit":
            return float(int.from_bytes(self._bytes(words), "big") >> self.bit & self._mask)
        raw = float(struct.unpack(f">{_FORMATS[self.type][0]}", self._bytes(words))[0])
        return math.nan if raw in self.null else self.scale * raw + self.offset

    def text(self, words: Sequence[int]) -> str:
        """Return the text in ``words`` without its padding."""
        return self._bytes(words).decode("latin-1").split("\0")[0].strip()

    def encode(self, value: float) -> list[int]:
        """Return the words for ``value``. Raises ValueError if they cannot carry it."""
        if self.type == "bit":
            if not (0.0 <= value <= self._mask and value == int(value)):
                right = "a bit (0 or 1)" if self.bits == 1 else f"{self.bits} bits (0 to {self._mask})"
                raise ValueError(f"{self.name} = {value:g} is not {right}")
            return [int(value)]
        letter, _ = _FORMATS[self.type]
        if math.isnan(value) and self.null:
            raw = self.null[0]
        elif not math.isfinite(value):
            raise ValueError(f"{self.name} = {value:g} is not a number to write; use a finite one")
        else:
            raw = (value - self.offset) / self.scale
        try:
            data = struct.pack(f">{letter}", raw if letter in "fd" else round(raw))
        except (struct.error, OverflowError):
            low, high = self.range()
            raise ValueError(
                f"{self.name} = {value:g} does not fit in {self.type} at {self.address} with scale "
                f"{self.scale:g}; use {low:g} to {high:g}"
            ) from None
        return self._words(data)

    def range(self) -> tuple[float, float]:
        """Return the smallest and the largest number that fit."""
        if self.type in ("float32", "float64"):
            raw_high = _SINGLE_MAX if self.type == "float32" else sys.float_info.max
            raw_low = -raw_high
        else:
            bits = self.bits if self.type == "bit" else 16 * self.size
            signed = self.type.startswith("int")
            raw_low, raw_high = (
                (-(2.0 ** (bits - 1)), 2.0 ** (bits - 1) - 1) if signed else (0.0, 2.0**bits - 1)
            )
        ends = sorted((self.scale * raw_low + self.offset, self.scale * raw_high + self.offset))
        return ends[0], ends[1]

    def with_bit(self, word: int, value: float) -> int:
        """Return the register content ``word`` with the bits of this point set to ``value``."""
        held = int.from_bytes(self._bytes([word]), "big")
        held = held & ~(self._mask << self.bit) | self.encode(value)[0] << self.bit
        return self._words(held.to_bytes(2, "big"))[0]

    @property
    def _mask(self) -> int:
        return (1 << self.bits) - 1

    def _bytes(self, words: Sequence[int]) -> bytes:
        ordered = reversed(words) if self.low_word_first else words
        order: Literal["little", "big"] = "little" if self.swapped else "big"
        return b"".join(word.to_bytes(2, order) for word in ordered)

    def _words(self, data: bytes) -> list[int]:
        order: Literal["little", "big"] = "little" if self.swapped else "big"
        words = [int.from_bytes(data[k : k + 2], order) for k in range(0, len(data), 2)]
        return words[::-1] if self.low_word_first else words


def read_points(
    where: str, points: object, groups: Iterable[str], word_order: WordOrder, byte_order: ByteOrder
) -> dict[str, RegisterPoint]:
    """Return the points of a description by name. Raises WiringError for invalid or overlapping points."""
    if not isinstance(points, Mapping) or not points:
        raise WiringError(
            f'{where}: there are no points; add a line for each, like height = {{ table = "input", '
            f'address = 100, type = "int16", scale = 0.01 }}'
        )
    known = list(groups)
    found: dict[str, RegisterPoint] = {}
    with AllAtOnce() as wrong:
        for name, table in points.items():
            with wrong.next():
                found[name] = _named(f"{where}: {name}", name, table, known, word_order, byte_order)
    _check_overlaps(where, found.values())
    return found


def _named(
    place: str, name: str, table: object, groups: list[str], word_order: WordOrder, byte_order: ByteOrder
) -> RegisterPoint:
    if not _NAME.fullmatch(name):
        raise WiringError(
            f"{place} is not a valid name; begin with a letter, and use letters, digits, _ and . only"
        )
    point = _point(place, name, convert(place, table, PointKeys), word_order, byte_order)
    if point.group and point.group not in groups:
        raise WiringError(
            f"{place}: group = {point.group!r} is not among [groups]; {did_you_mean(point.group, groups)}"
        )
    return point


def _point(
    place: str, name: str, keys: PointKeys, word_order: WordOrder, byte_order: ByteOrder
) -> RegisterPoint:
    bits = keys.table in _BITS
    kind: TypeName = keys.type or ("bit" if bits or keys.bit is not None else "uint16")
    if bits and kind != "bit":
        raise WiringError(f"{place}: type = {kind!r} does not fit in a {keys.table} (1 bit); remove type")
    if kind == "bit" and bits == (keys.bit is not None):
        raise WiringError(
            f"{place}: bit = {keys.bit} has no meaning in a {keys.table}, which is one bit; remove bit"
            if bits
            else f"{place}: type = 'bit' in a register needs bit = 0 (the lowest) to 15"
        )
    if kind != "bit" and keys.bit is not None:
        raise WiringError(
            f"{place}: bit = {keys.bit} has no meaning for type = {kind!r}; it is for type = 'bit'"
        )
    if (kind == "string") != (keys.length is not None):
        raise WiringError(
            f"{place}: a string needs length; add it, in registers"
            if kind == "string"
            else f"{place}: length = {keys.length} is for type = 'string'; {kind} has a fixed size"
        )
    if not (keys.scale and math.isfinite(keys.scale) and math.isfinite(keys.offset)):
        raise WiringError(
            f"{place}: scale = {keys.scale:g}, offset = {keys.offset:g} map all values to one number; "
            "use another scale"
        )
    if kind in ("bit", "string") and (keys.scale, keys.offset, keys.null) != (1.0, 0.0, None):
        raise WiringError(f"{place}: scale, offset and null are for numbers; remove them for a {kind}")
    if keys.bits > 1 and (bits or kind != "bit"):
        target = f"a {keys.table}" if bits else f"type = {kind!r}"
        raise WiringError(f"{place}: bits = {keys.bits} has no meaning for {target}; remove bits")
    if (keys.bit or 0) + keys.bits > BITS_PER_REGISTER:
        raise WiringError(
            f"{place}: bits = {keys.bits} from bit = {keys.bit} on go beyond bit 15, the highest of a "
            "register; use fewer bits, or a lower bit"
        )
    size = keys.length or _FORMATS[kind][1]
    if keys.address + size > 0x1_0000:
        raise WiringError(f"{place}: address = {keys.address} with {size} registers exceeds 65535; lower it")
    null = () if keys.null is None else tuple(keys.null) if isinstance(keys.null, list) else (keys.null,)
    point = RegisterPoint(
        name,
        keys.table,
        keys.address,
        kind,
        size,
        keys.bit or 0,
        keys.scale,
        keys.offset,
        null,
        keys.group,
        (keys.word_order or word_order) == "low" and kind != "string",
        (keys.byte_order or byte_order) == "little",
        keys.bits,
    )
    return replace(point, null=tuple(_held(place, point, code) for code in null))


def _held(place: str, point: RegisterPoint, code: float) -> float:
    """Return ``code`` as the registers store it: a float32 cannot store -999.9 exactly."""
    low, high = replace(point, scale=1.0, offset=0.0).range()
    if point.type in ("float32", "float64"):
        if math.isfinite(code) and not low <= code <= high:
            raise WiringError(
                f"{place}: null = {code:g} does not fit into {point.type}; use {low:g} to {high:g}"
            )
        letter = f">{_FORMATS[point.type][0]}"
        return float(struct.unpack(letter, struct.pack(letter, code))[0])
    if not (low <= code <= high and code == round(code)):
        raise WiringError(
            f"{place}: null = {code:.12g} does not fit into {point.type} ({low:.12g} to {high:.12g}); "
            "use a whole number, before scale and offset"
        )
    return code


def _check_overlaps(where: str, points: Iterable[RegisterPoint]) -> None:
    """Raise WiringError for two points in one place, except bits of a word and the word that contains them."""
    ordered = sorted(points, key=lambda point: point.place)
    for k, point in enumerate(ordered):
        for other in ordered[k + 1 :]:
            if other.table != point.table or other.address >= point.end:
                break
            if _compatible(point, other):
                continue
            what = "coil" if point.table == "coil" else "input" if point.table == "discrete" else "register"
            raise WiringError(
                f"{where}: {point.name} ({_address_text(point)}) and {other.name} ({_address_text(other)}) share a "
                f"{what}; correct one address, or remove one point (several signals may use the same "
                "point)"
            )


def _compatible(one: RegisterPoint, other: RegisterPoint) -> bool:
    if one.in_word and other.in_word:
        return one.bit + one.bits <= other.bit or other.bit + other.bits <= one.bit
    words = {one.type, other.type} - {"bit"}
    return (one.in_word or other.in_word) and words <= {"int16", "uint16"}


def _address_text(point: RegisterPoint) -> str:
    if point.in_word:
        last = f" to {point.bit + point.bits - 1}" if point.bits > 1 else ""
        return f"bit {point.bit}{last} of {point.table} {point.address}"
    last = f" to {point.end - 1}" if point.size > 1 else ""
    return f"{point.type} in {point.table} {point.address}{last}"


@dataclass(frozen=True, slots=True)
class Span:
    """Registers (or bits) of one table that one request reads, and the points in them."""

    table: TableName
    address: int
    count: int
    points: tuple[RegisterPoint, ...]

    def decode(self, words: Sequence[Any]) -> dict[str, float]:
        """Return the numbers of all points by name from the words read."""
        first = self.address
        return {
            point.name: point.decode(words[point.address - first : point.end - first])
            for point in self.points
        }


def spans(points: Iterable[RegisterPoint], gap: int, request_max: int = REGISTERS_READ_MAX) -> list[Span]:
    """Return the requests that read ``points``, each of at most ``request_max`` registers.

    A request also reads up to ``gap`` unused registers between two points.
    """
    found: list[Span] = []
    for point in sorted(points, key=lambda point: point.place):
        limit = (
            request_max if point.table not in _BITS else min(BITS_READ_MAX, BITS_PER_REGISTER * request_max)
        )
        last = found[-1] if found else None
        if (
            last is not None
            and last.table == point.table
            and point.address <= last.address + last.count + gap
            and max(point.end, last.address + last.count) - last.address <= limit
        ):
            count = max(point.end, last.address + last.count) - last.address
            found[-1] = Span(last.table, last.address, count, (*last.points, point))
        else:
            found.append(Span(point.table, point.address, point.size, (point,)))
    return found


Read = Callable[[Span], Sequence[int]]
#: Number of points that are polled one by one.
_TRIED_MAX: Final = 32


def explained(span: Span, error: BenchError, read: Read, gap: int) -> BenchError:
    """Return ``error``, raised by a request for ``span``, with a hint that smaller requests have found.

    The hint states which points the device refuses, or how many registers it accepts in one request.
    """
    if span.count == 1 or (isinstance(error, Refused) and error.code not in (ILLEGAL_ADDRESS, ILLEGAL_VALUE)):
        return error
    points = span.points[:_TRIED_MAX]
    alone = [Span(one.table, one.address, one.size, (one,)) for one in points]
    if isinstance(error, LinkLost) and not _reads(alone[0], read):
        return error
    bad = [f"{one.points[0].name} ({one.table} {one.address})" for one in alone if not _reads(one, read)]
    if bad:
        hint = f"the device refuses {', '.join(bad)}" + (
            ", and reads the others" if len(bad) < len(points) else ""
        )
    else:
        narrow = _most(span, read)
        hint = (
            f"the device answers requests of {narrow} registers; set request_max = {narrow}"
            if narrow
            else "the device answers a request for each point alone"
        )
        if gap:
            hint += ", or set gap = 0, if there are unused addresses between the points"
    text = f"{error}; {hint}"
    return Refused(text, error.code) if isinstance(error, Refused) else LinkLost(text)


def _reads(span: Span, read: Read) -> bool:
    try:
        read(span)
    except BenchError:
        return False
    return True


def _most(span: Span, read: Read) -> int:
    """Return the number of registers from the start of ``span`` that one request can read."""
    low, high = 0, span.count
    while high - low > 1:
        middle = (low + high) // 2
        if _reads(Span(span.table, span.address, middle, ()), read):
            low = middle
        else:
            high = middle
    return low
