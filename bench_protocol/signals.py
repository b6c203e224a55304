"""What a signal, a CAN message and a Modbus register are: typed rows, validated when the table is imported."""

import hashlib
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, StrEnum
from functools import cached_property
from typing import Final

from bench_protocol.units import FACTORS, in_unit

BITS_MAX: Final = 64
CAN_BIT_RATE: Final = 500_000
#: A full classic frame with an 11-bit identifier and every possible stuff bit.
FRAME_BITS_WORST: Final = 135
BUS_LOAD_MAX: Final = 0.5
INT16_MAX: Final = 32767


class Kind(StrEnum):
    """Who writes a signal, and by which door it travels."""

    MEASUREMENT = "measurement"  #: a sensor of the rig: CAN and Modbus input registers
    STATUS = "status"  #: what the rig says of itself: CAN and Modbus input registers
    SETPOINT = "set-point"  #: streamed by the commander on CAN
    SETTING = "setting"  #: staged in Modbus holding registers, taken over by APPLY
    ACTION = "action"  #: a Modbus coil that acts on its rising edge
    INTERLOCK = "interlock"  #: a Modbus discrete input


class Protection(Enum):
    """What a CAN message carries so that loss, skew and corruption are seen."""

    NONE = 0
    COUNTER = 8  #: an 8-bit sample counter in the last byte
    E2E = 16  #: AUTOSAR E2E profile 1: CRC in byte 0, alive counter in the low half of byte 1

    @property
    def bits(self) -> int:
        """Bits of the frame that the protection takes."""
        return self.value


@dataclass(frozen=True, slots=True)
class Signal:
    """One value that crosses a wire. ``low``, ``high`` and ``step`` are SI; ``unit`` is what people read."""

    name: str
    kind: Kind
    unit: str
    low: float
    high: float
    step: float
    description: str
    choices: tuple[str, ...] = ()
    default: float = 0.0

    def __post_init__(self) -> None:
        if self.unit not in FACTORS:
            raise ValueError(f"{self.name}: unit {self.unit!r} is not one of {', '.join(FACTORS)}")
        if not self.low < self.high:
            raise ValueError(f"{self.name}: range {self.low:g} to {self.high:g} is empty")
        if not self.step > 0:
            raise ValueError(f"{self.name}: step = {self.step:g} must be positive")
        if not self.low <= self.default <= self.high and self.kind is Kind.SETTING:
            raise ValueError(
                f"{self.name}: default {self.default:g} is outside {self.low:g} to {self.high:g}"
            )
        if self.choices and self.high != len(self.choices) - 1:
            raise ValueError(
                f"{self.name}: high must be {len(self.choices) - 1}, the number of its last choice"
            )

    @property
    def attribute(self) -> tuple[str, str]:
        """The driver's device and attribute: ``left.height`` is ``bench.left.height``."""
        device, _, attribute = self.name.partition(".")
        return device, attribute

    def show(self, value: float) -> str:
        """Return ``value`` (SI) as people read it, with its unit or by the name of the choice."""
        if self.choices and not math.isnan(value) and 0 <= round(value) < len(self.choices):
            return self.choices[round(value)]
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{in_unit(value, self.unit):g}{unit}"

    def range_text(self) -> str:
        """Return the range that the wire carries, in the signal's unit."""
        if self.choices:
            return " | ".join(self.choices)
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{in_unit(self.low, self.unit):g} to {in_unit(self.high, self.unit):g}{unit}"

    def check(self, value: float) -> float:
        """Return ``value`` if the wire can carry it; ValueError with value, unit and range otherwise."""
        if not self.low <= value <= self.high:
            raise ValueError(
                f"{self.name} = {self.show(value)} does not fit on the wire, which carries {self.range_text()}"
            )
        return value


@dataclass(frozen=True, slots=True)
class Field:
    """A signal's place in a CAN message: ``raw = round((value - offset) / step)`` in ``bits`` bits.

    The lowest code of a signed field and the highest of an unsigned one mean "not available" and read as NaN; a
    field without ``nullable`` uses all its codes.
    """

    signal: str
    bits: int
    step: float = 0.0  #: SI; 0 takes the signal's own
    signed: bool = True
    nullable: bool = True

    @property
    def raw_low(self) -> int:
        """Smallest code that carries a value."""
        return -(1 << (self.bits - 1)) + int(self.nullable) if self.signed else 0

    @property
    def raw_high(self) -> int:
        """Largest code that carries a value."""
        return (1 << (self.bits - 1)) - 1 if self.signed else (1 << self.bits) - 1 - int(self.nullable)

    @property
    def raw_null(self) -> int:
        """The code for "not available"."""
        return -(1 << (self.bits - 1)) if self.signed else (1 << self.bits) - 1


