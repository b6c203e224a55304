"""The checks of a table of signals, its hash, and the comparison with an earlier table."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from bench_protocol.canopen import SERVICE_RATE_MAX
from bench_protocol.messages import Field, Message, Protection
from bench_protocol.registers import OWN_NAMES, Register, reading_number
from bench_protocol.signals import Kind, Signal
from bench_protocol.suggestion import did_you_mean

CAN_BIT_RATE: Final = 500_000
#: A full classic frame with an 11-bit identifier and every possible stuff bit.
FRAME_BITS_WORST: Final = 135
BUS_LOAD_MAX: Final = 0.5


class _Rows(dict[str, int]):
    """Rows by name; an error for a missing name includes the nearest one."""

    def __missing__(self, name: str) -> int:
        raise KeyError(
            f"there is no signal {name!r}; {did_you_mean(name, self, '`astb rig signals` lists them')}"
        )


@dataclass(frozen=True)
class Table:
    """All values on CAN and Modbus: the source of all codecs, maps and documents.

    Raises ValueError for equal names, identifiers or addresses, for fields or registers of unknown signals, for ranges
    that do not fit in their bits, and for a bus load above one half.
    """

    signals: tuple[Signal, ...]
    messages: tuple[Message, ...]
    registers: tuple[Register, ...]

    def __post_init__(self) -> None:
        _no_twice("signal", (signal.name for signal in self.signals))
        _no_twice("message", (message.name for message in self.messages))
        _no_twice("CAN identifier", (f"{message.identifier:#x}" for message in self.messages))
        for message in self.messages:
            for field in message.fields:
                self._check_field(message, field)
        self._check_registers()
        if self.bus_load > BUS_LOAD_MAX:
            raise ValueError(
                f"the CAN messages use {self.bus_load:.1%} of the bus, more than {BUS_LOAD_MAX:.0%}; reduce their rates"
            )

    def _check_field(self, message: Message, field: Field) -> None:
        if field.signal not in self.index:
            raise ValueError(
                f"{message.name}: its field {field.signal} is not a signal of the table; correct its name"
            )
        signal = self[field.signal]
        step = field.step or signal.step
        if round(signal.low / step) < field.raw_low or round(signal.high / step) > field.raw_high:
            raise ValueError(
                f"{message.name}: the range {signal.range_text()} of {signal.name} does not fit in "
                f"{field.bits} bits; use more bits"
            )

    def _check_registers(self) -> None:
        taken: dict[tuple[str, int], Register] = {}
        for register in self.registers:
            if register.signal not in self.index and register.signal not in OWN_NAMES:
                raise ValueError(
                    f"{register.signal} has a register, but is not a signal of the table; correct its name"
                )
            for address in range(register.address, register.address + register.words):
                other = taken.setdefault((register.space, address), register)
                if other is not register:
                    raise ValueError(
                        f"{register.space} register {address} is used by {other.signal} and "
                        f"{register.signal}; change one of them"
                    )

    @cached_property
    def index(self) -> dict[str, int]:
        """The row of every signal by name."""
        return _Rows((signal.name, row) for row, signal in enumerate(self.signals))

    @cached_property
    def message_index(self) -> dict[str, int]:
        """The row of every message by name."""
        return {message.name: row for row, message in enumerate(self.messages)}

    @cached_property
    def _by_number(self) -> dict[int, Signal]:
        return {reading_number(signal): signal for signal in self.of_kind(Kind.MEASUREMENT, Kind.STATUS)}

    def __getitem__(self, name: str) -> Signal:
        return self.signals[self.index[name]]

    def of_kind(self, *kinds: Kind) -> tuple[Signal, ...]:
        """Return the signals of the given kinds in table order."""
        return tuple(signal for signal in self.signals if signal.kind in kinds)

    def tripped(self, value: float) -> Signal | None:
        """Return the reading whose number is ``value``, a value of ``rig.tripped``; None for 0, NaN and unknown
        numbers.
        """
        return self._by_number.get(int(value) - 1) if value >= 1 else None

    def trip_number(self, name: str) -> int:
        """Return the number of the reading ``name`` in ``rig.tripped``: its number in the Modbus blocks, plus one."""
        return reading_number(self[name]) + 1

    @property
    def bus_load(self) -> float:
        """Worst-case load of a 500 kbit/s bus by the periodic messages, with heartbeats and SYNC (a fraction)."""
        rate = SERVICE_RATE_MAX + sum(message.rate for message in self.messages)
        return rate * FRAME_BITS_WORST / CAN_BIT_RATE

    @cached_property
    def places(self) -> dict[str, str]:
        """Return the place and coding of each signal on the wires, which must be equal in rig and drivers. The texts
        contain names, bits, steps, addresses, encodings, protection, rates and the numbers of choices. The order of
        rows, descriptions, ranges and display units are not included.
        """
        found: dict[str, str] = {}
        for message in self.messages:
            can = f"can {message.identifier:#05x}"
            sender = "rig" if message.from_rig else "commander"
            data_id = f" {message.data_id:#06x}" if message.protection is Protection.E2E else ""
            protection = f"{message.protection.name}{data_id}"
            found[can] = f"{message.name} {message.rate:g} Hz from {sender}, {protection}"
            if message.bound:
                found[f"{can} data id"] = "exclusive-or the token"
            for field, bit in message.placed():
                flags = f"{'signed' if field.signed else 'unsigned'}{' nullable' if field.nullable else ''}"
                step = field.step or self[field.signal].step
                found[f"{can} bit {bit:02}"] = f"{field.signal}, {field.bits} bits {flags}, step {step:.12g}"
        for register in self.registers:
            step_text = f" step {self[register.signal].step:.12g}" if register.encoding == "int16" else ""
            found[f"{register.space} {register.address:05}"] = (
                f"{register.signal} {register.encoding}{step_text}"
            )
        for signal in self.signals:
            for number, choice in enumerate(signal.choices):
                found[f"choice {signal.name} {number}"] = choice
        return dict(sorted(found.items()))

    @cached_property
    def map_hash(self) -> int:
        """32 bits that change with every change of the wire format; a driver refuses a rig with a different value."""
        return hash_of(self.places)


def hash_of(places: Mapping[str, str]) -> int:
    """Return the map hash of ``places``, in their order."""
    lines = "\n".join(f"{place}: {content}" for place, content in places.items())
    return int.from_bytes(hashlib.sha256(lines.encode()).digest()[:4], "big")


def moved(kept: Mapping[str, str], table: Table) -> list[str]:
    """Return a text for each of the ``kept`` places that is different or missing in ``table``. New places are allowed,
    and give no text.
    """
    places = table.places
    return [
        f"{place} was “{content}” and is now {f'“{places[place]}”' if place in places else 'empty'}"
        for place, content in kept.items()
        if places.get(place) != content
    ]


def _no_twice(what: str, names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise ValueError(f"{what} {name} occurs in the table {count} times; remove all but one")
