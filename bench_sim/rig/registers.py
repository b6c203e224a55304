"""The Modbus registers of the rig: readings of one sampling instant, staged settings, coils, contacts, and write
access.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from bench_protocol.map_file import MAP_FILE, map_registers
from bench_protocol.modbus import DEVICE_FAILURE, ILLEGAL_ADDRESS, ILLEGAL_VALUE, NO_AUTHORITY, ModbusError
from bench_protocol.registers import INT16_MAX, LEASE_ADDRESS, PROBE_FLOAT, PROBE_WORD, Register
from bench_protocol.signals import Kind
from bench_protocol.wires import Table
from bench_sim.rig.lease import Lease

#: Content of a scaled register whose value is not available.
UNAVAILABLE: Final = 0x8000
#: Object of the identification with the state of the CAN bus.
BUS_NOTE: Final = 0x81
#: Object of the identification with the reason why the springs of an FMU are lost, and its largest length in bytes.
SPRING_NOTE: Final = 0x82
NOTE_MAX: Final = 240
#: Size of the cache of read ranges.
_PLANS_MAX: Final = 256
WATCHDOG_MS_MAX: Final = 10_000

_SINGLE: Final = struct.Struct(">f")
_TWO_WORDS: Final = struct.Struct(">HH")


class Host(Protocol):
    """The attributes and methods of the rig that its registers use."""

    values: npt.NDArray[np.float64]  #: all signals by table row, SI; NaN where not available

    @property
    def seen(self) -> npt.NDArray[np.float64]:
        """Return all signals by table row (SI) at one sampling instant, for the Modbus request that is being
        answered.
        """

    @property
    def sequence(self) -> int:
        """Return the number of the sampling instant of ``seen``. It changes with every instant."""

    def act(self, name: str) -> bool:
        """Execute the action of a coil. Return whether the bench accepted it in its present state."""

    def apply(self, settings: Mapping[str, float]) -> bool:
        """Apply all settings at once. Return whether the bench accepted them."""

    def contact(self, name: str) -> bool:
        """Return the state of an interlock. True means what its description in the table of signals states, such as
        "The hard-wired emergency stop is pressed".
        """

    def read_file(self, number: int) -> Sequence[int]:
        """Return the registers of a file. The result is empty if there is no such file."""


class Space:
    """One Modbus address space of 16-bit words or bits. It stores which register is at each address."""

    def __init__(self, registers: Sequence[Register]) -> None:
        self.size = max((r.address + r.words for r in registers), default=0)
        self.owner: list[Register | None] = [None] * self.size
        for register in registers:
            for k in range(register.words):
                self.owner[register.address + k] = register

    def slots(self, address: int, count: int) -> list[Register]:
        """Return the registers in the range. Raises ModbusError if the range leaves the map or cuts a 32-bit value in
        half.
        """
        end = address + count
        if end > self.size:
            raise ModbusError(ILLEGAL_ADDRESS)
        found: list[Register] = []
        for register in self.owner[address:end]:
            if register is None:
                raise ModbusError(ILLEGAL_ADDRESS)
            if not found or found[-1] is not register:
                found.append(register)
        last = found[-1]
        if found[0].address < address or last.address + last.words > end:
            raise ModbusError(ILLEGAL_VALUE)
        return found


def float_words(value: float) -> list[int]:
    """Return the two registers of a number in IEEE 754 single precision, high word first."""
    return list(_TWO_WORDS.unpack(_SINGLE.pack(value)))


def words_float(words: Sequence[int]) -> float:
    """Return the number in two registers, high word first."""
    return float(_SINGLE.unpack(_TWO_WORDS.pack(*words))[0])


def _single(value: float) -> float:
    return words_float(float_words(value))


class RegisterBank:
    """The registers of one rig, shared by all clients. :meth:`seen_by` returns the view of one client."""

    def __init__(self, table: Table, host: Host, lease: Lease) -> None:
        self.table = table
        self.host = host
        self.lease = lease
        self._spaces = {
            space: Space([r for r in table.registers if r.space == space])
            for space in ("input", "holding", "coil", "discrete")
        }
        #: The settings in force and those staged, SI by name; each stays one mapping for the life of the rig.
        self.active: dict[str, float] = {s.name: s.default for s in table.of_kind(Kind.SETTING)}
        self.staged = dict(self.active)
        self._author = ""  # the peer that has staged last
        readings = (*table.of_kind(Kind.MEASUREMENT), *table.of_kind(Kind.STATUS))
        self._readings = frozenset(signal.name for signal in readings)
        self._plans: dict[tuple[int, int], npt.NDArray[np.int64] | None] = {}
        #: Additional texts of the identification, by object (0x81 to 0xFF).
        self.notes: dict[int, bytes] = {}

    def seen_by(self, peer: str) -> "PeerBank":
        """Return the registers as the client ``peer`` sees them."""
        return PeerBank(self, peer)

    @property
    def unapplied(self) -> bool:
        """Whether any staged setting differs from the active setting."""
        return any(
            float_words(self.staged[name]) != float_words(value) for name, value in self.active.items()
        )

    def drop_staged(self, author: str | None = None) -> None:
        """Discard the settings staged by ``author`` (default: by any client). So no other client can apply them."""
        if author in (None, self._author):
            self.staged.update(self.active)

    def _stage_as(self, peer: str) -> None:
        """Make ``peer`` the author of the staged settings. Discard those of another author."""
        if peer != self._author:
            self.drop_staged()
            self._author = peer

    def read_input(self, address: int, count: int) -> list[int]:
        rows = self._float_rows(address, count)
        if rows is not None:
            words: list[int] = self.host.seen[rows].astype(">f4").view(">u2").tolist()
            return words
        words = []
        for register in self._spaces["input"].slots(address, count):
            words += self._input(register)
        return words

    def _float_rows(self, address: int, count: int) -> npt.NDArray[np.int64] | None:
        """Return the table rows of a range that contains only readings as floats, as in most requests. Otherwise
        return None.
        """
        span = address, count
        if span not in self._plans:
            slots = self._spaces["input"].slots(address, count)
            plain = all(r.encoding == "float32" and r.signal in self._readings for r in slots)
            if len(self._plans) == _PLANS_MAX:
                self._plans.clear()
            self._plans[span] = np.array([self.table.index[r.signal] for r in slots]) if plain else None
        return self._plans[span]

    def _input(self, register: Register) -> list[int]:
        match register.signal:
            case "modbus.sequence":
                return [self.host.sequence]
            case "modbus.map_hash":
                return [self.table.map_hash >> 16, self.table.map_hash & 0xFFFF]
            case "modbus.probe_float":
                return float_words(PROBE_FLOAT)
            case "modbus.probe_word":
                return [PROBE_WORD >> 16, PROBE_WORD & 0xFFFF]
        if register.signal in self.active:
            return float_words(self.active[register.signal])
        row = self.table.index[register.signal]
        value = float(self.host.seen[row])
        if register.encoding == "float32":
            return float_words(value)
        if math.isnan(value):
            return [UNAVAILABLE]
        scaled = round(value / self.table.signals[row].step)
        # A clipped value would look valid; the float register of the same signal has the true value.
        return [scaled & 0xFFFF if abs(scaled) <= INT16_MAX else UNAVAILABLE]

    def read_holding(self, address: int, count: int, peer: str) -> list[int]:
        words: list[int] = []
        for register in self._spaces["holding"].slots(address, count):
            if register.signal == "modbus.lease":
                words.append(self.lease.word_for(peer))
            elif register.signal == "modbus.watchdog":
                words.append(self.lease.watchdog_ms)
            else:
                words += float_words(self.staged[register.signal])
        return words

    def write_holding(self, address: int, values: Sequence[int], peer: str) -> None:
        """Stage settings. A write to the registers of lease and watchdog takes effect at once.

        Raises ModbusError, with nothing changed, for a value out of range, or for a register that only the holder may
        write.
        """
        staged: dict[str, float] = {}
        lease, watchdog = None, None
        for register in self._spaces["holding"].slots(address, len(values)):
            words = values[register.address - address :][: register.words]
            if register.signal == "modbus.lease":
                lease = words[0]
            elif register.signal == "modbus.watchdog":
                watchdog = words[0]
                if watchdog > WATCHDOG_MS_MAX:
                    raise ModbusError(ILLEGAL_VALUE)
            else:
                signal = self.table[register.signal]
                value = words_float(words)
                # In single precision 0.15 is 0.150000006; the limits are rounded likewise, so that they are accepted.
                if not _single(signal.low) <= value <= _single(signal.high):
                    raise ModbusError(ILLEGAL_VALUE)
                if signal.choices and value != int(value):
                    raise ModbusError(ILLEGAL_VALUE)
                staged[signal.name] = min(max(value, signal.low), signal.high)
        self._take_own(peer, lease, watchdog)
        if staged:
            self._stage_as(peer)
            self.staged.update(staged)

    def _take_own(self, peer: str, lease: int | None, watchdog: int | None) -> None:
        """Apply a write to the registers of lease and watchdog. Only the holder may write the watchdog."""
        holds = self.lease.holds(peer) if lease is None else lease != 0
        if watchdog is not None and not holds:
            self.lease.refuse(peer)
            raise ModbusError(NO_AUTHORITY)
        if lease is not None:
            self.lease.write(peer, lease)
        if watchdog is not None:
            self.lease.watch(watchdog)

    def read_coils(self, address: int, count: int) -> list[bool]:
        """Return zeros, because a coil acts when it is set and is reset at once."""
        self._spaces["coil"].slots(address, count)
        return [False] * count

    def write_coils(self, address: int, values: Sequence[bool], peer: str) -> None:
        """Execute the actions of the coils that are set. Raises ModbusError for an action that the bench does not
        accept.
        """
        slots = self._spaces["coil"].slots(address, len(values))
        for register, value in zip(slots, values, strict=True):
            if not value:
                continue
            if register.signal == "action.apply":
                self._stage_as(peer)
                if not self.host.apply(self.staged):
                    raise ModbusError(DEVICE_FAILURE)
                self.active.update(self.staged)
            elif not self.host.act(register.signal.removeprefix("action.")):
                raise ModbusError(DEVICE_FAILURE)

    def read_discrete(self, address: int, count: int) -> list[bool]:
        bits = []
        for register in self._spaces["discrete"].slots(address, count):
            if register.signal.startswith("interlock."):
                bits.append(self.host.contact(register.signal.removeprefix("interlock.")))
            else:  # quality: the reading is available
                bits.append(not math.isnan(self.host.seen[self.table.index[register.signal]]))
        return bits

    def read_file(self, file: int, record: int, count: int) -> Sequence[int]:
        words = self._map if file == MAP_FILE else self.host.read_file(file)
        if record + count > len(words):
            raise ModbusError(ILLEGAL_ADDRESS)
        return words[record : record + count]

    @cached_property
    def _map(self) -> Sequence[int]:
        """Return the registers of the file with the signal map of this rig."""
        return map_registers(self.table)

    def identification(self) -> Mapping[int, bytes]:
        return {
            0: b"ASTB",
            1: b"virtual air spring test bench",
            2: b"1",
            4: b"ASTB",
            0x80: f"{self.table.map_hash:08x}".encode(),
            **self.notes,
        }


class PeerBank:
    """The registers as one client sees them. Every client may read, but only the holder of the lease may write.

    Without a holder, every client may write, so a command-line client needs no lease.
    """

    def __init__(self, bank: RegisterBank, peer: str) -> None:
        self._bank = bank
        self._peer = peer
        self.read_coils = bank.read_coils
        self.read_discrete = bank.read_discrete
        self.read_input = bank.read_input
        self.read_file = bank.read_file
        self.identification = bank.identification

    def read_holding(self, address: int, count: int) -> list[int]:
        """Return staged settings. The lease register has a different value for each client."""
        return self._bank.read_holding(address, count, self._peer)

    def write_coils(self, address: int, values: Sequence[bool]) -> None:
        """Execute the action of the coil that is set. Only one coil may be set, because one of two actions could be
        refused.
        """
        self._authorise()
        if sum(values) > 1:
            raise ModbusError(ILLEGAL_VALUE)
        self._bank.write_coils(address, values, self._peer)
        self._feed()

    def write_holding(self, address: int, values: Sequence[int]) -> None:
        """Stage settings, or take or return the lease."""
        self._authorise(values[0] if address == LEASE_ADDRESS else None)
        self._bank.write_holding(address, values, self._peer)
        self._feed()

    def _authorise(self, lease: int | None = None) -> None:
        if not self._bank.lease.open_to(self._peer, lease):
            self._bank.lease.refuse(self._peer)
            raise ModbusError(NO_AUTHORITY)

    def _feed(self) -> None:
        """Restart the watchdog after an accepted write. A refused write must not restart it."""
        if self._bank.lease.holds(self._peer):
            self._bank.lease.feed()