@dataclass(frozen=True, slots=True)
class Message:
    """A classic CAN frame with an 11-bit identifier, sent ``rate`` times a second; little-endian fields in order."""

    name: str
    identifier: int
    rate: float  #: Hz; 0 means "on events only"
    from_rig: bool
    fields: tuple[Field, ...]
    protection: Protection
    description: str
    data_id: int = 0  #: for E2E

    @property
    def first_bit(self) -> int:
        """Where the fields start: an E2E header stands in front, a sample counter behind."""
        return 12 if self.protection is Protection.E2E else 0

    def placed(self) -> Iterable[tuple[Field, int]]:
        """Yield every field with its first bit."""
        bit = self.first_bit
        for field in self.fields:
            yield field, bit
            bit += field.bits

    @property
    def counter_bit(self) -> int:
        """First bit of the sample or alive counter."""
        return 8 if self.protection is Protection.E2E else 56


@dataclass(frozen=True, slots=True)
class Register:
    """A place in one of the four Modbus address spaces; ``address`` counts from 0, people's numbers from 1."""

    signal: str
    space: str  #: "input" | "holding" | "coil" | "discrete"
    address: int
    encoding: str  #: "float32" | "int16" | "uint16" | "uint32" | "bit"

    @property
    def words(self) -> int:
        """Registers (or bits) taken."""
        return 2 if self.encoding in ("float32", "uint32") else 1

    @property
    def number(self) -> int:
        """The 1-based reference number of classic documentation (40001 is holding register 0)."""
        return {"coil": 1, "discrete": 10_001, "input": 30_001, "holding": 40_001}[self.space] + self.address


@dataclass(frozen=True)
class Table:
    """Everything that crosses the wires: the one truth from which all codecs, maps and documents are made."""

    signals: tuple[Signal, ...]
    messages: tuple[Message, ...]
    registers: tuple[Register, ...]

    def __post_init__(self) -> None:
        _no_twice("signal", (signal.name for signal in self.signals))
        _no_twice("message", (message.name for message in self.messages))
        _no_twice("CAN identifier", (f"{message.identifier:#x}" for message in self.messages))
        for message in self.messages:
            self._check_message(message)
        self._check_registers()
        if self.bus_load > BUS_LOAD_MAX:
            raise ValueError(
                f"the CAN messages take {self.bus_load:.1%} of the bus; at most {BUS_LOAD_MAX:.0%}"
            )

    def _check_message(self, message: Message) -> None:
        used = message.first_bit + sum(field.bits for field in message.fields)
        room = BITS_MAX - (8 if message.protection is Protection.COUNTER else 0)
        if used > room:
            raise ValueError(f"{message.name}: its fields end at bit {used}, the frame has room for {room}")
        for field in message.fields:
            signal = self[field.signal]
            step = field.step or signal.step
            if round(signal.low / step) < field.raw_low or round(signal.high / step) > field.raw_high:
                raise ValueError(
                    f"{message.name}: {signal.name} carries {signal.range_text()}, too much for {field.bits} bits"
                )

    def _check_registers(self) -> None:
        places: Counter[tuple[str, int]] = Counter()
        for register in self.registers:
            places.update((register.space, register.address + k) for k in range(register.words))
            if not 0 <= register.address < 65536:
                raise ValueError(f"{register.signal}: address {register.address} is not in 0 to 65535")
        clash = [place for place, count in places.items() if count > 1]
        if clash:
            raise ValueError(f"{clash[0][0]} register {clash[0][1]} is taken twice")

    @cached_property
    def index(self) -> dict[str, int]:
        """The row of every signal by its name."""
        return {signal.name: row for row, signal in enumerate(self.signals)}

    @cached_property
    def message_index(self) -> dict[str, int]:
        """The row of every message by its name."""
        return {message.name: row for row, message in enumerate(self.messages)}

    def __getitem__(self, name: str) -> Signal:
        try:
            return self.signals[self.index[name]]
        except KeyError:
            raise KeyError(f"there is no signal {name!r}; `astb signals` lists them") from None

    def of_kind(self, *kinds: Kind) -> tuple[Signal, ...]:
        """Return the signals of the given kinds in table order."""
        return tuple(signal for signal in self.signals if signal.kind in kinds)

    @property
    def bus_load(self) -> float:
        """Worst-case fraction of a 500 kbit/s bus that the periodic messages take."""
        return sum(message.rate for message in self.messages) * FRAME_BITS_WORST / CAN_BIT_RATE

    @cached_property
    def map_hash(self) -> int:
        """32 bits that change with every change of the wire format; a driver refuses a rig with another one."""
        rows = [repr(row) for row in (*self.signals, *self.messages, *self.registers)]
        return int.from_bytes(hashlib.sha256("\n".join(rows).encode()).digest()[:4], "big")


def _no_twice(what: str, names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise ValueError(f"{what} {name} stands in the table {count} times")
