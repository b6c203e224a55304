"""The kinds of Modbus registers, and the addresses of the registers of a signal.

Input registers carry the readings twice, as floats and as scaled twins, in blocks that one request each can read. The
number of a reading selects its float (:attr:`Signal.address`), its scaled twin, and the discrete input with its quality
(available or not)::

    number           0    1    2  ...  end             62    63  ...  end
    float     99*  100  102  104  ...   *    1099*   1100  1102  ...   *
    scaled   299*  300  301  302  ...   *    1299*   1300  1301  ...   *
    quality        100  101  102  ...                 162   163  ...

``*`` is the sequence number of the sampling instant. It is in the register before the first reading of a block and in
the register after the last one. The quality has no sequence number. A block without readings does not exist.

Registers never move. A new reading gets the number after the end of the block, and the new end follows it. The register
of the former end keeps the sequence number. So each number without a reading is a former end (`free_address`).

The holding register of a setting has its staged value. The input register with an address larger by `ACTIVE_BLOCK` has
the active value.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from bench_protocol.signals import Kind, Signal

ADDRESSES: Final = 65_536
#: The address spaces with the offset of the 1-based numbers of classic documentation.
SPACES: Final = {"input": 30_001, "holding": 40_001, "coil": 1, "discrete": 10_001}
#: The encodings with the registers (or bits) that they take.
ENCODINGS: Final = {"float32": 2, "uint32": 2, "int16": 1, "uint16": 1, "bit": 1}
_BIT_SPACES: Final = ("coil", "discrete")

#: Largest magnitude of a scaled twin.
INT16_MAX: Final = 32767
PROBE_FLOAT: Final = 3.14159
PROBE_WORD: Final = 0x12345678
FLOAT_BLOCK: Final = 100
SCALED_BLOCK: Final = 300
QUALITY_BLOCK: Final = 100
#: Offset between the holding register of a setting and the input register of its value in force.
ACTIVE_BLOCK: Final = 400


class Block(NamedTuple):
    """A block of readings that one request of 125 registers can read, with the sequence numbers at both ends."""

    numbers: range
    floats: int  #: address of the first
    scaled: int

    def address(self, number: int) -> int:
        """Return the input register of the float of a reading."""
        return self.floats + 2 * (number - self.numbers.start)

    def twin(self, number: int) -> int:
        """Return the input register of the scaled twin of a reading."""
        return self.scaled + number - self.numbers.start

    def span(self, sequences: Collection[int]) -> tuple[int, int] | None:
        """Return the first and the last input register of the block, which have a sequence number. ``sequences`` are
        all input registers with one. Return None if the block does not exist.
        """
        opening = self.floats - 1
        found = [one for one in sequences if opening <= one <= self.address(self.numbers.stop)]
        return (opening, max(found)) if opening in found and max(found) > opening else None


#: Older drivers know only the first block, and search for its end up to its scaled twins.
BLOCKS: Final = (
    Block(range(61), FLOAT_BLOCK, SCALED_BLOCK),
    Block(range(62, 123), FLOAT_BLOCK + 1000, SCALED_BLOCK + 1000),
)
LEASE_ADDRESS: Final = 0
WATCHDOG_ADDRESS: Final = 1

#: Kinds of signals in the blocks.
READINGS: Final = (Kind.MEASUREMENT, Kind.STATUS)
_SPACE_OF: Final = {Kind.SETTING: "holding", Kind.ACTION: "coil", Kind.INTERLOCK: "discrete"}


@dataclass(frozen=True, slots=True)
class Register:
    """A place in one of the four Modbus address spaces; ``address`` is 0-based, ``number`` 1-based."""

    signal: str
    space: str  #: one of `SPACES`
    address: int
    encoding: str  #: one of `ENCODINGS`

    def __post_init__(self) -> None:
        if self.space not in SPACES:
            raise ValueError(
                f"{self.signal}: space {self.space!r} is unknown; use one of {', '.join(SPACES)}"
            )
        if self.encoding not in ENCODINGS:
            raise ValueError(
                f"{self.signal}: encoding {self.encoding!r} is unknown; use one of {', '.join(ENCODINGS)}"
            )
        if (self.encoding == "bit") is not (self.space in _BIT_SPACES):
            raise ValueError(
                f"{self.signal}: {self.encoding} is not possible in the space {self.space}; use bit "
                "in coil and discrete only"
            )
        if not 0 <= self.address <= ADDRESSES - self.words:
            raise ValueError(
                f"{self.signal}: address {self.address} is out of range; use 0 to {ADDRESSES - self.words}"
            )

    @property
    def words(self) -> int:
        """Number of registers (or bits)."""
        return ENCODINGS[self.encoding]

    @property
    def number(self) -> int:
        """The 1-based reference number of classic documentation (40001 is holding register 0)."""
        return SPACES[self.space] + self.address


#: Name of the sequence number of a block in the map.
SEQUENCE: Final = "modbus.sequence"
#: Registers of the server itself.
OWN_REGISTERS: Final = (
    Register(SEQUENCE, "input", 0, "uint16"),
    Register("modbus.map_hash", "input", 1, "uint32"),
    Register("modbus.probe_float", "input", 3, "float32"),
    Register("modbus.probe_word", "input", 5, "uint32"),
    Register("modbus.lease", "holding", LEASE_ADDRESS, "uint16"),
    Register("modbus.watchdog", "holding", WATCHDOG_ADDRESS, "uint16"),
)
#: Names of registers that are not signals.
OWN_NAMES: Final = tuple(dict.fromkeys(register.signal for register in OWN_REGISTERS))


def _block_and_number(signal: Signal) -> tuple[Block, int]:
    if signal.address is not None:
        for block in BLOCKS:
            steps, rest = divmod(signal.address - block.floats, 2)
            if not rest and 0 <= steps < len(block.numbers):
                return block, block.numbers[steps]
    given = "no address" if signal.address is None else f"address {signal.address}"
    places = " or ".join(f"from {block.floats} to {block.address(block.numbers[-1])}" for block in BLOCKS)
    raise ValueError(f"{signal.name} has {given}; give it an even input register {places} that is free")


def reading_number(signal: Signal) -> int:
    """Return the number of a reading in the blocks. Raises ValueError for an invalid address of its float."""
    return _block_and_number(signal)[1]


def twin_address(signal: Signal) -> int:
    """Return the input register of the scaled twin of a reading."""
    block, number = _block_and_number(signal)
    return block.twin(number)


def free_address(signals: Iterable[Signal]) -> int:
    """Return the input register for the float of the next new reading. Raises ValueError if none is left.

    The present last sequence number of the block stays in its place, and the float begins two registers after it.
    """
    taken = [reading_number(signal) for signal in signals if signal.kind in READINGS]
    for block in BLOCKS:
        free = max((number + 2 for number in taken if number in block.numbers), default=block.numbers.start)
        if free in block.numbers:
            return block.address(free)
    raise ValueError("the blocks of readings are full; add a block to bench_protocol.registers.BLOCKS")


def registers_of(signals: Iterable[Signal]) -> tuple[Register, ...]:
    """Return the Modbus map of ``signals`` by address: the server's own registers, readings, settings, actions and
    interlocks.

    Raises ValueError for a signal without the address that its kind needs, and for two readings with one address.
    """
    readings: dict[int, str] = {}
    others: list[Register] = []
    for signal in signals:
        if signal.kind in READINGS:
            other = readings.setdefault(reading_number(signal), signal.name)
            if other != signal.name:
                raise ValueError(
                    f"{other} and {signal.name} both have the input register {signal.address}; change "
                    "one of them"
                )
        elif signal.kind not in (Kind.SETPOINT, Kind.FURTHER):
            others += _without_blocks(signal)
    spaces = list(SPACES)
    return tuple(
        sorted(
            (*OWN_REGISTERS, *_blocks(readings), *others),
            key=lambda register: (spaces.index(register.space), register.address),
        )
    )


def _without_blocks(signal: Signal) -> Iterator[Register]:
    space = _SPACE_OF[signal.kind]
    if signal.address is None:
        raise ValueError(f"{signal.name} has no address; a {signal.kind} needs one in the space {space}")
    yield Register(signal.name, space, signal.address, "bit" if space in _BIT_SPACES else "float32")
    if signal.kind is Kind.SETTING:
        yield Register(signal.name, "input", ACTIVE_BLOCK + signal.address, "float32")


def _blocks(readings: Mapping[int, str]) -> Iterator[Register]:
    """Yield the readings by number, and the sequence number at the start and at every number without a reading."""
    for block in BLOCKS:
        last = max((number for number in readings if number in block.numbers), default=None)
        if last is None:
            continue
        yield Register(SEQUENCE, "input", block.floats - 1, "uint16")
        yield Register(SEQUENCE, "input", block.scaled - 1, "uint16")
        for number in range(block.numbers.start, last + 2):
            name, address, twin = readings.get(number), block.address(number), block.twin(number)
            if name is None:
                yield Register(SEQUENCE, "input", address, "uint16")
                if number < last:  # a block is read in one request: it has no holes
                    yield Register(SEQUENCE, "input", address + 1, "uint16")
                yield Register(SEQUENCE, "input", twin, "uint16")
            else:
                yield Register(name, "input", address, "float32")
                yield Register(name, "input", twin, "int16")
                yield Register(name, "discrete", QUALITY_BLOCK + number, "bit")
