"""What a Modbus register is, and where the registers of a signal stand.

Two blocks of input registers carry the same readings, as floats and as scaled twins. The address of a reading's float
(:attr:`Signal.address`) is its number in both, and among the discrete inputs that say whether it is available::

    number      0     1     2          n − 1   end
    float      100   102   104   ...           sequence
    scaled     300   301   302   ...           sequence
    quality    100   101   102   ...

Each block stands between two copies of the sequence number of the sampling instant. Registers never move: a reading
that is added takes the number behind the old end, where the sequence number stays as well, so that a number without a
reading means: here a block ended once.

The holding register of a setting has what is staged, the input register `ACTIVE_BLOCK` behind it what is in force.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from bench_protocol.signals import Kind, Signal

ADDRESSES: Final = 65_536
#: The address spaces with what stands before the 1-based numbers of classic documentation.
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
#: How far behind its holding register a setting has the input register of the value in force.
ACTIVE_BLOCK: Final = 400
#: One request of 125 registers reads all floats with the sequence numbers at both ends.
READINGS_MAX: Final = 61
LEASE_ADDRESS: Final = 0
WATCHDOG_ADDRESS: Final = 1

_SPACE_OF: Final = {Kind.SETTING: "holding", Kind.ACTION: "coil", Kind.INTERLOCK: "discrete"}


@dataclass(frozen=True, slots=True)
class Register:
    """A place in one of the four Modbus address spaces; ``address`` counts from 0, people's numbers from 1."""

    signal: str
    space: str  #: one of `SPACES`
    address: int
    encoding: str  #: one of `ENCODINGS`

    def __post_init__(self) -> None:
        if self.space not in SPACES:
            raise ValueError(f"{self.signal}: space {self.space!r} is not one of {', '.join(SPACES)}")
        if self.encoding not in ENCODINGS:
            raise ValueError(
                f"{self.signal}: encoding {self.encoding!r} is not one of {', '.join(ENCODINGS)}"
            )
        if (self.encoding == "bit") is not (self.space in _BIT_SPACES):
            raise ValueError(f"{self.signal}: {self.encoding} does not fit among the {self.space} registers")
        if not 0 <= self.address <= ADDRESSES - self.words:
            raise ValueError(f"{self.signal}: address {self.address} is not in 0 to {ADDRESSES - self.words}")

    @property
    def words(self) -> int:
        """Registers (or bits) taken."""
        return ENCODINGS[self.encoding]

    @property
    def number(self) -> int:
        """The 1-based reference number of classic documentation (40001 is holding register 0)."""
        return SPACES[self.space] + self.address


#: What the sequence number of a block is called in the map.
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
#: What a register may carry that is no signal.
OWN_NAMES: Final = tuple(dict.fromkeys(register.signal for register in OWN_REGISTERS))


def reading_number(signal: Signal) -> int:
    """Return the number of a reading in the blocks; ValueError for an address that its float cannot have."""
    number, rest = divmod((-1 if signal.address is None else signal.address) - FLOAT_BLOCK, 2)
    if rest or not 0 <= number < READINGS_MAX:
        given = "no address" if signal.address is None else f"address {signal.address}"
        raise ValueError(
            f"{signal.name} has {given}; its float needs an even input register from {FLOAT_BLOCK} to "
            f"{FLOAT_BLOCK + 2 * READINGS_MAX - 2} that nothing else has"
        )
    return number


def registers_of(signals: Iterable[Signal]) -> tuple[Register, ...]:
    """Return the Modbus map of ``signals`` by address: the server's own registers, the readings, what is written.

    ValueError for a signal without the address that its kind needs.
    """
    readings: dict[int, str] = {}
    others: list[Register] = []
    for signal in signals:
        if signal.kind in (Kind.MEASUREMENT, Kind.STATUS):
            other = readings.setdefault(reading_number(signal), signal.name)
            if other != signal.name:
                raise ValueError(f"{other} and {signal.name} both have the input register {signal.address}")
        elif signal.kind not in (Kind.SETPOINT, Kind.FURTHER):
            others += _without_blocks(signal)
    spaces = list(SPACES)
    return tuple(
        sorted(
            (*OWN_REGISTERS, *(_blocks(readings) if readings else ()), *others),
            key=lambda register: (spaces.index(register.space), register.address),
        )
    )


def _without_blocks(signal: Signal) -> Iterator[Register]:
    space = _SPACE_OF[signal.kind]
    if signal.address is None:
        raise ValueError(f"{signal.name}, a {signal.kind}, needs an address among the {space} registers")
    yield Register(signal.name, space, signal.address, "bit" if space in _BIT_SPACES else "float32")
    if signal.kind is Kind.SETTING:
        yield Register(signal.name, "input", ACTIVE_BLOCK + signal.address, "float32")


def _blocks(readings: Mapping[int, str]) -> Iterator[Register]:
    """Yield the readings by number, and the sequence number in front and at every number without a reading."""
    yield Register(SEQUENCE, "input", FLOAT_BLOCK - 1, "uint16")
    yield Register(SEQUENCE, "input", SCALED_BLOCK - 1, "uint16")
    last = max(readings)
    for number in range(last + 2):
        name = readings.get(number)
        if name is None:
            yield Register(SEQUENCE, "input", FLOAT_BLOCK + 2 * number, "uint16")
            if number < last:  # a block is read in one request: it has no holes
                yield Register(SEQUENCE, "input", FLOAT_BLOCK + 2 * number + 1, "uint16")
            yield Register(SEQUENCE, "input", SCALED_BLOCK + number, "uint16")
        else:
            yield Register(name, "input", FLOAT_BLOCK + 2 * number, "float32")
            yield Register(name, "input", SCALED_BLOCK + number, "int16")
            yield Register(name, "discrete", QUALITY_BLOCK + number, "bit")
